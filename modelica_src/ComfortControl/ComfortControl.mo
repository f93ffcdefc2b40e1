model ComfortControl "Comfort in turbulence: vertical acceleration near the cockpit, low-pass, to the elevator"
  input Real acceleration(unit = "m/s2", start = 0) "Vertical acceleration of the front fuselage";
  output Real elevator(unit = "rad") "Elevator command";
  parameter Real gain(unit = "rad.s2/m", min = -1, max = 1, nominal = 1e-3) = -4e-4 "Command per acceleration; its negative sign shifts the phase by 180 deg";
  parameter Real frequency(unit = "Hz", min = 0.01, max = 100) = 2 "Corner of the low-pass";
  parameter Real damping(unit = "1", min = 0.1, max = 2) = 0.7 "Damping ratio of the low-pass";
  Real low(unit = "m/s2", start = 0, fixed = true) "Acceleration behind the low-pass";
  Real lowRate(unit = "m/s3", start = 0, fixed = true, nominal = 10) "Its derivative";
protected
  Real omega(unit = "rad/s") "Corner of the low-pass";
equation
  omega = 6.283185307179586 * frequency;
  der(low) = lowRate;
  der(lowRate) = omega * omega * (acceleration - low) - 2 * damping * omega * lowRate;
  elevator = gain * low;
end ComfortControl;

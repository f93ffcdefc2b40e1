model Disturbed "A lag and a lightly damped mode beside it, and what moves both from within: sines, a ramp, pulses"
  parameter Real tau = 1 "of the lag [s]";
  parameter Real f0 = 1 "of the mode [Hz]";
  parameter Real zeta = 0.05;
  parameter Real share = 0.5 "of the mode in the output";
  parameter Real cubic = 0 "of the mode's spring";
  parameter Real a[8] = {0, 0, 0, 0, 0, 0, 0, 0} "of the sines";
  parameter Real f[8] = {1, 1, 1, 1, 1, 1, 1, 1} "[Hz]";
  parameter Real p[8] = {0, 0, 0, 0, 0, 0, 0, 0} "[rad]";
  parameter Real ramp = 0 "[1/s]";
  parameter Real pulse = 0;
  parameter Real every = 1 "[s]";
  parameter Real width = 0.1 "[s]";
  parameter Real seen = 0 "what of the sines is in the output itself";
  input Real u(start = 0);
  output Real y;
  Real x(start = 0, fixed = true);
  Real q(start = 0, fixed = true);
  Real v(start = 0, fixed = true);
  Real sines;
  Real own;
equation
  sines = sum({a[i]*sin(6.283185307179586*f[i]*time + p[i]) for i in 1:8});
  own = sines + ramp*time + (if mod(time, every) < width then pulse else 0);
  tau*der(x) = -x + u + own;
  der(q) = v;
  der(v) = (6.283185307179586*f0)^2*(u + own - q - cubic*q^3) - 2*zeta*6.283185307179586*f0*v;
  y = (1 - share)*x + share*q + seen*sines;
end Disturbed;

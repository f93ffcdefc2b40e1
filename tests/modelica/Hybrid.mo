model Hybrid "Every kind of event in one model: state, time, sampled, deadline, reinit, hysteresis"
  input Real u(unit = "1") "Input";
  output Real y(unit = "m") "Height and counters";
  output Integer bounces(start = 0, fixed = true) "Number of bounces";
  output Boolean heating(start = false, fixed = true) "Two-point controller";
  parameter Real e(unit = "1", min = 0, max = 1) = 0.7 "Coefficient of restitution";
  parameter Real g(unit = "m/s2") = 9.81 "Gravity";
  parameter Real twiceG = 2*g "Calculated";
  parameter Real period(unit = "s") = 0.3 "Deadline period, tunable";
  Real h(start = 1, fixed = true, unit = "m") "Height";
  Real v(start = 0, fixed = true, unit = "m/s") "Speed";
  Real T(start = 18, fixed = true, unit = "1") "Temperature";
  discrete Real held(start = 0, fixed = true) "Sampled height";
  discrete Real next(start = 0.25, fixed = true, unit = "s") "Next deadline";
  discrete Integer deadlines(start = 0, fixed = true) "Deadlines passed";
  discrete Real mode(start = 0, fixed = true) "Last of when and elsewhen";
  Real stairs "Integer-valued of a continuous expression";
equation
  der(h) = v;
  der(v) = -g;
  when h < 0 and v < 0 then
    reinit(v, -e*v);
    bounces = pre(bounces) + 1;
  end when;
  der(T) = (if heating then 30 else 10) - T;
  heating = if pre(heating) then T < 21 else T < 19;
  when sample(0.05, 0.1) then
    held = h + u;
  end when;
  when time >= pre(next) then
    next = pre(next) + period;
    deadlines = pre(deadlines) + 1;
  end when;
  when {T > 20, time > 0.4} then
    mode = 1;
  elsewhen h < 0.5 then
    mode = 2;
  end when;
  stairs = floor(3*T/10) + mod(time, 0.5) + (if time > 0.7 then 0.5 else 0);
  y = h + held + stairs;
end Hybrid;

model Duffing "A mass on a hardening spring: its response folds back, jumps and doubles its period"
  input Real u(unit = "1", start = 0) "Force";
  output Real y(unit = "1") "Displacement";
  parameter Real damping(unit = "1/s", min = 0, nominal = 1) = 0.05 "Damping";
  parameter Real stiffness(unit = "1/s2", nominal = 1) = 1 "Linear stiffness";
  parameter Real cubic(unit = "1/s2", nominal = 1) = 1 "Cubic stiffness";
  Real x(unit = "1", start = 0, fixed = true, nominal = 1) "Displacement of the mass";
  Real v(unit = "1/s", start = 0, fixed = true, nominal = 1) "Its velocity";
equation
  der(x) = v;
  der(v) = u - damping * v - stiffness * x - cubic * x ^ 3;
  y = x;
end Duffing;

model FirstOrderLag "First-order lag 1/(tau s + 1), example 4-1"
  input Real u(unit = "1", start = 0) "Forcing";
  output Real y(unit = "1") "Lagged forcing";
  parameter Real tau(unit = "s", min = 1e-6, nominal = 1) = 1 "Time constant";
  Real x(unit = "1", start = 0, fixed = true, nominal = 1) "State of the lag";
equation
  der(x) = (u - x) / tau;
  y = x;
end FirstOrderLag;

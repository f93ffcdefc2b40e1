model Gain "y = k u: a co-simulation step costs nothing but the calls"
  input Real u(unit = "1", start = 0) "Input";
  output Real y(unit = "1") "Output";
  parameter Real k(unit = "1") = 2 "Gain";
equation
  y = k*u;
end Gain;

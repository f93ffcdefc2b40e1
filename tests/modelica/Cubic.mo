model Cubic "A Duffing oscillator with parameter-dependent start, for derivatives and stiffness"
  input Real u(start = 0.5) "Force";
  output Real y "Position";
  parameter Real k = 1 "Linear stiffness";
  parameter Real k3 = 0.5 "Cubic stiffness";
  parameter Real d = 0.2 "Damping";
  parameter Real x0 = 1.25 "Initial position";
  Real x(start = x0 + 0.25, fixed = true) "Position";
  Real w(start = 0, fixed = true) "Speed";
equation
  der(x) = w;
  der(w) = u - d*w - k*x - k3*x^3;
  y = x;
end Cubic;

model Resetting "Integrator that starts anew at 1, and whose initialisation overrides its start value"
  input Real u(start = 0.0);
  output Real y;
  Real x(start = 0.2, fixed = true);
equation
  der(x) = u;
  y = x;
  when initial() then
    reinit(x, 0.5);
  elsewhen x > 1.0 then
    reinit(x, 0.0);
  end when;
end Resetting;

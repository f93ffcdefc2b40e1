model Overridden "Damped mass on a spring whose initialisation overrides the start values of its states"
  parameter Real k(unit = "N/m") = 100.0 "stiffness";
  parameter Real d(unit = "N.s/m") = 4.0 "damping";
  input Real f(start = 0.0, unit = "N") "force";
  input Boolean locked(start = false) "adds a force of 10 N";
  output Real y(unit = "m") "position";
  output Real level "1 above 0.6 m: a relation, which continuous time keeps";
  Real s(start = 0.2, fixed = true, unit = "m") "position; 0.5 after initialisation, whatever its start value";
  Real v(start = 0.0, fixed = true, unit = "m/s") "velocity; 0 after initialisation";
  Boolean passed(start = false, fixed = true) "whether 0.8 m have been passed upwards";
equation
  der(s) = v;
  der(v) = f + (if locked then 10.0 else 0.0) - k * s - d * v;
  y = s;
  level = if s > 0.6 then 1.0 else 0.0;
  when initial() then
    reinit(s, 0.5);
    reinit(v, 0.0);
  end when;
  when s > 0.8 then
    passed = true;
  end when;
end Overridden;

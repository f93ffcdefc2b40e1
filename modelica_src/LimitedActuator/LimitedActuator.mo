model LimitedActuator "Surface command within the limits of deflection and rate"
  input Real command(unit = "rad", start = 0) "Command";
  output Real deflection(unit = "rad") "Deflection the surface is told to take";
  parameter Real upper(unit = "rad", min = 0, max = 1.6) = 0.4363323129985824 "Largest deflection";
  parameter Real lower(unit = "rad", min = -1.6, max = 0) = -0.4363323129985824 "Smallest deflection";
  parameter Real rateLimit(unit = "rad/s", min = 1e-3, max = 100) = 0.6981317007977318 "Largest rate";
  parameter Real timeConstant(unit = "s", min = 1e-4, max = 10, nominal = 0.01) = 0.005 "Follows a slow command with this lag";
  Real position(unit = "rad", start = 0, fixed = true, nominal = 0.1) "Limited position";
protected
  Real target(unit = "rad") "Command within the deflection limits";
equation
  target = min(max(command, lower), upper);
  der(position) = min(max((target - position) / timeConstant, -rateLimit), rateLimit);
  deflection = position;
end LimitedActuator;

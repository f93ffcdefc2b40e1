model AileronDamper "Actuator in damping mode: hinge moment quadratic in the rate of the surface"
  input Real rate(unit = "rad/s", start = 0) "Rate of the surface";
  output Real moment(unit = "N.m") "Moment with the sign of the rate; it acts on the surface with negative sign";
  parameter Real alpha2(unit = "N.m.s2/rad2", min = 0, max = 1e6, nominal = 1e3) = 7000 "Moment per square of the rate";
equation
  moment = alpha2 * rate * abs(rate);
end AileronDamper;

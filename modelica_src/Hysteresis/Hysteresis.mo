model Hysteresis "Hysteresis with a slope and a cut-off frequency, section 3.3.6"
  input Real u(unit = "1", start = 0) "Forcing";
  output Real y(unit = "1") "Output on the loop";
  parameter Real k(unit = "1", nominal = 1) = 2 "Slope of the loop's sides";
  parameter Real omegaC(unit = "rad/s", min = 0, nominal = 10) = 10 "Cut-off frequency with which a side is followed";
  parameter Real halfWidth(unit = "1", min = 0, nominal = 1) = 0.5 "Half the width of the loop along the input";
  Real x[1](each unit = "1", each start = 0, each fixed = true, each nominal = 1) "What has followed the input";
  Real v(unit = "1") "Working point, the state's distance from the input";
  Real beyond(unit = "1") "Part of the distance that exceeds the play";
equation
  v = x[1] - u;
  beyond = if v > halfWidth then v - halfWidth elseif v < -halfWidth then v + halfWidth else 0;
  der(x[1]) = -omegaC * beyond;
  y = k * x[1];
end Hysteresis;

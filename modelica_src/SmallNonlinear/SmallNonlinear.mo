model SmallNonlinear "Saturation and quantiser in the state equation, limiter on the output, section 3.3.7"
  input Real u(unit = "1", start = 0) "Forcing";
  output Real y(unit = "1") "Limited second state";
  parameter Real saturation(unit = "1", min = 0, nominal = 1) = 1 "Limit of the saturation, either sign";
  parameter Real resolution(unit = "1", min = 1e-9, nominal = 0.1) = 0.1 "Resolution of the quantiser";
  parameter Real lower(unit = "1", nominal = 1) = -0.1 "Lower limit of the output";
  parameter Real upper(unit = "1", nominal = 1) = 1 "Upper limit of the output";
  Real x[2](each unit = "1", each start = 0, each fixed = true, each nominal = 1) "States, inputs of the three blocks";
  Real saturated(unit = "1") "Saturated first state";
  Real quantised(unit = "1") "Quantised second state";
protected
  constant Real tie = 1e-9 "Part of a step by which a value may fall short of half a step and still round up";
equation
  saturated = if x[1] > saturation then saturation elseif x[1] < -saturation then -saturation else x[1];
  quantised = resolution * floor(x[2] / resolution + 0.5 + tie);
  der(x[1]) = saturated + quantised + u;
  der(x[2]) = x[1];
  y = if x[2] > upper then upper elseif x[2] < lower then lower else x[2];
end SmallNonlinear;

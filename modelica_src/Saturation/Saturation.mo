model Saturation "Linear dynamics with a saturation on the output, example 2-1"
  input Real u(unit = "1", start = 0) "Forcing of the dynamics";
  output Real y(unit = "1") "Output of the block";
  parameter Real lower(unit = "1", nominal = 1) = -1 "Lower limit";
  parameter Real upper(unit = "1", nominal = 1) = 1 "Upper limit";
  parameter Real A[2, 2](each unit = "1/s") = {{-0.51, -0.42}, {0.5, 0}} "System matrix of the dynamics";
  parameter Real B[2](each unit = "1/s") = {1, 0} "Input matrix of the dynamics";
  parameter Real C[2](each unit = "1") = {0.6407, 0.6794} "Output matrix of the dynamics";
  parameter Real D(unit = "1") = 0.43 "Feedthrough of the dynamics";
  Real x[2](each unit = "1", each start = 0, each fixed = true, each nominal = 1) "States of the dynamics";
  Real v(unit = "1") "Input of the block";
equation
  der(x) = A * x + B * u;
  v = C * x + D * u;
  y = if v > upper then upper elseif v < lower then lower else v;
end Saturation;

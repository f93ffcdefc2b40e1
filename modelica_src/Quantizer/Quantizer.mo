model Quantizer "Linear dynamics with a quantiser on the output, example 2-4"
  input Real u(unit = "1", start = 0) "Forcing of the dynamics";
  output Real y(unit = "1") "Output of the block";
  parameter Real resolution(unit = "1", min = 1e-9, nominal = 1) = 0.5 "Distance of two output levels";
  parameter Real A[2, 2](each unit = "1/s") = {{-0.51, -0.42}, {0.5, 0}} "System matrix of the dynamics";
  parameter Real B[2](each unit = "1/s") = {1, 0} "Input matrix of the dynamics";
  parameter Real C[2](each unit = "1") = {0.6407, 0.6794} "Output matrix of the dynamics";
  parameter Real D(unit = "1") = 0.43 "Feedthrough of the dynamics";
  Real x[2](each unit = "1", each start = 0, each fixed = true, each nominal = 1) "States of the dynamics";
  Real v(unit = "1") "Input of the block";
equation
  der(x) = A * x + B * u;
  v = C * x + D * u;
  y = resolution * floor(v / resolution + 0.5);
end Quantizer;

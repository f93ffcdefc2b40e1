model GainScheduler "Linear dynamics with a scheduled gain on the output, example 2-5"
  input Real u(unit = "1", start = 0) "Forcing of the dynamics";
  output Real y(unit = "1") "Output of the block";
  parameter Real breakPoints[4](each unit = "1") = {-2, -1, 0, 1} "Inputs at which the gain changes, rising";
  parameter Real gains[4](each unit = "1") = {0, 1, 0, 3} "Gain from each break point on; the first also below it";
  parameter Real A[2, 2](each unit = "1/s") = {{-0.51, -0.42}, {0.5, 0}} "System matrix of the dynamics";
  parameter Real B[2](each unit = "1/s") = {1, 0} "Input matrix of the dynamics";
  parameter Real C[2](each unit = "1") = {0.6407, 0.6794} "Output matrix of the dynamics";
  parameter Real D(unit = "1") = 0.43 "Feedthrough of the dynamics";
  Real x[2](each unit = "1", each start = 0, each fixed = true, each nominal = 1) "States of the dynamics";
  Real v(unit = "1") "Input of the block";
  Real gain(unit = "1") "Gain in force";
equation
  der(x) = A * x + B * u;
  v = C * x + D * u;
  gain = if v >= breakPoints[4] then gains[4] elseif v >= breakPoints[3] then gains[3]
    elseif v >= breakPoints[2] then gains[2] else gains[1];
  y = gain * v;
end GainScheduler;

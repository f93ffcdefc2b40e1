package Arrays "Arrays, loops, functions, enumerations, several models in one file"
  function interpolate "Linear table look-up, clamped"
    input Real x;
    input Real xs[:];
    input Real ys[size(xs, 1)];
    output Real y;
  protected
    Integer i;
    Real xc;
  algorithm
    xc := min(max(x, xs[1]), xs[size(xs, 1)]);
    i := 1;
    while i < size(xs, 1) - 1 and xc > xs[i + 1] loop
      i := i + 1;
    end while;
    y := ys[i] + (xc - xs[i])*(ys[i + 1] - ys[i])/(xs[i + 1] - xs[i]);
  end interpolate;

  model StateSpace "der(x) = A x + B u"
    parameter Real A[4, 4] = {{-1, 2, 0, 0}, {-2, -1, 0.5, 0}, {0, 0, -3, 1}, {0.1, 0, 0, -0.5}} "System matrix";
    parameter Real B[4] = {0, 1, 0, 2} "Input matrix";
    parameter Real C[2, 4] = {{1, 0, 0, 0}, {0, 0, 1, 1}} "Output matrix";
    input Real u "Input";
    output Real y[2] "Outputs";
    Real x[4](each start = 0.1, each fixed = true) "States";
  equation
    der(x) = A*x + B*u;
    y = C*x;
  end StateSpace;

  model Elementary "Elementary functions, a table and a loop"
    type Gear = enumeration(low, high) "Gear";
    input Real u "Input";
    output Real y "Output";
    parameter Gear gear = Gear.low "Selected gear";
    parameter Boolean invert = false "Sign of the table";
    parameter Real xs[4] = {-1, 0, 1, 3} "Break points";
    parameter Real ys[4] = {2, 0, 1, -1} "Values";
    final parameter Real offset = 0.25 "Folded";
    Real x[3](start = {0.5, 1.5, 0.25}, each fixed = true) "States";
    Real table "Looked up";
    Real ratio "Solved for, not written out";
  equation
    for i in 1:3 loop
      der(x[i]) = -i*x[i] + sin(u) + 0.1*tanh(x[mod(i, 3) + 1]);
    end for;
    table = interpolate(u + x[1], xs, ys) * (if gear == Gear.low then 1 else 2);
    (2 + x[1]^2)*ratio = exp(-x[2]) + sqrt(abs(x[3]) + 1) + atan2(x[1], 2 + u^2) + log(2 + x[2]^2);
    y = table + ratio + offset + max(x) + sum(x)^3 + min(u, x[2]) + x*x;
  end Elementary;
end Arrays;

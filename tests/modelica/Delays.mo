package Delays "delay() with closed forms"
  model Chain "A jump through one delay and through two; counted where it comes out; an unused branch notes its input, too"
    input Real u;
    parameter Real half = 0.15;
    parameter Real T = 2 * half "Delay [s]";
    output Real y;
    output Real yy;
    output Real branch;
    discrete output Real n(start = 0, fixed = true);
  equation
    y = delay(u, T);
    yy = delay(y, T);
    branch = if time > 1.5 then delay(2 * u, 1.0, 2.0) else 0;
    when y > 0.5 then
      n = pre(n) + 1;
    end when;
  end Chain;

  model Lag "The output of a lag, delayed; each element of an array has its own past"
    input Real u;
    output Real y;
    output Real v[2];
    Real lag(start = 0, fixed = true);
  equation
    der(lag) = u - lag;
    y = delay(lag, 0.4);
    v = delay({lag, 2 * u}, 0.5);
  end Lag;

  model Past "x' = -x(t - 1)"
    output Real x(start = 1, fixed = true);
  equation
    der(x) = -delay(x, 1.0);
  end Past;
end Delays;

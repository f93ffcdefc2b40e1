model Loops "What becomes loops: copies, tables, calls, relations, a chain of algebraic variables, components"
  model Cell
    parameter Real c = 2.0;
    Real x(start = 0.5, fixed = true);
    Real through;
    Real before;
  equation
    through = c*(before - x) + 0.1*x^3;
    der(x) = if through > 0.2 then through else 2*through - 0.2;
  end Cell;
  parameter Integer n = 120;
  parameter Real k[n] = {1 + 0.01*i*i for i in 1:n};
  input Real u(start = 0);
  output Real y;
  Real x[n](each start = 0.2, each fixed = true);
  Real v[n](each start = 0, each fixed = true);
  Real s[n];
  Cell cell[n];
equation
  s[n] = sin(x[n]);
  for i in 1:n-1 loop
    s[i] = 0.9*s[i+1] + sin(x[i]);
  end for;
  for i in 1:n loop
    der(x[i]) = v[i];
    der(v[i]) = -k[i]*x[i] - 0.1*i*v[i]/(1 + x[i]^2) + exp(-abs(u))*s[n+1-i] + (0.3 + 1.7*i)^1.5*1e-3;
  end for;
  cell[1].before = u;
  for i in 2:n loop
    cell[i].before = cell[i-1].x;
  end for;
  y = s[1] + cell[n].x;
end Loops;

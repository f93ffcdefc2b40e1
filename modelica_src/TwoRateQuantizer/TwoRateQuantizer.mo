model TwoRateQuantizer "One input through two sampled quantisers of different rate and resolution, summed, example 4-2"
  input Real u(unit = "1", start = 0) "Forcing of both quantisers";
  output Real y(unit = "1") "Sum of both quantised values";
  constant Real fastPeriod(unit = "s") = 1 / 208 "Sample period of the fast, coarse quantiser";
  constant Real slowPeriod(unit = "s") = 1 / 131 "Sample period of the slow, fine quantiser";
  parameter Real coarse(unit = "1", min = 1e-6, nominal = 0.01) = 0.05 "Resolution of the fast quantiser";
  parameter Real fine(unit = "1", min = 1e-6, nominal = 0.01) = 0.01 "Resolution of the slow quantiser";
  discrete Real yFast(unit = "1", start = 0, fixed = true, nominal = 1) "Held value of the fast, coarse quantiser";
  discrete Real ySlow(unit = "1", start = 0, fixed = true, nominal = 1) "Held value of the slow, fine quantiser";
equation
  when sample(0, fastPeriod) then
    yFast = coarse * floor(u / coarse + 0.5);
  end when;
  when sample(0, slowPeriod) then
    ySlow = fine * floor(u / fine + 0.5);
  end when;
  y = yFast + ySlow;
end TwoRateQuantizer;

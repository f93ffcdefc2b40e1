model ElevatorLaw "Sampled elevator flight control law, side stick to elevator command, chapter 6"
  function interpolate "Linear look-up in a table with rising xs; the argument must lie within"
    input Real v;
    input Real xs[:];
    input Real ys[size(xs, 1)];
    output Real y;
  protected
    Integer i;
  algorithm
    i := 1;
    while i < size(xs, 1) - 1 and v > xs[i + 1] loop
      i := i + 1;
    end while;
    y := ys[i] + (v - xs[i]) * (ys[i + 1] - ys[i]) / (xs[i + 1] - xs[i]);
  end interpolate;

  function entry "Entry of the flap setting next to the code; of setting 0 where the code is no setting"
    input Real code;
    input Real ys[:];
    output Real y;
  protected
    Integer i;
  algorithm
    y := ys[1];
    for i in 2:size(ys, 1) loop
      if code > i - 1.5 and code <= i - 0.5 then
        y := ys[i];
      end if;
    end for;
  end entry;

  function isOne "1 where the code is next to 1, else 0"
    input Real code;
    output Real y;
  algorithm
    y := if code > 0.5 and code <= 1.5 then 1 else 0;
  end isOne;

  function isNormal "1 where flap is next to 0 or no setting, flying, both elevators work, else 0"
    input Real flap;
    input Real grounded;
    input Real failed;
    output Real y;
  algorithm
    y := if (flap <= 0.5 or flap > 4.5) and grounded < 0.5 and failed < 0.5 then 1 else 0;
  end isNormal;

  input Real cmu_code(unit = "1", start = 0) "Choice of the control law, 0 normal law; no other is modelled (block 97)";
  input Real flap(unit = "1", start = 0) "Flap setting, 0 to 4";
  input Real on_ground(unit = "1", start = 0) "1 on ground, 0 in flight";
  input Real elevator_failed(unit = "1", start = 0) "1 when one elevator has failed, 0 when both work";
  input Real side_stick(unit = "1", start = 0) "Side stick, -1 to 1, positive forward";
  output Real elevator(unit = "deg") "Elevator command";
  constant Real period(unit = "s") = 0.022 "Sample period";
  parameter Real stickIn[5](each unit = "1") = {-1, -0.5, 0, 0.5, 1} "Break points of the stick's shape, rising (block 8)";
  parameter Real stickOut[5](each unit = "1") = {-1, -0.48, 0, 0.48, 1} "Shaped stick at the break points (block 8)";
  parameter Real positiveByFlap[5](each unit = "deg") = {6.9, 7.8, 8.6, 9.4, 10.5} "Gain forward of neutral, in flight (block 9)";
  parameter Real negativeByFlap[5](each unit = "deg") = {5.8, 6.5, 7.2, 8.0, 9.0} "Gain aft of neutral, in flight (block 9)";
  parameter Real positiveGround[5](each unit = "deg") = {14.4, 15.6, 17.0, 18.5, 20.0} "Gain forward of neutral, on ground (block 98)";
  parameter Real negativeGround[5](each unit = "deg") = {12.0, 13.0, 14.2, 15.5, 17.0} "Gain aft of neutral, on ground (block 98)";
  parameter Real failedFactor(unit = "1", min = 0, nominal = 1) = 2 "Factor on the flight gains with one elevator failed (block 9)";
  parameter Real gainRate(unit = "deg/s", min = 0, nominal = 1) = 5 "Speed at which a gain moves to its new value (block 10)";
  parameter Real fadeTime(unit = "s", min = 0, nominal = 1) = 4 "How long gains fade after the return to normal (block 10)";
  parameter Real offsetByFlap[5](each unit = "deg") = {2.0, 3.0, 4.2, 5.8, 7.0} "Offset of the elevator (blocks 99 and 6)";
  parameter Real deflectionMin(unit = "deg", nominal = 10) = -30 "Lower limit of the elevator (block 15)";
  parameter Real deflectionMax(unit = "deg", nominal = 10) = 15 "Upper limit of the elevator (block 15)";
  parameter Real rateMax(unit = "deg/s", min = 0, nominal = 10) = 30 "Rate limit of the elevator (block 1)";
  // The four states, in the order of the source's perturbation vectors
  discrete Real positiveGain(unit = "deg", start = 6.9, fixed = true, nominal = 10) "Integrator of the gain forward of neutral (block 10)";
  discrete Real negativeGain(unit = "deg", start = 5.8, fixed = true, nominal = 10) "Integrator of the gain aft of neutral (block 10)";
  discrete Real normalFor(unit = "s", start = 60, fixed = true, nominal = 10) "Time since the configuration is normal, kept once the fade is over";
  discrete Real deflection(unit = "deg", start = 2, fixed = true, nominal = 10) "Rate-limited elevator command (block 1)";
  // The way of the signal, from the present inputs and the held states
  Real grounded(unit = "1") "1 on ground, else 0 (blocks 94 to 96)";
  Real failed(unit = "1") "1 with one elevator failed, else 0 (blocks 94 to 96)";
  Real normal(unit = "1") "1 in normal flight configuration, else 0 (blocks 94 to 96)";
  Real positiveWanted(unit = "deg") "Gain forward of neutral that the configuration asks for";
  Real negativeWanted(unit = "deg") "Gain aft of neutral that the configuration asks for";
  Real stick(unit = "1") "Saturated and shaped stick (block 8)";
  Real gain(unit = "deg") "Gain in force, by the stick's sign (blocks 2 and 5)";
  Real scaled(unit = "deg") "Stick times gain (block 5)";
  Real shifted(unit = "deg") "With the flap's offset (block 6)";
  Real demand(unit = "deg") "Within the elevator's limits, input of the rate limiter (block 15)";
equation
  // Blocks 94 to 99: what the configuration asks for
  grounded = isOne(on_ground);
  failed = isOne(elevator_failed);
  normal = isNormal(flap, grounded, failed);
  positiveWanted = grounded * entry(flap, positiveGround)
    + (1 - grounded) * (1 + failed * (failedFactor - 1)) * entry(flap, positiveByFlap);
  negativeWanted = grounded * entry(flap, negativeGround)
    + (1 - grounded) * (1 + failed * (failedFactor - 1)) * entry(flap, negativeByFlap);
  // Blocks 8, 2, 5, 6, 15
  stick = interpolate(min(max(side_stick, -1), 1), stickIn, stickOut);
  gain = noEvent(if normalFor < fadeTime then (if stick >= 0 then positiveGain else negativeGain)
    else (if stick >= 0 then positiveByFlap[1] else negativeByFlap[1]));
  scaled = gain * stick;
  shifted = scaled + entry(flap, offsetByFlap);
  demand = min(max(shifted, deflectionMin), deflectionMax);
  // Blocks 10 and 1
  when sample(0, period) then
    normalFor = if normal < 0.5 then 0 else if pre(normalFor) < fadeTime then pre(normalFor) + period else pre(normalFor);
    positiveGain = if normalFor < fadeTime
      then pre(positiveGain) + min(max(positiveWanted - pre(positiveGain), -gainRate * period), gainRate * period)
      else pre(positiveGain);
    negativeGain = if normalFor < fadeTime
      then pre(negativeGain) + min(max(negativeWanted - pre(negativeGain), -gainRate * period), gainRate * period)
      else pre(negativeGain);
    deflection = pre(deflection) + min(max(demand - pre(deflection), -rateMax * period), rateMax * period);
  end when;
  elevator = deflection;
end ElevatorLaw;

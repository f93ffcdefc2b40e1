model Rudder "Electro-hydraulic rudder actuator with surface, example 4-3 and chapter 7"
  // Inputs: the command, and three that are constant in normal operation
  input Real delC(unit = "deg", start = 0, min = -180, max = 180) "Commanded deflection";
  input Real pS(unit = "Pa", start = 2.06e7, min = 0, nominal = 1e7) "Supply pressure";
  input Real mH(unit = "N.m", start = 0, nominal = 1e3) "External hinge moment on the surface";
  input Real bypass(unit = "1", start = 0, min = 0, max = 1) "Mode valve: 0 active, 1 bypass";
  output Real del(unit = "deg") "Deflection of the surface";
  // Fluid
  parameter Real rho(unit = "kg/m3", min = 500, max = 2000, nominal = 1000) = 1000 "Density of the fluid";
  parameter Real beta(unit = "Pa", min = 1e8, max = 3e9, nominal = 1e9) = 8e8 "Effective bulk modulus";
  parameter Real pR(unit = "Pa", min = 0, max = 2e6, nominal = 1e6) = 5e5 "Return pressure";
  // Servo valve
  parameter Real cD(unit = "1", min = 0.1, max = 1) = 0.61 "Discharge coefficient";
  parameter Real width(unit = "m", min = 1e-4, max = 0.1, nominal = 0.01) = 0.02 "Area gradient of the ports";
  parameter Real lap(unit = "m", min = 1e-7, max = 1e-4, nominal = 1e-5) = 1e-5 "Rounding of the port edges";
  parameter Real dpLaminar(unit = "Pa", min = 1, max = 1e6, nominal = 1e5) = 1e5 "Pressure drop at which orifice flow becomes laminar";
  parameter Real spoolGain(unit = "m/A", min = 1e-4, max = 1, nominal = 0.01) = 0.01 "Spool position per current";
  parameter Real spoolMax(unit = "m", min = 1e-5, max = 1e-2, nominal = 1e-4) = 3.6e-4 "Travel limit of the spool";
  parameter Real spoolRateMax(unit = "m/s", min = 1e-4, max = 1, nominal = 0.01) = 0.013 "Rate limit of the spool";
  parameter Real tauSpool(unit = "s", min = 1e-4, max = 1, nominal = 0.01) = 0.007 "Time constant of the spool";
  parameter Real bypassArea(unit = "m2", min = 1e-8, max = 1e-3, nominal = 1e-6) = 5e-6 "Damping orifice of each chamber in bypass";
  // Servo amplifier
  parameter Real loopGain(unit = "A/rad", min = 1e-3, max = 10, nominal = 0.1) = 0.512 "Current per position error";
  parameter Real currentMax(unit = "A", min = 1e-4, max = 1, nominal = 0.01) = 0.04 "Limit of the current";
  parameter Real tauCurrent(unit = "s", min = 1e-4, max = 1, nominal = 0.01) = 0.017 "Time constant of roll-off filter and coil";
  parameter Real delMax(unit = "deg", min = 1, max = 90, nominal = 10) = 25 "Limit of the command";
  // Cylinder
  parameter Real area(unit = "m2", min = 1e-5, max = 0.1, nominal = 1e-3) = 4e-3 "Piston area";
  parameter Real halfStroke(unit = "m", min = 1e-3, max = 1, nominal = 0.1) = 0.07 "Half stroke, where the end stops begin";
  parameter Real deadVolume(unit = "m3", min = 1e-6, max = 1e-2, nominal = 1e-4) = 7e-5 "Dead volume of each chamber";
  parameter Real leakage(unit = "m3/(s.Pa)", min = 0, max = 1e-9, nominal = 1e-12) = 5e-12 "Laminar leakage across the piston";
  parameter Real mass(unit = "kg", min = 0.1, max = 100, nominal = 10) = 6 "Mass of piston and rod";
  parameter Real viscous(unit = "N.s/m", min = 0, max = 1e6, nominal = 1e3) = 2e3 "Viscous friction of the seals";
  parameter Real coulomb(unit = "N", min = 0, max = 1e4, nominal = 100) = 150 "Coulomb friction of the seals";
  parameter Real frictionSpeed(unit = "m/s", min = 1e-4, max = 1, nominal = 0.01) = 0.01 "Speed over which friction changes sign";
  parameter Real stopStiffness(unit = "N/m", min = 0, max = 1e10, nominal = 1e8) = 1e8 "Stiffness of the end stops";
  // Attachment and surface
  parameter Real lever(unit = "m", min = 0.01, max = 1, nominal = 0.1) = 0.15 "Lever arm of the actuator";
  parameter Real stiffness(unit = "N/m", min = 1e5, max = 1e10, nominal = 1e8) = 8e7 "Stiffness of rod and attachment";
  parameter Real damping(unit = "N.s/m", min = 0, max = 1e7, nominal = 1e5) = 1.2e5 "Damping of rod and attachment";
  parameter Real inertia(unit = "kg.m2", min = 0.1, max = 1e4, nominal = 10) = 36 "Inertia of the surface about its hinge";
  parameter Real aeroStiffness(unit = "N.m/rad", min = -1e6, max = 1e6, nominal = 1e3) = 3000 "Aerodynamic stiffness of the surface";
  parameter Real aeroDamping(unit = "N.m.s/rad", min = 0, max = 1e5, nominal = 100) = 300 "Aerodynamic damping of the surface";
  // States, in the order in which they are exported
  Real p1(unit = "Pa", start = 1.055e7, fixed = true, nominal = 1e7) "Pressure in chamber 1";
  Real p2(unit = "Pa", start = 1.055e7, fixed = true, nominal = 1e7) "Pressure in chamber 2";
  Real spool(unit = "m", start = 0, fixed = true, nominal = 1e-4) "Spool position";
  Real current(unit = "A", start = 0, fixed = true, nominal = 1e-2) "Current of the torque motor";
  Real piston(unit = "m", start = 0, fixed = true, nominal = 1e-2) "Piston position";
  Real pistonSpeed(unit = "m/s", start = 0, fixed = true, nominal = 1e-2) "Piston speed";
  Real surface(unit = "rad", start = 0, fixed = true, nominal = 1e-2) "Surface angle";
  Real surfaceSpeed(unit = "rad/s", start = 0, fixed = true, nominal = 1e-2) "Surface rate";
  // Everything else follows explicitly from the states and inputs, in this order
  Real command(unit = "rad") "Limited command";
  Real error(unit = "rad") "Position error of the loop";
  Real spoolTarget(unit = "m") "Spool position asked for, within the travel";
  Real active(unit = "1") "Share of the mode valve that is open to the servo valve";
  Real rounding(unit = "m") "Rounded magnitude of the spool position";
  Real opening1(unit = "m") "Opening supply to chamber 1 and chamber 2 to return";
  Real opening2(unit = "m") "Opening supply to chamber 2 and chamber 1 to return";
  Real dpSupply1(unit = "Pa") "Supply minus chamber 1";
  Real dpSupply2(unit = "Pa") "Supply minus chamber 2";
  Real dpReturn1(unit = "Pa") "Chamber 1 minus return";
  Real dpReturn2(unit = "Pa") "Chamber 2 minus return";
  Real jetSupply1(unit = "m/s") "Jet speed from supply into chamber 1";
  Real jetSupply2(unit = "m/s") "Jet speed from supply into chamber 2";
  Real jetReturn1(unit = "m/s") "Jet speed from chamber 1 to return";
  Real jetReturn2(unit = "m/s") "Jet speed from chamber 2 to return";
  Real leak(unit = "m3/s") "Leakage from chamber 1 to chamber 2";
  Real flow1(unit = "m3/s") "Flow into chamber 1";
  Real flow2(unit = "m3/s") "Flow into chamber 2";
  Real linkForce(unit = "N") "Force of the rod on the surface";
  Real frictionForce(unit = "N") "Friction of the seals";
  Real stopForce(unit = "N") "Force of the end stops";
protected
  constant Real degree(unit = "rad/deg") = 0.017453292519943295 "One degree";
equation
  // Position loop: the amplifier limits softly, then roll-off filter and coil
  command = degree * min(max(delC, -delMax), delMax);
  error = command - piston / lever;
  der(current) = (currentMax * tanh(loopGain * error / currentMax) - current) / tauCurrent;
  // Spool: travel and rate limits
  spoolTarget = min(max(spoolGain * current, -spoolMax), spoolMax);
  der(spool) = min(max((spoolTarget - spool) / tauSpool, -spoolRateMax), spoolRateMax);
  // Ports: rounded edges leave half of `lap` open at null, so the flow gain has no corner there
  active = 1 - min(max(bypass, 0), 1);
  rounding = sqrt(spool * spool + lap * lap);
  opening1 = (rounding + spool) / 2;
  opening2 = (rounding - spool) / 2;
  // Orifices: sqrt(2 dp/rho), linear below dpLaminar, odd in dp, finite slope at 0
  dpSupply1 = pS - p1;
  dpSupply2 = pS - p2;
  dpReturn1 = p1 - pR;
  dpReturn2 = p2 - pR;
  jetSupply1 = sqrt(2 / rho) * dpSupply1 / sqrt(sqrt(dpSupply1 * dpSupply1 + dpLaminar * dpLaminar));
  jetSupply2 = sqrt(2 / rho) * dpSupply2 / sqrt(sqrt(dpSupply2 * dpSupply2 + dpLaminar * dpLaminar));
  jetReturn1 = sqrt(2 / rho) * dpReturn1 / sqrt(sqrt(dpReturn1 * dpReturn1 + dpLaminar * dpLaminar));
  jetReturn2 = sqrt(2 / rho) * dpReturn2 / sqrt(sqrt(dpReturn2 * dpReturn2 + dpLaminar * dpLaminar));
  leak = leakage * (p1 - p2);
  flow1 = cD * (active * width * (opening1 * jetSupply1 - opening2 * jetReturn1) - (1 - active) * bypassArea * jetReturn1) - leak;
  flow2 = cD * (active * width * (opening2 * jetSupply2 - opening1 * jetReturn2) - (1 - active) * bypassArea * jetReturn2) + leak;
  // Chambers
  der(p1) = beta * (flow1 - area * pistonSpeed) / (deadVolume + area * (halfStroke + piston));
  der(p2) = beta * (flow2 + area * pistonSpeed) / (deadVolume + area * (halfStroke - piston));
  // Piston, rod and surface
  linkForce = stiffness * (piston - lever * surface) + damping * (pistonSpeed - lever * surfaceSpeed);
  frictionForce = coulomb * tanh(pistonSpeed / frictionSpeed) + viscous * pistonSpeed;
  stopForce = stopStiffness * (max(piston - halfStroke, 0) + min(piston + halfStroke, 0));
  der(piston) = pistonSpeed;
  der(pistonSpeed) = (area * (p1 - p2) - frictionForce - stopForce - linkForce) / mass;
  der(surface) = surfaceSpeed;
  der(surfaceSpeed) = (lever * linkForce - aeroStiffness * surface - aeroDamping * surfaceSpeed + mH) / inertia;
  del = surface / degree;
end Rudder;

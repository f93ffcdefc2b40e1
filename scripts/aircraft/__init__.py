"""The generic aeroelastic aircraft: prior, calibration, Modelica source, and the figures of the result."""

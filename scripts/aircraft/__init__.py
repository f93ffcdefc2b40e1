"""The generic aeroelastic aircraft: prior, what was changed of it, and the Modelica source of both."""

"""What makes FMUs: from Modelica, linear models, systems and C sources; the compiler and the runtime of built FMUs.

`fmu.build_fmu` turns one model into one FMU, `fmu.build_all` every model of a file or folder. The steps, one module
each: frontend (check and flatten) · ir (read the DAE) · translate and scalarise (arrays, loops, functions) · causalise
(match and sort) · differentiate · emit_c and emit_tables · stiffness · describe (XML of FMI 2 and 3) · pack; the
compiler is in toolchain. `export.export_linear` turns matrices into an FMU: matrices (read and check) · state_space and
time_scale (to the scalar form, without the front end), then causalise and on.
"""

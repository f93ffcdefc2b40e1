"""Modelica → FMU, and linear state-space models → FMU.

`build_fmu` turns one model into one FMU, `build_all` every model of a file or folder. The steps, one
module each: frontend (check and flatten) · ir (read the DAE) · translate and scalarise (arrays, loops,
functions) · causalise (match and sort) · differentiate · emit_c and emit_tables · stiffness · describe
(XML of FMI 2 and 3) · pack; the compiler is in workbench.toolchain. The C runtime is in the folder runtime.

`build.export.export_linear` turns matrices into an FMU: matrices (read and check) · state_space and time_scale
(to the scalar form, without the front end), then causalise and on.
"""

from __future__ import annotations

from workbench.build.fmu import BuildResult, build_all, build_fmu

__all__ = ["BuildResult", "build_all", "build_fmu"]

"""The one place that imports FMPy's untyped modules.

FMPy prints while it is imported where it has no logger library (Linux on ARM); nothing may be
printed from here, so its words are swallowed. They only mean that log lines arrive unformatted.
"""

from __future__ import annotations

import contextlib
import io
from typing import Any

with contextlib.redirect_stdout(io.StringIO()):
    import fmpy
    import fmpy.fmi1
    import fmpy.fmi2
    import fmpy.fmi3

__all__ = ["add_logger_proxy", "fmi1", "fmi2", "fmi3", "fmpy"]

fmi1: Any = fmpy.fmi1
fmi2: Any = fmpy.fmi2
fmi3: Any = fmpy.fmi3

# C function that replaces the logger of a callback structure by one that formats the variadic
# message. It keeps the Python callback in ONE process-wide variable, so there must be one
# callback for all instances (see `log.py`). None where FMPy has no library for this machine.
add_logger_proxy: Any = getattr(fmpy.fmi1, "addLoggerProxy", None)

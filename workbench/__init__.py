"""FMI workbench: analyses of FMUs from Python and from the command line.

```python
import workbench as wb

with wb.load("fmu:Rudder") as rudder:
    result = wb.nfr(rudder, "delC", "del", band=(0.5, 20.0), amplitudes=[1.0, 4.0])
result.plot("bode.png")
```

Names are loaded when they are first used, so that importing the package is quick.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from workbench.analysis.certificate import Certificate
    from workbench.analysis.lin.compare import LinComparison, Verdict, compare
    from workbench.analysis.lin.linearise import lin
    from workbench.analysis.lin.result import Doubt, LinearModel, LinResult, Zero
    from workbench.analysis.lin.step_check import StepCheck, step_check
    from workbench.analysis.lin.sweep import LinGrid, LinPoint, lin_along, lin_over
    from workbench.analysis.nfr import NfrSweep, nfr
    from workbench.analysis.nfr_point import NfrPoint
    from workbench.analysis.nfr_result import FailedPoint, NfrResult
    from workbench.analysis.operating_point import OperatingPoint
    from workbench.analysis.simulate import SimulationResult, simulate
    from workbench.analysis.trim import trim
    from workbench.analysis.trim_result import TrimResult
    from workbench.analysis.zero_input import ZeroInput
    from workbench.errors import BuildError, FmuError, InputError, SimulationError, WorkbenchError
    from workbench.model import FmuModel, Model, Variable, load
    from workbench.session import Record, Session, Snapshot
    from workbench.signals import Constant, Prbs, Signal, Sine, Step, Table, parse_signal
    from workbench.workers import Workers

__version__ = "0.1.0"

__all__ = [
    "BuildError",
    "Certificate",
    "Constant",
    "Doubt",
    "FailedPoint",
    "FmuError",
    "FmuModel",
    "InputError",
    "LinComparison",
    "LinGrid",
    "LinPoint",
    "LinResult",
    "LinearModel",
    "Model",
    "NfrPoint",
    "NfrResult",
    "NfrSweep",
    "OperatingPoint",
    "Prbs",
    "Record",
    "Session",
    "Signal",
    "SimulationError",
    "SimulationResult",
    "Sine",
    "Snapshot",
    "Step",
    "StepCheck",
    "Table",
    "TrimResult",
    "Variable",
    "Verdict",
    "WorkbenchError",
    "Workers",
    "Zero",
    "ZeroInput",
    "compare",
    "lin",
    "lin_along",
    "lin_over",
    "load",
    "nfr",
    "parse_signal",
    "simulate",
    "step_check",
    "trim",
]

_HOMES = {
    "workbench.analysis.certificate": ("Certificate",),
    "workbench.analysis.lin.compare": ("LinComparison", "Verdict", "compare"),
    "workbench.analysis.lin.linearise": ("lin",),
    "workbench.analysis.lin.result": ("Doubt", "LinResult", "LinearModel", "Zero"),
    "workbench.analysis.lin.step_check": ("StepCheck", "step_check"),
    "workbench.analysis.lin.sweep": ("LinGrid", "LinPoint", "lin_along", "lin_over"),
    "workbench.analysis.nfr": ("NfrSweep", "nfr"),
    "workbench.analysis.nfr_point": ("NfrPoint",),
    "workbench.analysis.nfr_result": ("FailedPoint", "NfrResult"),
    "workbench.analysis.simulate": ("SimulationResult", "simulate"),
    "workbench.analysis.operating_point": ("OperatingPoint",),
    "workbench.analysis.trim": ("trim",),
    "workbench.analysis.trim_result": ("TrimResult",),
    "workbench.analysis.zero_input": ("ZeroInput",),
    "workbench.errors": ("BuildError", "FmuError", "InputError", "SimulationError", "WorkbenchError"),
    "workbench.model": ("FmuModel", "Model", "Variable", "load"),
    "workbench.session": ("Record", "Session", "Snapshot"),
    "workbench.signals": ("Constant", "Prbs", "Signal", "Sine", "Step", "Table", "parse_signal"),
    "workbench.workers": ("Workers",),
}
_HOME = {name: home for home, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> object:
    """Import a public name from the module it lives in."""
    if name not in _HOME:
        raise AttributeError(f"module 'workbench' has no attribute '{name}'")
    value: object = getattr(import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """List the public names."""
    return sorted([*globals(), *__all__])

"""FMI 2.0: model exchange and co-simulation."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Mapping, Sequence
from ctypes import byref
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from workbench.fmi.access import TypeCalls, VariableAccess, decode_flag, is_good
from workbench.fmi.fmpy_access import fmi2
from workbench.fmi.instance import EventInfo, Instance
from workbench.fmi.log import callbacks2
from workbench.fmi.variable import Variable

__all__ = ["Instance2"]

_INTEGER = TypeCalls("fmi2GetInteger", "fmi2SetInteger", ctypes.c_int, int, int)
_LAST_SUCCESSFUL_TIME, _TERMINATED = 2, 3  # of fmi2StatusKind
_KINDS = {"me": 0, "cs": 1}


@lru_cache(maxsize=16)
def _resources(folder: Path) -> bytes:
    return (folder / "resources").as_uri().encode()


class Instance2(Instance):
    """An instance of an FMI 2.0 FMU."""

    version: ClassVar[int] = 2
    TYPES: ClassVar[Mapping[str, TypeCalls]] = {
        "Real": TypeCalls("fmi2GetReal", "fmi2SetReal", ctypes.c_double),
        "Integer": _INTEGER,
        "Enumeration": _INTEGER,
        "Boolean": TypeCalls("fmi2GetBoolean", "fmi2SetBoolean", ctypes.c_int, decode_flag, int),
        "String": TypeCalls.text("fmi2GetString", "fmi2SetString"),
    }
    CALLS: ClassVar[Mapping[str, str]] = {
        "set_debug_logging": "fmi2SetDebugLogging",
        "terminate": "fmi2Terminate",
        "free": "fmi2FreeInstance",
        "set_time": "fmi2SetTime",
        "set_states": "fmi2SetContinuousStates",
        "get_states": "fmi2GetContinuousStates",
        "get_derivatives": "fmi2GetDerivatives",
        "get_indicators": "fmi2GetEventIndicators",
        "do_step": "fmi2DoStep",
        "get_nominals": "fmi2GetNominalsOfContinuousStates",
        "get_fmu_state": "fmi2GetFMUstate",
        "set_fmu_state": "fmi2SetFMUstate",
        "free_fmu_state": "fmi2FreeFMUstate",
    }

    def _instantiate(self, *, logging: bool) -> Any:
        return self.library["fmi2Instantiate"](
            self.log.key.encode(),
            _KINDS[self.interface],
            self.description.token.encode(),
            _resources(self.folder),
            byref(callbacks2),
            0,
            int(logging),
        )

    def enter_initialisation(self, start_time: float, tolerance: float | None) -> None:
        self.time = start_time
        use = self.interface == "cs" and tolerance is not None
        begin, stop = start_time + self.clock, self.stop
        self.call("fmi2SetupExperiment", int(use), tolerance if use else 0.0, begin, int(stop is not None), stop or 0.0)
        self.call("fmi2EnterInitializationMode")

    def exit_initialisation(self) -> None:
        self.call("fmi2ExitInitializationMode")
        self._running = True

    def enter_event_mode(self) -> None:
        self.call("fmi2EnterEventMode")

    def enter_continuous_mode(self) -> None:
        self.call("fmi2EnterContinuousTimeMode")

    def update_discrete_states(self) -> tuple[bool, EventInfo]:
        info = fmi2.fmi2EventInfo()
        self.call("fmi2NewDiscreteStates", byref(info))
        return bool(info.newDiscreteStatesNeeded), EventInfo(
            terminate=bool(info.terminateSimulation),
            states_changed=bool(info.valuesOfContinuousStatesChanged),
            nominals_changed=bool(info.nominalsOfContinuousStatesChanged),
            next_time=float(info.nextEventTime) if info.nextEventTimeDefined else math.inf,
        )

    def ended_at(self) -> float | None:
        if not self.library.has("fmi2GetBooleanStatus"):
            return None
        ended, reached = ctypes.c_int(), ctypes.c_double(self.time + self.clock)
        status = self.library["fmi2GetBooleanStatus"](self.component, _TERMINATED, byref(ended))
        if not is_good(status) or not ended.value:
            return None
        if self.library.has("fmi2GetRealStatus"):
            self.library["fmi2GetRealStatus"](self.component, _LAST_SUCCESSFUL_TIME, byref(reached))
        return max(self.time, float(reached.value) - self.clock)

    def try_input_slopes(self, access: VariableAccess, slopes: Sequence[float]) -> bool:
        if not self.library.has("fmi2SetRealInputDerivatives"):
            return False
        n = len(access.variables)
        references = (ctypes.c_uint * n)(*(v.value_reference for v in access.variables))
        orders = (ctypes.c_int * n)(*([1] * n))
        values = (ctypes.c_double * n)(*slopes)
        # Some FMUs claim to interpolate inputs but answer with an error; theirs are held then.
        function = self.library["fmi2SetRealInputDerivatives"]
        return is_good(function(self.component, references, n, orders, values))

    def directional_derivative(
        self, unknowns: Sequence[Variable], knowns: Sequence[Variable], seed: Sequence[float]
    ) -> NDArray[np.float64]:
        m, n = len(unknowns), len(knowns)
        rows = (ctypes.c_uint * m)(*(v.value_reference for v in unknowns))
        columns = (ctypes.c_uint * n)(*(v.value_reference for v in knowns))
        result = (ctypes.c_double * m)()
        self.call("fmi2GetDirectionalDerivative", rows, m, columns, n, (ctypes.c_double * n)(*seed), result)
        return np.array(result, dtype=np.float64)

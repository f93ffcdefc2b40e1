"""FMI 1.0: model exchange and co-simulation."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Mapping, Sequence
from ctypes import byref
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from workbench.errors import FmuError
from workbench.fmi.access import TypeCalls, decode_flag
from workbench.fmi.fmpy_access import fmi1
from workbench.fmi.instance import EventInfo, Instance
from workbench.fmi.log import callbacks1
from workbench.fmi.variable import Variable

__all__ = ["Instance1"]

_INTEGER = TypeCalls("fmi1GetInteger", "fmi1SetInteger", ctypes.c_int, int, int)


def _byte(value: Any) -> bytes:
    return b"\1" if value else b"\0"


class Instance1(Instance):
    """An instance of an FMI 1.0 FMU; its functions carry the prefix `fmi1` here."""

    version: ClassVar[int] = 1
    TYPES: ClassVar[Mapping[str, TypeCalls]] = {
        "Real": TypeCalls("fmi1GetReal", "fmi1SetReal", ctypes.c_double),
        "Integer": _INTEGER,
        "Enumeration": _INTEGER,
        "Boolean": TypeCalls("fmi1GetBoolean", "fmi1SetBoolean", ctypes.c_char, decode_flag, _byte),
        "String": TypeCalls.text("fmi1GetString", "fmi1SetString"),
    }
    CALLS: ClassVar[Mapping[str, str]] = {
        "set_time": "fmi1SetTime",
        "set_states": "fmi1SetContinuousStates",
        "get_states": "fmi1GetContinuousStates",
        "get_derivatives": "fmi1GetDerivatives",
        "get_indicators": "fmi1GetEventIndicators",
        "get_nominals": "fmi1GetNominalContinuousStates",
    }
    _ENDS: ClassVar[Mapping[str, tuple[str, str]]] = {
        "me": ("fmi1Terminate", "fmi1FreeModelInstance"),
        "cs": ("fmi1TerminateSlave", "fmi1FreeSlaveInstance"),
    }

    def _instantiate(self, *, logging: bool) -> Any:
        self._name_ends()
        name, token = self.log.key.encode(), self.description.token.encode()
        if self.interface == "me":
            return self.library["fmi1InstantiateModel"](name, token, callbacks1, _byte(logging))
        location, kind = self.folder.as_uri().encode(), b"application/x-fmu-sharedlibrary"
        return self.library["fmi1InstantiateSlave"](
            name, token, location, kind, 0.0, b"\0", b"\0", callbacks1, _byte(logging)
        )

    def _name_ends(self) -> None:
        """FMI 1.0 ends models and slaves with functions of different names."""
        terminate, free = self._ENDS[self.interface]
        self.CALLS = {**type(self).CALLS, "terminate": terminate, "free": free}  # type: ignore[misc]

    def enter_initialisation(self, start_time: float, tolerance: float | None) -> None:
        self.time = start_time
        self._first: Any = None
        if self.interface == "me":
            self.set_time(start_time)

    def exit_initialisation(self) -> None:
        if self.interface == "me":
            self._first = fmi1.fmi1EventInfo()
            self.call("fmi1Initialize", b"\0", 0.0, byref(self._first))
        else:
            has_stop = self.stop is not None
            self.call("fmi1InitializeSlave", self.time + self.clock, _byte(has_stop), self.stop or 0.0)
        self._running = True

    def enter_event_mode(self) -> None:
        """FMI 1.0 has no modes; `fmiEventUpdate` is the event."""

    def enter_continuous_mode(self) -> None:
        """FMI 1.0 has no modes."""

    def update_discrete_states(self) -> tuple[bool, EventInfo]:
        info, self._first = self._first, None
        if info is None:  # fmiInitialize already evaluated the first event
            info = fmi1.fmi1EventInfo()
            self.call("fmi1EventUpdate", b"\0", byref(info))
        timed = decode_flag(info.upcomingTimeEvent)
        return not decode_flag(info.iterationConverged), EventInfo(
            terminate=decode_flag(info.terminateSimulation),
            states_changed=decode_flag(info.stateValuesChanged),
            nominals_changed=decode_flag(info.stateValueReferencesChanged),
            next_time=float(info.nextEventTime) if timed else math.inf,
        )

    def get_state(self) -> Any:
        raise FmuError(f"{self.source}: FMI 1.0 cannot save an FMU's state")

    def directional_derivative(
        self, unknowns: Sequence[Variable], knowns: Sequence[Variable], seed: Sequence[float]
    ) -> NDArray[np.float64]:
        raise FmuError(f"{self.source}: FMI 1.0 has no directional derivatives")

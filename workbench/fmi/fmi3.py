"""FMI 3.0: model exchange and co-simulation."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Mapping, Sequence
from ctypes import byref
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from workbench.fmi.access import TypeCalls, decode_flag, laid_out
from workbench.fmi.fmpy_access import fmi3
from workbench.fmi.instance import EventInfo, Instance
from workbench.fmi.intermediate import Intermediate
from workbench.fmi.log import log_callback3
from workbench.fmi.ticking import Ticking
from workbench.fmi.variable import Value, Variable

__all__ = ["Instance3"]

_INTEGERS: Mapping[str, Any] = {
    "Int8": ctypes.c_int8,
    "UInt8": ctypes.c_uint8,
    "Int16": ctypes.c_int16,
    "UInt16": ctypes.c_uint16,
    "Int32": ctypes.c_int32,
    "UInt32": ctypes.c_uint32,
    "Int64": ctypes.c_int64,
    "UInt64": ctypes.c_uint64,
}


def _integer(name: str) -> TypeCalls:
    return TypeCalls(f"fmi3Get{name}", f"fmi3Set{name}", _INTEGERS[name], int, int)


class Instance3(Instance):
    """An instance of an FMI 3.0 FMU."""

    version: ClassVar[int] = 3
    TYPES: ClassVar[Mapping[str, TypeCalls]] = {
        "Float64": TypeCalls("fmi3GetFloat64", "fmi3SetFloat64", ctypes.c_double),
        "Float32": TypeCalls("fmi3GetFloat32", "fmi3SetFloat32", ctypes.c_float),
        **{name: _integer(name) for name in _INTEGERS},
        "Enumeration": _integer("Int64"),
        "Boolean": TypeCalls("fmi3GetBoolean", "fmi3SetBoolean", ctypes.c_bool, decode_flag, bool),
        "String": TypeCalls.text("fmi3GetString", "fmi3SetString"),
    }
    CALLS: ClassVar[Mapping[str, str]] = {
        "set_debug_logging": "fmi3SetDebugLogging",
        "terminate": "fmi3Terminate",
        "free": "fmi3FreeInstance",
        "set_time": "fmi3SetTime",
        "set_states": "fmi3SetContinuousStates",
        "get_states": "fmi3GetContinuousStates",
        "get_derivatives": "fmi3GetContinuousStateDerivatives",
        "get_indicators": "fmi3GetEventIndicators",
        "do_step": "fmi3DoStep",
        "get_nominals": "fmi3GetNominalsOfContinuousStates",
        "get_fmu_state": "fmi3GetFMUState",
        "set_fmu_state": "fmi3SetFMUState",
        "free_fmu_state": "fmi3FreeFMUState",
    }

    def _instantiate(self, *, logging: bool) -> Any:
        self._callback = log_callback3(self.log)  # kept alive as long as the instance
        resources = str(self.folder / "resources") + "/"
        name, token = self.log.key.encode(), self.description.token.encode()
        common = (name, token, resources.encode(), False, logging)
        if self.interface == "me":
            return self.library["fmi3InstantiateModelExchange"](*common, None, self._callback)
        references = sorted(self.description.intermediate)
        asks = self.capabilities.intermediate_update and self._answerer is not None and bool(references)
        self._intermediate = Intermediate() if asks else None
        update = fmi3.fmi3IntermediateUpdateCallback(*([self._answerer] if asks else []))
        event_mode = self.event_mode
        return self.library["fmi3InstantiateCoSimulation"](
            *common,
            event_mode,
            event_mode,
            (ctypes.c_uint * len(references))(*references) if asks else None,
            len(references) if asks else 0,
            None if self._intermediate is None else ctypes.addressof(self._intermediate),
            self._callback,
            update,
        )

    _intermediate: Intermediate | None = None

    @property
    def intermediate(self) -> Intermediate | None:
        return self._intermediate

    def configure(self, variables: Sequence[Variable], values: Sequence[Value]) -> None:
        self.call("fmi3EnterConfigurationMode")
        for variable, value in zip(variables, values, strict=True):  # the Reference FMUs take one in a call
            self.access([variable]).write([value])
        self.call("fmi3ExitConfigurationMode")

    _ticking: Ticking | None = None

    @property
    def clocks_address(self) -> int | None:
        return None if self._ticking is None else self._ticking.address

    @property
    def ticks_so_far(self) -> tuple[Any, Mapping[str, int]] | None:
        return None if self._ticking is None else (self._ticking.counts, self._ticking.places)

    def enter_initialisation(self, start_time: float, tolerance: float | None) -> None:
        self.time = start_time
        use = self.interface == "cs" and tolerance is not None
        begin, stop = start_time + self.clock, self.stop
        known = tolerance if use else 0.0
        self.call("fmi3EnterInitializationMode", use, known, begin, stop is not None, stop or 0.0)
        clocks = self.description.clocks if self.event_mode else {}
        self._ticking = Ticking(clocks, self.call, self.description.model_name) if clocks else None

    def exit_initialisation(self) -> None:
        if self._ticking is not None:
            self._ticking.start(self.time)
        self.call("fmi3ExitInitializationMode")
        self._running = True
        if self.interface == "me":
            self._count_again()
        if self._ticking is not None:
            self._ticking.tick(self.time)

    def _count_again(self) -> None:
        """Take the run-time sizes: structural parameters may change the declared ones."""
        nx, nz = ctypes.c_size_t(self.nx), ctypes.c_size_t(self.nz)
        if self.library.has("fmi3GetNumberOfContinuousStates"):
            self.call("fmi3GetNumberOfContinuousStates", byref(nx))
        if self.library.has("fmi3GetNumberOfEventIndicators"):
            self.call("fmi3GetNumberOfEventIndicators", byref(nz))
        self._size_buffers(nx.value, nz.value)

    def enter_event_mode(self) -> None:
        self.call("fmi3EnterEventMode")
        if self._ticking is not None:
            self._ticking.tick(self.time)

    def enter_continuous_mode(self) -> None:
        self.call("fmi3EnterContinuousTimeMode")

    def enter_step_mode(self) -> None:
        self.call("fmi3EnterStepMode")

    def update_discrete_states(self) -> tuple[bool, EventInfo]:
        flags = [ctypes.c_bool() for _ in range(5)]
        time = ctypes.c_double(math.inf)
        if self._ticking is not None:
            self._ticking.listen()
        self.call("fmi3UpdateDiscreteStates", *(byref(f) for f in flags), byref(time))
        again, terminate, nominals, states, timed = (bool(f.value) for f in flags)
        due = time.value - self.clock if timed else math.inf
        if self._ticking is not None:
            self._ticking.ask(self.time)
            due = due if math.isnan(due) else min(due, self._ticking.next_tick)
        return again, EventInfo(terminate, states, nominals, due)

    def get_state(self) -> Any:
        state = super().get_state()
        if self._ticking is not None:
            state.ticks = self._ticking.saved()
        return state

    def set_state(self, state: Any) -> None:
        super().set_state(state)
        if self._ticking is not None:
            self._ticking.restore(state.ticks)

    def directional_derivative(
        self, unknowns: Sequence[Variable], knowns: Sequence[Variable], seed: Sequence[float]
    ) -> NDArray[np.float64]:
        return self._product("fmi3GetDirectionalDerivative", (unknowns, knowns), seed, adjoint=False)

    def adjoint_derivative(
        self, unknowns: Sequence[Variable], knowns: Sequence[Variable], seed: Sequence[float]
    ) -> NDArray[np.float64]:
        return self._product("fmi3GetAdjointDerivative", (unknowns, knowns), seed, adjoint=True)

    def _product(
        self, name: str, ends: tuple[Sequence[Variable], Sequence[Variable]], seed: Sequence[float], *, adjoint: bool
    ) -> NDArray[np.float64]:
        """Return a product with the Jacobian, of whole arrays; unknowns and knowns may be elements of them."""
        unknowns, knowns = ends
        rows, row_slots, m = laid_out(self.description.shapes, unknowns)
        columns, column_slots, n = laid_out(self.description.shapes, knowns)
        given, taken = (row_slots, column_slots) if adjoint else (column_slots, row_slots)
        seeds, result = np.zeros(m if adjoint else n), np.zeros(n if adjoint else m)
        np.add.at(seeds, given, seed)
        self.call(
            name,
            (ctypes.c_uint * len(rows))(*rows),
            len(rows),
            (ctypes.c_uint * len(columns))(*columns),
            len(columns),
            seeds.ctypes.data_as(_DOUBLES),
            len(seeds),
            result.ctypes.data_as(_DOUBLES),
            len(result),
        )
        return result[taken]


_DOUBLES = ctypes.POINTER(ctypes.c_double)

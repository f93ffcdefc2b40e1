"""One living instance of an FMU behind one façade for FMI 1.0, 2.0 and 3.0."""

from __future__ import annotations

import ctypes
import math
import re
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from ctypes import byref
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, NoReturn

import numpy as np
from numpy.typing import NDArray

from workbench.errors import FmuError, InputError, SimulationError
from workbench.fmi.access import TypeCalls, VariableAccess, is_good
from workbench.fmi.c_array import array_type, c_array
from workbench.fmi.description import Capabilities, ModelDescription
from workbench.fmi.ended import are_waiting, end, end_now
from workbench.fmi.intermediate import Intermediate
from workbench.fmi.library import Library, load_alone, load_library
from workbench.fmi.log import InstanceLog, open_log
from workbench.fmi.platforms import binary_path
from workbench.fmi.variable import Value, Variable
from workbench.fmi.wiring import Wiring

__all__ = [
    "NO_EVENT",
    "DiscardError",
    "EventInfo",
    "Instance",
    "loaded",
    "no_event_time",
]

DISCARD, ERROR, FATAL = 2, 3, 4
_STATUS = {2: "discard", 3: "error", 4: "fatal error", 5: "pending"}
_OTHER_WAY = " (with interface me the workbench integrates in its place)"
_TROUBLE = re.compile("error|fatal|warning|discard", re.IGNORECASE)
MAX_EVENT_ITERATIONS = 1000
_EVENT_UPDATE = {1: "fmiEventUpdate", 2: "fmi2NewDiscreteStates", 3: "fmi3UpdateDiscreteStates"}


class DiscardError(SimulationError):
    """The FMU discarded a call (status "discard"): other values may be acceptable to it."""


@dataclass(frozen=True)
class EventInfo:
    """What an event iteration ended with.

    Attributes:
        terminate: the FMU wants the simulation to end.
        states_changed: the continuous states jumped; read them again.
        nominals_changed: their nominal values changed.
        next_time: next time event [s], `math.inf` if none.
    """

    terminate: bool
    states_changed: bool
    nominals_changed: bool
    next_time: float


MOST_VALUES = 10_000_000  # of states, or of event indicators: more is a mistake

NO_EVENT = EventInfo(terminate=False, states_changed=False, nominals_changed=False, next_time=math.inf)


class Instance(ABC):
    """One instance.

    Obligations of the caller, in this order:
      1. Construct: the FMU is instantiated.
      2. `configure` where sizes are others. Write start values; `enter_initialisation`; write inputs;
         `exit_initialisation`.
         Model exchange, and co-simulation with `event_mode`, is then in event mode.
      3. Model exchange: `iterate_events`, `enter_continuous_mode`; then `set_time`,
         `set_states`, continuous inputs, `get_…` in any number; the FMU's own function for a completed
         step after each accepted step (the kernel calls it); `enter_event_mode` before an event iteration.
         Co-simulation: with `event_mode`, `iterate_events`, `enter_step_mode`; then its steps (the kernel makes them).
      4. `close`, in any situation, any number of times; nothing may be called after it.
    `clock` may be set before initialisation, in co-simulation: the FMU's own time is that much later than what is said
    here [s]. So may `stop`, the stop time that it is told, in its own time [s]; None: none.
    Guarantees:
      1. Nothing is printed; log lines are in `log` and the last ones in every error's message.
      2. A status worse than "warning" is a SimulationError (DiscardError for "discard") with the
         time of the last `set_time` or step.
      3. `x`, `dx`, `z` are views of buffers the FMU writes to; they change with the next call.
      4. `close` frees the instance except after a fatal error, when FMI forbids it.

    `update` is the address of a C function that answers an FMU of FMI 3.0 which asks for inputs inside a step.

    Attributes:
        event_mode: model exchange, and co-simulation that was instantiated with event mode.
        saved: number of states of it that are kept, a C int32: while there are any, it may be taken back.
        remark: what the user should know about how it was instantiated; empty where all went as declared.
    """

    version: ClassVar[int]
    CALLS: ClassVar[Mapping[str, str]]
    TYPES: ClassVar[Mapping[str, TypeCalls]]
    library: Library
    log: InstanceLog
    remark: str = ""

    def __init__(
        self,
        description: ModelDescription,
        folder: Path,
        *,
        interface: str,
        source: str,
        library: Library | None = None,
        event_mode: bool = True,
        update: int | None = None,
    ) -> None:
        self._answerer = update
        self._setup(description, library or loaded(description, folder, interface, source), interface=interface)
        self.event_mode = interface == "me" or (self.capabilities.event_mode and event_mode)
        self.source = source
        self.folder = folder if folder.is_absolute() else folder.resolve()
        self.component: Any = self._made(logging=False)
        if not self.component and interface == "cs" and self.event_mode:
            self._instantiate_without_event_mode()
        if not self.component and are_waiting():
            # Some allow one instance only without saying so; one that waits for its end may stand in the way.
            end_now()
            self.component = self._made(logging=False)
        if not self.component:
            # Many FMUs say why only if logging is on; only then is the noise wanted.
            self.component = self._made(logging=True)
        self._require_component()
        if not self._log_trouble():
            # Files name categories that the binary refuses, some going to an error state for it.
            self.library[self.CALLS["free"]](self.component)
            self.log.lines.clear()
            if self.capabilities.once_per_process:
                self.library.close()
                self.library = loaded(description, folder, interface, source)
            self.component = self._made(logging=False)
            self._require_component()

    def _require_component(self) -> None:
        if not self.component:
            self._closed = True
            self.library.close()
            raise FmuError(f"{self.source}: the FMU cannot be instantiated{self.log.tail()}")

    def _made(self, *, logging: bool) -> Any:
        component = self._instantiate(logging=logging)
        self.library.reclaim_key()
        return component

    def _instantiate_without_event_mode(self) -> None:
        """Try again without event mode, which is the caller's choice in FMI 3.0 (4.2.1)."""
        self.event_mode = False
        self.component = self._made(logging=False)
        if self.component:
            self.remark = "the FMU declares event mode but cannot be instantiated with it; it runs without"
        else:
            self.event_mode = True

    def _log_trouble(self) -> bool:
        """Switch on the log categories that tell of trouble, and no others: they cost no time."""
        names = [c for c in self.description.log_categories if _TROUBLE.search(c)]
        function = self.CALLS.get("set_debug_logging")
        if not (names and function and self.library.has(function)):
            return True
        texts = c_array(ctypes.c_char_p, [n.encode() for n in names])
        return is_good(self.library[function](self.component, True, len(names), texts))

    def _setup(self, description: ModelDescription, library: Library, *, interface: str) -> None:
        self.description = description
        self.capabilities: Capabilities = description.interfaces[interface]
        self.interface = interface
        self.library = library
        self.log = open_log(description.model_name)
        self.event_mode = interface == "me" or self.capabilities.event_mode
        self.time = self.clock = 0.0
        self.stop: float | None = None
        self._worst = 0
        self._running = False
        self._closed = False
        self._size_buffers(description.state_count, description.indicator_count)

    def _size_buffers(self, nx: int, nz: int) -> None:
        if min(nx, nz) < 0 or max(nx, nz) > MOST_VALUES:
            counts = f"{nx} continuous states and {nz} event indicators"
            raise FmuError(f"{self.description.model_name}: claims {counts}; only 0 to {MOST_VALUES} are possible")
        self.nx, self.nz = nx, nz
        self._xbuf, self.x = _buffer(nx)
        self._dxbuf, self.dx = _buffer(nx)
        self._zbuf, self.z = _buffer(nz)

    # -- status ---------------------------------------------------------------------------

    def call(self, name: str, *arguments: Any) -> None:
        """Call an FMI function of this instance and check its status."""
        status = self.library[name](self.component, *arguments)
        if not is_good(status):
            self.fail(name, status)

    def fail(self, name: str, status: int) -> NoReturn:
        """Raise for a bad status."""
        self._worst = max(self._worst, status if 0 <= status <= FATAL else ERROR)
        kind = DiscardError if status == DISCARD else SimulationError
        steps = name == self.CALLS.get("do_step") and kind is SimulationError
        way = _OTHER_WAY if steps and "me" in self.description.interfaces else ""
        name = name.replace("fmi1", "fmi")
        raise kind(
            f"{self.description.model_name}: {name} returned {_STATUS.get(status, status)}{way}{self.log.tail()}",
            time=self.time,
        )

    @property
    def clocks_address(self) -> int | None:
        """Where the memory of the clocks is that the importer lets tick; None: it has none."""
        return None

    @property
    def ticks_so_far(self) -> tuple[Any, Mapping[str, int]] | None:
        """How often each clock has ticked, an array of c_double, and where a clock stands in it; None: none can."""
        return None

    @property
    def intermediate(self) -> Intermediate | None:
        """What its callback for inputs between communication points works on; None: it does not ask."""
        return None

    @property
    def longest_address(self) -> int | None:
        """Where it says how long the next step of a solver may be [s], a C double; None: it does not mind."""
        return None

    @property
    def has_history(self) -> bool:
        """Whether it shows what its inputs were some time before, which its states do not tell; a saved state does."""
        return self.description.has_history or any(part.has_history for part in self.parts if part is not self)

    @property
    def healthy(self) -> bool:
        """Whether it lives and no call has failed for good."""
        return not self._closed and self._worst < ERROR

    # -- systems ----------------------------------------------------------------------------

    @property
    def parts(self) -> tuple[Instance, ...]:
        """The instances that this one consists of; only a system has several."""
        return (self,)

    @property
    def wiring(self) -> Wiring | None:
        """How the parts are connected; None: there is nothing to connect."""
        return None

    def ports(self, variable: Variable) -> tuple[tuple[int, Variable], ...]:
        """Return where a variable is found: parts' numbers and variables; all are written, the first is read."""
        return ((0, variable),)

    def fed(self, variable: Variable) -> bool:
        """Return whether it is an input that another part of a system drives."""
        return False

    # -- access to variables --------------------------------------------------------------

    def access(self, variables: Sequence[Variable]) -> VariableAccess:
        """Return prepared access to `variables`; the FMU is not called yet."""
        return VariableAccess(self, variables)

    # -- life cycle -----------------------------------------------------------------------

    @abstractmethod
    def _instantiate(self, *, logging: bool) -> Any:
        """Return the component, None if the FMU refuses."""

    def configure(self, variables: Sequence[Variable], values: Sequence[Value]) -> None:
        """Set structural parameters, before anything else: sizes of arrays follow from them."""
        raise InputError(f"{self.source}: FMI {self.description.fmi_version} has no structural parameters")

    @abstractmethod
    def enter_initialisation(self, start_time: float, tolerance: float | None) -> None:
        """Enter initialisation at `start_time` [s]; co-simulation is told `tolerance`."""

    @abstractmethod
    def exit_initialisation(self) -> None:
        """Leave initialisation; the first event iteration comes next (see obligation 3)."""

    def close(self) -> None:
        """Terminate if that is allowed, then free: at once, or later where `end_later` asked for it."""
        if self._closed:
            return
        self._closed = True
        end(self._end)

    def _end(self) -> None:
        if self._worst >= FATAL:
            return
        if self._running and self._worst < ERROR:
            self.library[self.CALLS["terminate"]](self.component)
        self.library[self.CALLS["free"]](self.component)
        self.library.close()

    # -- model exchange -------------------------------------------------------------------

    def set_time(self, time: float) -> None:
        """Set the independent variable [s]."""
        self.time = time
        self.call(self.CALLS["set_time"], time)

    def set_states(self) -> None:
        """Give the FMU the states that stand in `x`."""
        if self.nx:
            self.call(self.CALLS["set_states"], self._xbuf, self.nx)

    def get_states(self) -> None:
        """Read the states into `x`."""
        if self.nx:
            self.call(self.CALLS["get_states"], self._xbuf, self.nx)

    def get_derivatives(self) -> None:
        """Read the derivatives into `dx`."""
        if self.nx:
            self.call(self.CALLS["get_derivatives"], self._dxbuf, self.nx)

    def get_indicators(self) -> None:
        """Read the event indicators into `z`."""
        if self.nz:
            self.call(self.CALLS["get_indicators"], self._zbuf, self.nz)

    def get_nominals(self) -> NDArray[np.float64]:
        """Return the nominal values of the states as the FMU gives them, shape (nx,)."""
        buffer, view = _buffer(self.nx)
        view[:] = 1.0
        if self.nx and self.library.has(self.CALLS["get_nominals"]):
            self.call(self.CALLS["get_nominals"], buffer, self.nx)
        return view

    @abstractmethod
    def enter_event_mode(self) -> None:
        """Enter event mode."""

    @abstractmethod
    def enter_continuous_mode(self) -> None:
        """Leave event mode (model exchange)."""

    @abstractmethod
    def update_discrete_states(self) -> tuple[bool, EventInfo]:
        """Evaluate the event once; the first value says whether it must be called again."""

    def iterate_events(self) -> EventInfo:
        """Iterate in event mode until nothing changes.

        Raises:
            SimulationError: it does not settle.
        """
        states = nominals = False
        for _ in range(MAX_EVENT_ITERATIONS):
            again, info = self.update_discrete_states()
            if math.isnan(info.next_time):
                raise no_event_time(self)
            states |= info.states_changed
            nominals |= info.nominals_changed
            if not again or info.terminate:
                return EventInfo(info.terminate, states, nominals, info.next_time)
        raise SimulationError(
            f"{self.description.model_name}: event iteration does not settle after {MAX_EVENT_ITERATIONS} rounds",
            time=self.time,
        )

    # -- co-simulation --------------------------------------------------------------------

    def ended_at(self) -> float | None:
        """Return when the FMU ended its run inside the step that it has just discarded [s]; None: it did not."""
        return None

    def enter_step_mode(self) -> None:
        """Leave event mode (co-simulation with `event_mode`)."""
        raise FmuError(f"{self.source}: FMI {self.description.fmi_version} has no step mode")

    def place_states(self, values: Mapping[str, float]) -> bool:
        """Set continuous states by name between steps; False: there is no way. An event iteration comes next."""
        return False

    def try_input_slopes(self, access: VariableAccess, slopes: Sequence[float]) -> bool:
        """Give the time derivatives of real inputs [1/s] for the next step; False: it cannot."""
        return False

    # -- FMU state ------------------------------------------------------------------------

    @cached_property
    def saved(self) -> ctypes.c_int32:
        # Without any, each step is made with noSetFMUStatePriorToCurrentPoint (FMI 2.0.4, 4.2.2), as by FMPy and
        # OMSimulator: some FMUs take a step without that promise for one that is to be repeated.
        return ctypes.c_int32(0)

    def get_state(self) -> Any:
        """Return a new FMU state; give it back with `free_state`."""
        state = ctypes.c_void_p()
        self.call(self.CALLS["get_fmu_state"], byref(state))
        self.saved.value += 1
        return state

    def set_state(self, state: Any) -> None:
        """Go back to an FMU state."""
        self.call(self.CALLS["set_fmu_state"], state)

    def free_state(self, state: Any) -> None:
        """Free an FMU state; allowed after an error too, and nothing can be done if it fails."""
        self.saved.value -= 1
        if not self._closed and self._worst < FATAL:
            self.library[self.CALLS["free_fmu_state"]](self.component, byref(state))

    @abstractmethod
    def directional_derivative(
        self, unknowns: Sequence[Variable], knowns: Sequence[Variable], seed: Sequence[float]
    ) -> NDArray[np.float64]:
        """Return Σ ∂unknown/∂known · seed over `knowns`, shape (len(unknowns),)."""

    def adjoint_derivative(
        self, unknowns: Sequence[Variable], knowns: Sequence[Variable], seed: Sequence[float]
    ) -> NDArray[np.float64]:
        """Return Σ seed · ∂unknown/∂known over `unknowns`, shape (len(knowns),)."""
        raise FmuError(f"{self.source}: FMI {self.description.fmi_version} has no adjoint derivatives")


def loaded(description: ModelDescription, folder: Path, interface: str, source: str) -> Library:
    """Return the binary of an FMU; of one that may be instantiated only once per process, one for this instance."""
    claims = description.interfaces[interface]
    path = binary_path(folder, claims.identifier, source=source)
    if claims.once_per_process:
        end_now()
    load = load_alone if claims.once_per_process else load_library
    return load(path, version=description.major, interface=interface, identifier=claims.identifier)


def no_event_time(instance: Instance) -> SimulationError:
    """Return the error for a next event time that is not a number."""
    name, function = instance.description.model_name, _EVENT_UPDATE[instance.version]
    return SimulationError(f"{name}: the next event time that {function} gave is not a number", time=instance.time)


def _buffer(size: int) -> tuple[Any, NDArray[np.float64]]:
    """Return a C array of doubles and a NumPy view of it, shape (size,)."""
    buffer = array_type(ctypes.c_double, max(size, 1))()
    view: NDArray[np.float64] = np.ctypeslib.as_array(buffer)[:size]
    return buffer, view

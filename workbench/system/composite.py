"""Several instances with connections that behave as one: the façade that sessions and points work on."""

# ruff: noqa: ANN401 - saved states and C buffers have no type
from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from workbench.core.values.arrays import Floats
from workbench.core.values.calendar import gathered
from workbench.errors import SimulationError, WorkbenchError
from workbench.fmi.access import TypeCalls, VariableAccess
from workbench.fmi.binding import VERSIONS
from workbench.fmi.description import ModelDescription
from workbench.fmi.instance import MAX_EVENT_ITERATIONS, EventInfo, Instance, no_event_time
from workbench.fmi.library import Library
from workbench.fmi.variable import Value, Variable
from workbench.fmi.wiring import Wiring
from workbench.session.evaluated_point import named_states
from workbench.session.forcing import convert, fitting
from workbench.system.propagation import Propagation
from workbench.system.tangent import SystemJacobian

__all__ = ["CompositeAccess", "CompositeInstance", "Ports", "next_event"]

Ports = Mapping[str, tuple[tuple[int, Variable], ...]]

MAX_INITIAL_ROUNDS = 50
SAME = 1e-9  # relative: initial values that move less have settled
# Relative: what ticks anew forgets how it came to rest, and a circle would go round in the last digits for ever.
ROUNDED = 4.0 * float(np.finfo(np.float64).eps)


def next_event(due: Iterable[float], wiring: Wiring, now: float) -> float:
    """Return the next instant at which a part is due or a connection closes [s]; what is overdue is due now.

    Args:
        due: next time events of the parts [s].
        wiring: their connections.
        now: [s].
    """
    return gathered([*(max(t, now) for t in due), *wiring.switches_after(now)], now)


@dataclass(frozen=True, eq=False)
class _CompositeState:
    """A saved state: those of the parts, and what stands on the connections."""

    parts: tuple[Any, ...]
    values: Floats
    sizes: Floats
    closed: NDArray[np.int32]
    events: bool


class CompositeInstance(Instance):
    """Model exchange instances under one façade: states and event indicators one after the other.

    Values on connections are passed on when something is read that may depend on them. A part is in event
    mode when all are. Variables are "component.variable", besides the system's own inputs and outputs.

    Args:
        parts: new instances; this one owns them from now on.
        wiring: their connections.
        description: of the system.
        ports: name of a variable of the system → the parts that have it.
        source: what the user named.
    """

    version: ClassVar[int] = 2
    TYPES: ClassVar[Mapping[str, TypeCalls]] = {k: v for i in VERSIONS.values() for k, v in i.TYPES.items()}
    CALLS: ClassVar[Mapping[str, str]] = {}  # its parts have C functions

    def __init__(
        self, parts: Sequence[Instance], wiring: Wiring, description: ModelDescription, ports: Ports, *, source: str
    ) -> None:
        self._parts = tuple(parts)
        self._wiring = wiring
        self._ports = ports
        self._propagation = Propagation(self._parts, wiring)
        self.source, self.folder = source, parts[0].folder
        self.component: Any = None
        self._setup(description, Library({}), interface="me")
        self._events, self._stale = False, True
        self._due = [-math.inf] * len(self._parts)  # next time events
        self._before: dict[int, Any] = {}  # parts in circles, saved before they evaluated the present event

    @property
    def parts(self) -> tuple[Instance, ...]:
        return self._parts

    @property
    def wiring(self) -> Wiring:
        return self._wiring

    def ports(self, variable: Variable) -> tuple[tuple[int, Variable], ...]:
        return self._ports[variable.name]

    def fed(self, variable: Variable) -> bool:
        return any((c.to_component, c.destination) in self.ports(variable) for c in self._wiring.connections)

    def _instantiate(self, *, logging: bool) -> Any:
        return self._parts  # they are made by the model

    @property
    def healthy(self) -> bool:
        return not self._closed and all(p.healthy for p in self._parts)

    def close(self) -> None:
        if not self._closed:
            self._closed = True
            for part in self._parts:
                part.close()

    # -- connections ------------------------------------------------------------------------

    def touch(self) -> None:
        """Note that something was written: connected values may be others now."""
        self._stale = True

    def refresh(self) -> None:
        """Pass on what is connected, if something was written since."""
        if self._stale:
            self._propagation.run(self.time, events=self._events)
            self._stale = False

    def access(self, variables: Sequence[Variable]) -> VariableAccess:
        return CompositeAccess(self, variables)

    # -- initialisation ---------------------------------------------------------------------

    def configure(self, variables: Sequence[Variable], values: Sequence[Value]) -> None:
        of_parts: dict[int, list[tuple[Variable, Value]]] = {}
        for variable, value in zip(variables, values, strict=True):
            for part, own in self.ports(variable):
                of_parts.setdefault(part, []).append((own, value))
        for part, pairs in of_parts.items():
            self._parts[part].configure([own for own, _ in pairs], [value for _, value in pairs])

    def enter_initialisation(self, start_time: float, tolerance: float | None) -> None:
        self.time = start_time
        self._wiring.switch(start_time)
        for part in self._parts:
            part.enter_initialisation(start_time, tolerance)

    def exit_initialisation(self) -> None:
        self._settle_initially()
        for part in self._parts:
            part.exit_initialisation()
        self._size_buffers(sum(p.nx for p in self._parts), sum(p.nz for p in self._parts))
        self._events = self._stale = True

    def _settle_initially(self) -> None:
        """Pass values on until they stand: in initialisation outputs may depend on inputs by way of states, too."""
        before = self._wiring.values.copy()
        for _ in range(MAX_INITIAL_ROUNDS):
            self._propagation.run(self.time, events=True, initial=True)
            now = self._wiring.values
            if np.allclose(now, before, rtol=SAME, atol=SAME * 1e-3 * float(np.max(np.abs(now), initial=0.0))):
                return
            before = now.copy()
        raise self._unsettled("the connected values do not converge in initialisation")

    # -- continuous time --------------------------------------------------------------------

    def set_time(self, time: float) -> None:
        self.time = time
        for part in self._parts:
            part.set_time(time)
        self._stale = True

    def set_states(self) -> None:
        for part, x in zip(self._parts, self._split(self.x), strict=True):
            part.x[:] = x
            part.set_states()
        self._stale = True

    def get_states(self) -> None:
        for part, x in zip(self._parts, self._split(self.x), strict=True):
            part.get_states()
            x[:] = part.x

    def get_derivatives(self) -> None:
        self.refresh()
        for part, dx in zip(self._parts, self._split(self.dx), strict=True):
            part.get_derivatives()
            dx[:] = part.dx

    def get_indicators(self) -> None:
        self.refresh()
        begin = 0
        for part in self._parts:
            part.get_indicators()
            self.z[begin : begin + part.nz] = part.z
            begin += part.nz

    def get_nominals(self) -> Floats:
        return np.concatenate([p.get_nominals() for p in self._parts])

    def _split(self, values: Floats) -> list[Floats]:
        ends = np.cumsum([p.nx for p in self._parts])
        return [values[end - p.nx : end] for p, end in zip(self._parts, ends, strict=True)]

    def place_states(self, values: Mapping[str, float]) -> bool:
        names = [v.name for v in named_states(self)]
        if not any(name in values for name in names):
            return False
        self.get_states()
        self.x[:] = [values.get(name, x) for name, x in zip(names, self.x.tolist(), strict=True)]
        self.set_states()
        return True

    # -- events -----------------------------------------------------------------------------

    def enter_event_mode(self) -> None:
        for part in self._parts:
            part.enter_event_mode()
        self._wiring.switch(self.time)
        self._events = self._stale = True

    def enter_continuous_mode(self) -> None:
        for part in self._parts:
            part.enter_continuous_mode()
        self._events, self._stale = False, True

    def update_discrete_states(self) -> tuple[bool, EventInfo]:
        answers = [self._update(number) for number in self._wiring.order]
        infos = [info for _, info in answers]
        self._stale = True
        return any(again for again, _ in answers), EventInfo(
            terminate=any(i.terminate for i in infos),
            states_changed=any(i.states_changed for i in infos),
            nominals_changed=any(i.nominals_changed for i in infos),
            next_time=next_event((i.next_time for i in infos), self._wiring, self.time),
        )

    def _update(self, number: int) -> tuple[bool, EventInfo]:
        """Let one part handle the event, with what those before it show since they did."""
        self.refresh()
        anew = self._ticks_anew(number)
        again, info = self._parts[number].update_discrete_states()
        if math.isnan(info.next_time):
            raise no_event_time(self._parts[number])
        before, self._due[number] = self._due[number], info.next_time
        # Where it is not known when its event was due, it was due now if there is a next one.
        due = before <= self.time and min(abs(before), info.next_time) < math.inf
        self._stale = anew or again or info.states_changed or due
        return again, info

    def _ticks_anew(self, number: int) -> bool:
        """Save what ticks now in a circle; take it back, which is True, if it has ticked with other inputs."""
        if number not in self._before and not self._may_tick_anew(number):
            return False
        part, wiring = self._parts[number], self._wiring
        mine = [w for w, c in enumerate(wiring.connections) if c.to_component == number]
        seen, now = wiring.seen[mine], wiring.values[mine]
        again = number in self._before and not np.allclose(seen, now, rtol=ROUNDED, atol=0.0)
        if again:
            part.set_state(self._before[number])
            ends = [wiring.connections[w].destination for w in mine]
            part.access(ends).write([convert(v, float(wiring.values[w])) for v, w in zip(ends, mine, strict=True)])
        elif number not in self._before:
            with suppress(WorkbenchError):  # one that claims to and does not ticks with what it sees first
                self._before[number] = part.get_state()
        wiring.seen[mine] = wiring.values[mine]
        return again

    def _may_tick_anew(self, number: int) -> bool:
        part = self._parts[number]
        able = part.capabilities.state and part.clocks_address is None
        return able and self._wiring.in_circle[number] and self._due[number] <= self.time

    def iterate_events(self) -> EventInfo:
        """Iterate until no part wants another round and no connected value changes."""
        try:
            return self._rounds()
        finally:
            for number, state in self._before.items():
                self._parts[number].free_state(state)
            self._before.clear()

    def _rounds(self) -> EventInfo:
        states = nominals = False
        for _ in range(MAX_EVENT_ITERATIONS):
            self.refresh()
            before = self._wiring.values.copy()
            again, info = self.update_discrete_states()
            states |= info.states_changed
            nominals |= info.nominals_changed
            self.refresh()
            moved = not np.array_equal(before, self._wiring.values)
            if info.terminate or not (again or moved):
                return EventInfo(info.terminate, states, nominals, info.next_time)
        raise self._unsettled(f"event iteration does not settle after {MAX_EVENT_ITERATIONS} rounds")

    def _unsettled(self, words: str) -> SimulationError:
        circle = [p.description.model_name for p, c in zip(self._parts, self._wiring.in_circle, strict=True) if c]
        advice = f"; {', '.join(circle)} act on each other within one sample: put the delay of a sample between them"
        return SimulationError(f"{self.description.model_name}: {words}{advice if circle else ''}", time=self.time)

    # -- saved states -----------------------------------------------------------------------

    def get_state(self) -> Any:
        self.refresh()
        wiring = self._wiring
        return _CompositeState(
            parts=tuple(p.get_state() for p in self._parts),
            values=wiring.values.copy(),
            sizes=wiring.sizes.copy(),
            closed=wiring.closed.copy(),
            events=self._events,
        )

    def set_state(self, state: Any) -> None:
        for part, saved in zip(self._parts, state.parts, strict=True):
            part.set_state(saved)
        wiring = self._wiring
        wiring.values[:], wiring.sizes[:], wiring.closed[:] = state.values, state.sizes, state.closed
        wiring.forget()
        self._events, self._stale = state.events, True
        self._due = [-math.inf] * len(self._parts)

    def free_state(self, state: Any) -> None:
        for part, saved in zip(self._parts, state.parts, strict=True):
            part.free_state(saved)

    # -- derivatives ------------------------------------------------------------------------

    def directional_derivative(
        self, unknowns: Sequence[Variable], knowns: Sequence[Variable], seed: Sequence[float]
    ) -> Floats:
        self.refresh()
        tangent = SystemJacobian(self._parts, self._wiring)
        moved = [(port, s) for v, s in zip(knowns, seed, strict=True) for port in self.ports(v)]
        return tangent.along(moved, [self.ports(v)[0] for v in unknowns])


# -- reading and writing variables of a system: each part reads and writes its own -----------------


class CompositeAccess(VariableAccess):
    """Variables of several parts in one list; a system's input is written to all that it drives."""

    def __init__(self, instance: CompositeInstance, variables: Sequence[Variable]) -> None:
        self.variables = tuple(variables)
        self.blocks, self.order = [], []  # those of the parts' own accesses
        self._instance = instance
        ports = [instance.ports(v) for v in self.variables]
        self._readers = self._group([(p[0], i) for i, p in enumerate(ports)])
        self._writers = self._group([(port, i) for i, p in enumerate(ports) for port in p])

    def _group(self, pairs: Sequence[tuple[tuple[int, Variable], int]]) -> list[tuple[VariableAccess, list[int]]]:
        """Return for each part its access, and where its variables stand in the list."""
        result = []
        for part in dict.fromkeys(number for (number, _), _ in pairs):
            own = [(variable, i) for (number, variable), i in pairs if number == part]
            access = self._instance.parts[part].access([v for v, _ in own])
            result.append((access, [i for _, i in own]))
        return result

    def read(self) -> list[Any]:
        self._instance.refresh()
        values: list[Any] = [None] * len(self.variables)
        for access, indices in self._readers:
            for i, value in zip(indices, access.read(), strict=True):
                values[i] = value
        return values

    def write(self, values: Sequence[Value]) -> None:
        for access, indices in self._writers:
            access.write([fitting(v, values[i]) for v, i in zip(access.variables, indices, strict=True)])
        self._instance.touch()

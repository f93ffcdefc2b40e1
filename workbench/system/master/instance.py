"""A system with co-simulation components under the façade of one co-simulation FMU: a step is a step of the master."""

# ruff: noqa: ANN401 - saved states have no type
from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workbench.errors import SimulationError
from workbench.fmi.access import Access
from workbench.fmi.description import Description
from workbench.fmi.instance import MAX_EVENT_ITERATIONS, EventInfo, Instance, StepResult
from workbench.fmi.library import Library
from workbench.session.forcing import convert
from workbench.system.composite import CompositeInstance, Ports
from workbench.system.master.course import Course, Reached
from workbench.system.master.cs_unit import CsUnit
from workbench.system.master.group_instance import GroupInstance
from workbench.system.master.group_unit import GroupUnit
from workbench.system.master.ordering import Order
from workbench.system.master.ticks import Ticks
from workbench.system.master.units import Units, moves
from workbench.system.order import plan

__all__ = ["MasterInstance", "MasterPlan"]

Floats = NDArray[np.float64]

_LEAST = 1e-3  # of values whose nominal value is not declared


@dataclass(frozen=True, eq=False)
class MasterPlan:
    """What is decided once for all instances of a system.

    Attributes:
        units: what is stepped.
        names: of the components.
        stages: in which order; the units of one stage do not see what the others of it reach.
        held: units that are sampled: their outputs stand still between their instants.
        ticks: unit → its instants, where they are known beforehand.
        hold_inputs: inputs stand still over a step.
        solver: group's unit → name of its solver.
        rtol: relative tolerance of the groups' integration.
    """

    units: Units
    names: tuple[str, ...]
    stages: Order
    held: frozenset[int]
    ticks: Mapping[int, Ticks]
    hold_inputs: bool
    solver: Mapping[int, str]
    rtol: float


@dataclass(frozen=True, eq=False)
class _Saved:
    """A saved state of the whole system."""

    parts: Any
    groups: tuple[Any, ...]
    slopes: Floats
    forced: dict[tuple[int, str], _Ramp]
    next_events: dict[int, float]
    time: float


@dataclass(frozen=True, slots=True)
class _Ramp:
    """A forced input of a component: `value` at `time`, changing by `slope` [1/s]."""

    value: float
    slope: float
    time: float

    def at(self, time: float) -> float:
        return self.value + self.slope * (time - self.time)


class MasterInstance(CompositeInstance):
    """All components; `do_step` is one step of the master.

    Between communication points each unit goes on by itself. At a communication point all connected values are
    passed on, in the order of the components' feed-through (algebraic loops are solved), and components with
    event mode iterate together.

    Args:
        parts: new instances; this one owns them from now on.
        decided: see `MasterPlan`.
        description: of the system.
        ports: name of a variable of the system → the parts that have it.
        source: what the user named.

    Attributes:
        decided: see `MasterPlan`.
        reached: see `watch`.
    """

    def __init__(
        self, parts: Sequence[Instance], decided: MasterPlan, description: Description, ports: Ports, *, source: str
    ) -> None:
        connections = decided.units.connections
        super().__init__(parts, plan(connections, parts=len(parts)), description, ports, source=source)
        self.decided = decided
        self._slopes = np.zeros(len(connections))
        self._known: dict[int, float] = {}
        self._forced: dict[tuple[int, str], _Ramp] = {}
        self._next_events: dict[int, float] = {}
        self._inlets: dict[tuple[int, str], Access] = {}
        self._watched: Access | None = None
        self.reached = np.zeros(0)
        self._groups: dict[int, GroupUnit] = {}
        self._units = [self._unit(k) for k in range(len(decided.units.units))]

    def _setup(self, description: Description, library: Library, *, interface: str) -> None:
        super()._setup(description, library, interface="cs")

    def _unit(self, number: int) -> CsUnit | GroupUnit:
        unit, plan_ = self.decided.units.units[number], self.decided
        sources = [plan_.units.connections[i] for i in unit.outgoing]
        if unit.group is None:
            part = self.parts[unit.members[0]]
            held = number in plan_.held
            return CsUnit(unit.name, part, [c.source for c in sources], held=held, hold_inputs=plan_.hold_inputs)
        instance = GroupInstance([self.parts[i] for i in unit.members], unit.group)
        self._groups[number] = GroupUnit(
            unit.name,
            instance,
            dict(enumerate(plan_.names)),
            [f"{plan_.names[c.from_component]}.{c.source.name}" for c in sources],
            solver=plan_.solver[number],
            rtol=plan_.rtol,
        )
        return self._groups[number]

    def close(self) -> None:
        for group in self._groups.values():
            group.close()
        super().close()

    # -- initialisation ---------------------------------------------------------------------

    def enter_initialisation(self, start_time: float, tolerance: float | None) -> None:
        super().enter_initialisation(start_time, tolerance)
        for group in self._groups.values():
            group.instance.enter_initialisation(start_time, tolerance)

    def exit_initialisation(self) -> None:
        super().exit_initialisation()
        for group in self._groups.values():
            group.instance.exit_initialisation()

    # -- events at communication points -----------------------------------------------------

    def _with_events(self) -> list[int]:
        """Return the components that take part in an event iteration."""
        return [i for i, p in enumerate(self.parts) if p.event_mode]

    def enter_event_mode(self) -> None:
        self._write_forced()
        for group in self._groups.values():
            group.instance.enter_event_mode()
        for number in self._with_events():
            if self.parts[number].interface == "cs":
                self.parts[number].enter_event_mode()
        self._wiring.switch(self.time)
        self._events = True
        self.touch()

    def _write_forced(self) -> None:
        """Give forced inputs their present values: the last step may have been shorter than it was meant to be."""
        for (number, name), ramp in self._forced.items():
            if ramp.slope and self.time > ramp.time:
                self._inlet(number, name).write([ramp.at(self.time)])

    def _inlet(self, number: int, name: str) -> Access:
        if (number, name) not in self._inlets:
            part = self.parts[number]
            self._inlets[number, name] = part.access([v for v in part.description.variables if v.name == name])
        return self._inlets[number, name]

    def iterate_events(self) -> EventInfo:
        """Iterate until no component wants another round and no connected value changes."""
        states, last = dict.fromkeys(self._with_events(), False), dict[int, EventInfo]()
        for _ in range(MAX_EVENT_ITERATIONS):
            self.refresh()
            again = False
            for number in states:
                more, last[number] = self.parts[number].update_discrete_states()
                states[number] |= last[number].states_changed
                again |= more
            before = self._wiring.values.copy()
            self.touch()
            self.refresh()
            moved = not np.array_equal(before, self._wiring.values)
            end = any(i.terminate for i in last.values())
            if end or not (again or moved):
                return self._settled(states, last, terminate=end)
        raise SimulationError(
            f"{self.description.model_name}: event iteration does not settle after {MAX_EVENT_ITERATIONS} rounds",
            time=self.time,
        )

    def _settled(self, states: Mapping[int, bool], last: Mapping[int, EventInfo], *, terminate: bool) -> EventInfo:
        self._next_events = {n: i.next_time for n, i in last.items() if self.parts[n].interface == "cs"}
        for number, group in self._groups.items():
            members = self.decided.units.units[number].members
            switch = group.instance.wiring.next_switch(self.time)
            group.instance.settled = EventInfo(
                terminate=False,
                states_changed=True,
                nominals_changed=False,
                next_time=min([switch, *(last[n].next_time for n in members)]),
            )
        return EventInfo(terminate, any(states.values()), nominals_changed=False, next_time=self.next_stop(self.time))

    def enter_step_mode(self) -> None:
        for number in self._with_events():
            if self.parts[number].interface == "cs":
                self.parts[number].enter_step_mode()
        for group in self._groups.values():
            group.settle(self.time)
        self._events = False

    def next_stop(self, time: float) -> float:
        """Return the next instant after `time` [s] at which something is known to happen: a communication point."""
        later = [self._wiring.next_switch(time), *self._next_events.values()]
        later += [group.due() for group in self._groups.values()]
        later += [t.after(time) for t in self.decided.ticks.values()]
        return min((t for t in later if t > time), default=math.inf)

    def watch(self) -> None:
        """Keep in `reached` the left limits at the end of each step: connected values, then the system's outputs."""
        shown = [v for v in self.description.variables if v.causality == "output" and v.is_number]
        # What a component sees at its inputs depends on the step by nature.
        outputs = [v for v in shown if self.ports(v)[0][1].causality != "input"]
        self._watched = self.access(outputs)

    def _watched_values(self) -> Floats:
        if self._watched is None:
            return self.reached
        outputs = [float(v) for v in self._watched.read()] if self._watched.variables else []
        return np.array([*(self._known[i] for i in sorted(self._known)), *outputs])

    def least(self) -> Floats:
        """Return from which magnitude on what is watched counts in relative terms."""
        sources = [self._wiring.connections[i].destination for i in sorted(self.decided.units.outer())]
        outputs = self._watched.variables if self._watched is not None else ()
        return np.array([v.nominal or _LEAST for v in (*sources, *outputs)])

    def takes(self, number: int) -> str:
        """Return how a unit takes its inputs over a step."""
        return self._units[number].takes

    def place_states(self, values: Mapping[str, float]) -> bool:
        placed = [group.instance.place_states(values) for group in self._groups.values()]
        return any(placed)

    # -- steps ------------------------------------------------------------------------------

    def try_input_slopes(self, access: Access, slopes: Sequence[float]) -> bool:
        """Note how the system's inputs go on in the next step."""
        if access.variables:
            for variable, value, slope in zip(access.variables, access.read(), slopes, strict=True):
                for number, inner in self.ports(variable):
                    self._forced[number, inner.name] = _Ramp(float(value), slope, self.time)
        return True

    def do_step(self, time: float, step: float) -> StepResult:
        """Step every unit; ends earlier if the first one stops at an event of its own."""
        self.time, end = time, time + step
        self.refresh()
        start, self._known = self._wiring.values.copy(), {}
        moved = False
        for stage in self.decided.stages:
            found: dict[int, float] = {}
            for number in stage:
                reached = self._advance(number, time, end, start, may_stop=not moved)
                end, moved = reached.time, True
                found |= self._ends(number)
            self._known |= found
        self._slopes = self._new_slopes(start, end - time)
        self.time = end
        self._stale = False  # what is read now are left limits
        self.reached = self._watched_values()
        return StepResult(end, event=True)

    def _advance(self, number: int, time: float, end: float, start: Floats, *, may_stop: bool) -> Reached:
        courses = [*self._connected(number, start, end - time), *self._from_outside(number, time, end)]
        return self._units[number].step(time, end, courses, may_stop=may_stop)

    def _connected(self, number: int, start: Floats, span: float) -> list[Course]:
        found = []
        for i in self.decided.units.units[number].incoming:
            connection = self._wiring.connections[i]
            first, last = self._limits(i, float(start[i]), span)
            if not connection.destination.is_continuous_input:
                first = last = float(convert(connection.destination, first))
            found.append(Course(connection.to_component, connection.destination, first, last))
        return found

    def _limits(self, connection: int, start: float, span: float) -> tuple[float, float]:
        """Return a connected value at both ends of the step, as its destination is to see it."""
        decided = self.decided
        known = self._known.get(connection)
        if known is not None and (decided.hold_inputs or decided.units.ends(connection)[0] in decided.held):
            return known, known
        if decided.hold_inputs or not moves(self._wiring.connections[connection].source):
            return start, start
        return start, (start + float(self._slopes[connection]) * span if known is None else known)

    def _from_outside(self, number: int, time: float, end: float) -> list[Course]:
        found = []
        for (component, name), ramp in self._forced.items():
            if self.decided.units.of[component] == number:
                variable = self._inlet(component, name).variables[0]
                found.append(Course(component, variable, ramp.at(time), ramp.at(end)))
        return found

    def _ends(self, number: int) -> dict[int, float]:
        """Return the values on the connections that leave a unit, where it stands now."""
        outgoing = self.decided.units.units[number].outgoing
        raw = self._units[number].read()
        found = {}
        for i, value in zip(outgoing, raw, strict=True):
            if not math.isfinite(value):
                label = self._wiring.connections[i].label
                raise SimulationError(f"{label} passes {value:g}, not a finite number", time=self.time)
            connection = self._wiring.connections[i]
            found[i] = connection.gain * value + connection.offset if self._wiring.closed[i] else 0.0
        return found

    def _new_slopes(self, start: Floats, span: float) -> Floats:
        """Return how connected values changed in this step [1/s]; what is held goes on standing still."""
        slopes = np.zeros(len(start))
        for i, end in self._known.items():
            if self.decided.units.ends(i)[0] not in self.decided.held:
                slopes[i] = (end - start[i]) / span
        return slopes

    # -- saved states -----------------------------------------------------------------------

    def get_state(self) -> Any:
        return _Saved(
            parts=super().get_state(),
            groups=tuple(g.snapshot() for g in self._groups.values()),
            slopes=self._slopes.copy(),
            forced=dict(self._forced),
            next_events=dict(self._next_events),
            time=self.time,
        )

    def set_state(self, state: Any) -> None:
        super().set_state(state.parts)
        for group, saved in zip(self._groups.values(), state.groups, strict=True):
            group.restore(saved)
        self.time = state.time
        self._slopes = state.slopes.copy()
        self._forced, self._next_events = dict(state.forced), dict(state.next_events)
        self._stale = False

    def free_state(self, state: Any) -> None:
        super().free_state(state.parts)

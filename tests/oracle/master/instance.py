"""The master's instance with its steps in Python."""

# ruff: noqa: ANN401 - saved states have no type
from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tests.oracle.group import OracleGroupSession
from tests.oracle.master.course import Course, Reached
from tests.oracle.master.cs_unit import CsUnit
from tests.oracle.master.group_unit import GroupStepper
from tests.oracle.steps import StepResult
from workbench.core.values.arrays import Floats
from workbench.core.values.calendar import gathered, is_due, rounding
from workbench.errors import SimulationError
from workbench.fmi.access import VariableAccess
from workbench.fmi.variable import Variable
from workbench.session.forcing import convert
from workbench.system.master.group_unit import GroupSession, GroupUnit
from workbench.system.master.instance import MasterInstance
from workbench.system.master.units import moves

__all__ = ["OracleMasterInstance"]


@dataclass(frozen=True, slots=True)
class _Ramp:
    """A forced input of a component: `value` at `time`, changing by `slope` [1/s]."""

    value: float
    slope: float
    time: float
    bow: float = 0.0

    def at(self, time: float) -> float:
        return self.value + self.slope * (time - self.time)


class OracleMasterInstance(MasterInstance):
    """`do_step` is one step of the master; `reached` are the left limits at its end, if `watch` was called."""

    def __init__(self, *args: Any, **names: Any) -> None:
        super().__init__(*args, **names)
        self._known: dict[int, float] = {}
        self._forced: dict[tuple[int, str], _Ramp] = {}
        self._inlets: dict[tuple[int, str], VariableAccess] = {}
        self._watched: VariableAccess | None = None
        self.reached = np.zeros(0)
        self._units = [self._unit(k) for k in range(len(self.decided.units.units))]

    def _unit(self, number: int) -> CsUnit | GroupStepper:
        unit, plan = self.decided.units.units[number], self.decided
        sources = [plan.units.connections[i] for i in unit.outgoing]
        if unit.group is None:
            part = self.parts[unit.members[0]]
            held = number in plan.held
            return CsUnit(unit.name, part, [c.source for c in sources], held=held, hold_inputs=plan.hold_inputs)
        names = [f"{plan.names[c.from_component]}.{c.source.name}" for c in sources]
        return GroupStepper(self.groups[number], dict(enumerate(plan.names)), names)

    def _group(self, number: int, kind: type[GroupSession] = OracleGroupSession) -> GroupUnit:
        return super()._group(number, kind)

    def watch(self) -> None:
        """Keep in `reached` the left limits at the end of each step: connected values, then the system's outputs."""
        self._watched = self.access(self.watched())

    def enter_event_mode(self) -> None:
        self._write_forced()
        super().enter_event_mode()

    def _write_forced(self) -> None:
        """Give forced inputs their present values: the last step may have been shorter than it was meant to be."""
        for (number, name), ramp in self._forced.items():
            if ramp.slope and self.time > ramp.time:
                self._inlet(number, name).write([ramp.at(self.time)])

    def _inlet(self, number: int, name: str) -> VariableAccess:
        if (number, name) not in self._inlets:
            part = self.parts[number]
            self._inlets[number, name] = part.access([v for v in part.description.variables if v.name == name])
        return self._inlets[number, name]

    def next_stop(self, time: float) -> float:
        """Return the next instant after `time` [s] at which something is known to happen: a communication point."""
        later = [*self._wiring.switches_after(time), *self.next_events.values()]
        later += [group.due() for group in self.groups.values()]
        later += [s.after(time + rounding(time)) for samplers in self.ticks.values() for s in samplers]
        return gathered((t for t in later if not is_due(t, time)), time)

    def takes(self, number: int) -> str:
        """Return how a unit takes its inputs over a step."""
        return self._units[number].takes

    def _watched_values(self) -> Floats:
        if self._watched is None:
            return self.reached
        outputs = [float(v) for v in self._watched.read()] if self._watched.variables else []
        return np.array([*(self._known[i] for i in sorted(self._known)), *outputs])

    def try_input_slopes(self, access: VariableAccess, slopes: Sequence[float]) -> bool:
        """Note how the system's inputs go on in the next step."""
        if access.variables:
            for variable, value, slope in zip(access.variables, access.read(), slopes, strict=True):
                for number, inner in self.ports(variable):
                    self._forced[number, inner.name] = _Ramp(float(value), slope, self.time)
        return True

    def bow(self, variable: Variable, bow: float) -> None:
        """Note the mean of an input of the system over the next step, less that of the straight line."""
        for number, inner in self.ports(variable):
            self._forced[number, inner.name] = replace(self._forced[number, inner.name], bow=bow)

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
        self.slopes[1], self.slopes[0] = self.slopes[0], self._new_slopes(start, end - time)
        self.spans[1], self.spans[0] = self.spans[0], end - time
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
            bow = self._bow(i, first, last, span) if connection.destination.is_continuous_input else 0.0
            found.append(Course(connection.to_component, connection.destination, first, last, bow))
        return found

    def _limits(self, connection: int, start: float, span: float) -> tuple[float, float]:
        """Return a connected value at both ends of the step, as its destination is to see it."""
        decided = self.decided
        known = self._known.get(connection)
        if known is not None and (decided.hold_inputs or decided.units.ends(connection)[0] in decided.held):
            return known, known
        if decided.hold_inputs or not moves(self._wiring.connections[connection].source):
            return start, start
        return start, (self._extrapolated(connection, start, span) if known is None else known)

    def _bow(self, connection: int, first: float, last: float, span: float) -> float:
        """Return by how much the mean of the parabola through the last point is off that of its chord."""
        before, decided = float(self.spans[0]), self.decided
        held = decided.units.ends(connection)[0] in decided.held and connection in self._known
        still = held or decided.hold_inputs or not moves(self._wiring.connections[connection].source)
        if decided.extrapolation < 2 or not before or still:
            return 0.0
        bend = ((last - first) / span - float(self.slopes[0, connection])) / (span + before)
        return -bend * span * span / 6.0

    def _extrapolated(self, connection: int, start: float, span: float) -> float:
        order, (slope, before), spans = self.decided.extrapolation, self.slopes[:, connection].tolist(), self.spans
        change = slope * span if order > 0 else 0.0
        if order > 1 and spans.all():
            change += (slope - before) / float(spans.sum()) * span * (span + float(spans[0]))
        return start + change

    def _from_outside(self, number: int, time: float, end: float) -> list[Course]:
        found = []
        for (component, name), ramp in self._forced.items():
            if self.decided.units.of[component] == number:
                variable = self._inlet(component, name).variables[0]
                found.append(Course(component, variable, ramp.at(time), ramp.at(end), ramp.bow))
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
        return super().get_state(), dict(self._forced)

    def set_state(self, state: Any) -> None:
        super().set_state(state[0])
        self._forced = dict(state[1])

    def free_state(self, state: Any) -> None:
        super().free_state(state[0])

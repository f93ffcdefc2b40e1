"""Advancing a group of model exchange components in Python, by its session."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from tests.oracle.master.course import Course, Reached
from workbench.errors import SimulationError
from workbench.fmi.access import VariableAccess
from workbench.fmi.variable import Variable
from workbench.signals.kinds import Constant, Signal, Table
from workbench.system.master.group_unit import GroupUnit

__all__ = ["GroupStepper"]


class GroupStepper:
    """Steps one group; its inputs are linear over a step.

    Args:
        unit: the group.
        names: component → its name.
        sources: full names of the variables that others read.
    """

    def __init__(self, unit: GroupUnit, names: Mapping[int, str], sources: Sequence[str]) -> None:
        self.name, self.instance, self._unit, self._names = unit.name, unit.instance, unit, names
        variables = {v.name: v for v in unit.instance.description.variables}
        self._known: dict[str, Variable] = {n: v for n, v in variables.items() if v.causality == "input"}
        self._outlet = unit.instance.access([variables[name] for name in sources])
        self._accesses: dict[tuple[str, ...], VariableAccess] = {}

    @property
    def takes(self) -> str:
        """How it takes its inputs over a step."""
        return "slope"

    def read(self) -> list[float]:
        """Return the present values of the sources."""
        return [float(v) for v in self._outlet.read()] if self._outlet.variables else []

    def step(self, start: float, end: float, courses: Sequence[Course], *, may_stop: bool) -> Reached:
        """Advance from `start` to `end` [s] with inputs that follow `courses`; events inside are made there."""
        if self._is_static and self._unit.session.due() > end:
            self._follow(end, courses)
            return Reached(end)
        signals = {f"{self._names[c.component]}.{c.variable.name}": _signal(c, start, end) for c in courses}
        try:
            self._unit.session.advance(end, signals=signals)
        except SimulationError as error:
            raise _of(self.name, error) from error
        self.instance.touch()
        bowed = [c for c in courses if c.bow]
        if bowed:
            self._inlet_of(bowed).write([c.end for c in bowed])
        return Reached(end, event=self._unit.session.due() <= end)

    @property
    def _is_static(self) -> bool:
        """Whether there is nothing to integrate and nothing that could happen on the way."""
        return self.instance.nx == 0 and self.instance.nz == 0

    def _follow(self, end: float, courses: Sequence[Course]) -> None:
        """Take static components to the end of the step."""
        self.instance.set_time(end)
        self._unit.session.time = end
        if courses:
            self._inlet_of(courses).write([c.end for c in courses])

    def _inlet_of(self, courses: Sequence[Course]) -> VariableAccess:
        names = tuple(f"{self._names[c.component]}.{c.variable.name}" for c in courses)
        if names not in self._accesses:
            self._accesses[names] = self.instance.access([self._known[n] for n in names])
        return self._accesses[names]


def _signal(course: Course, start: float, end: float) -> Signal:
    if course.start == course.end:
        return Constant(course.start + course.bow)
    return Table((start, end), (course.start + course.bow, course.end + course.bow))


def _of(name: str, error: SimulationError) -> SimulationError:
    found = type(error)(str(error) if name in str(error) else f"{name}: {error}")
    found.time = error.time
    return found

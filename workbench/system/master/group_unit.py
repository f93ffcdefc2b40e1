"""Advancing a group of model exchange components: one ordinary differential equation between communication points."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from workbench.errors import SimulationError
from workbench.fmi.access import Access
from workbench.session.base import Snapshot
from workbench.session.fmu import Setup
from workbench.signals import Constant, Signal, Table
from workbench.system.master.course import Course, Reached
from workbench.system.master.group_instance import GroupInstance
from workbench.system.master.group_session import CompiledGroupSession, GroupSession

__all__ = ["GroupUnit"]

SESSION: type[GroupSession] = CompiledGroupSession


class GroupUnit:
    """One group; its inputs are linear over a step.

    Args:
        name: of the group.
        instance: its components; the session begins with the first event iteration.
        names: component → its name.
        sources: full names of the variables that others read.
        solver, rtol: of the session.
    """

    def __init__(
        self,
        name: str,
        instance: GroupInstance,
        names: Mapping[int, str],
        sources: Sequence[str],
        *,
        solver: str,
        rtol: float,
    ) -> None:
        self.name = name
        self.instance = instance
        self._names = names
        variables = {v.name: v for v in instance.description.variables}
        self._inlet = instance.access([v for v in variables.values() if v.causality == "input"])
        self._outlet = instance.access([variables[name] for name in sources])
        self._setup = Setup(
            open_instance=lambda: instance,
            variables=variables,
            rtol=rtol,
            solver=solver,
            state_works=lambda: True,
        )
        self._session: GroupSession | None = None
        self._accesses: dict[tuple[str, ...], Access] = {}

    @property
    def session(self) -> GroupSession:
        """The session, once it is open."""
        if self._session is None:
            raise SimulationError(f"{self.name} is not initialised, or closed")
        return self._session

    @property
    def takes(self) -> str:
        """How it takes its inputs over a step."""
        return "slope"

    def read(self) -> list[float]:
        """Return the present values of the sources."""
        return [float(v) for v in self._outlet.read()] if self._outlet.variables else []

    def due(self) -> float:
        """Return the time of the next time event [s]."""
        return math.inf if self._session is None else self._session.due()

    def settle(self, time: float) -> None:
        """Go on from the joint event iteration that has just ended at `time` [s]."""
        instance = self.instance
        if self._session is None:
            self._session = SESSION(replace(self._setup, start_time=time))
        else:
            instance.enter_continuous_mode()
        inputs = {v.name: float(x) for v, x in zip(self._inlet.variables, self._standing(), strict=True)}
        self.session.go_on(instance.settled.next_time, inputs)

    def _standing(self) -> list[float]:
        return self._inlet.read() if self._inlet.variables else []

    def step(self, start: float, end: float, courses: Sequence[Course], *, may_stop: bool) -> Reached:
        """Advance from `start` to `end` [s] with inputs that follow `courses`; events inside are made there."""
        if self._is_static and self.session.due() > end:
            self._follow(end, courses)
            return Reached(end)
        signals = {f"{self._names[c.component]}.{c.variable.name}": _signal(c, start, end) for c in courses}
        try:
            self.session.advance(end, signals=signals)
        except SimulationError as error:
            raise _of(self.name, error) from error
        self.instance.touch()
        return Reached(end, event=self.session.due() <= end)

    @property
    def _is_static(self) -> bool:
        """Whether there is nothing to integrate and nothing that could happen on the way."""
        return self.instance.nx == 0 and self.instance.nz == 0

    def _follow(self, end: float, courses: Sequence[Course]) -> None:
        """Take static components to the end of the step."""
        names = tuple(f"{self._names[c.component]}.{c.variable.name}" for c in courses)
        if names not in self._accesses:
            known = {v.name: v for v in self._inlet.variables}
            self._accesses[names] = self.instance.access([known[n] for n in names])
        self.instance.set_time(end)
        self.session.time = end
        if courses:
            self._accesses[names].write([c.end for c in courses])

    def snapshot(self) -> Snapshot:
        """Save what the components' own states do not hold."""
        return self.session.snapshot()

    def restore(self, snapshot: Snapshot) -> None:
        """Go back; the components are back already."""
        self.session.restore(snapshot)

    def close(self) -> None:
        """Free the solver."""
        session, self._session = self._session, None
        if session is not None:
            session.close()


def _signal(course: Course, start: float, end: float) -> Signal:
    if course.start == course.end:
        return Constant(course.start)
    return Table((start, end), (course.start, course.end))


def _of(name: str, error: SimulationError) -> SimulationError:
    found = type(error)(str(error) if name in str(error) else f"{name}: {error}")
    found.time = error.time
    return found

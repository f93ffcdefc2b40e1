"""Stepping one co-simulation component."""

from __future__ import annotations

from collections.abc import Sequence

from tests.oracle.master.course import Course, Reached
from tests.oracle.steps import do_step
from workbench.errors import EndedError, SimulationError
from workbench.fmi.access import VariableAccess
from workbench.fmi.instance import Instance
from workbench.fmi.variable import Variable
from workbench.session.forcing import convert

__all__ = ["CsUnit"]

_MAX_RETURNS = 10_000


class CsUnit:
    """One component with its inputs: linear where the FMU takes their slopes, else held at their middle value.

    The middle value has no delay on average over the step, and makes the held input as exact as a linear one to
    the second order of the step (for FMUs whose inputs act through integrators).

    Args:
        name: of the component.
        part: the instance; it belongs to the master.
        sources: variables that others read.
        held: the component is sampled: its inputs count at the start of a step, and its outputs stand still.
        hold_inputs: inputs stand still over a step, at their first value.
    """

    def __init__(
        self, name: str, part: Instance, sources: Sequence[Variable], *, held: bool, hold_inputs: bool
    ) -> None:
        self.name = name
        self._part = part
        self._outlet = part.access(sources)
        self._as_start = held or hold_inputs
        self._slopes_work = part.capabilities.interpolates_inputs
        self._accesses: dict[tuple[str, ...], VariableAccess] = {}

    @property
    def takes(self) -> str:
        """How it takes its inputs over a step: "start" or "middle" value, or "slope"."""
        if self._as_start:
            return "start"
        return "slope" if self._slopes_work else "middle"

    def read(self) -> list[float]:
        """Return the present values of the sources."""
        return [float(v) for v in self._outlet.read()] if self._outlet.variables else []

    def step(self, start: float, end: float, courses: Sequence[Course], *, may_stop: bool) -> Reached:
        """Step from `start` to `end` [s].

        Args:
            start: [s].
            end: [s].
            courses: of all inputs that are connected or forced.
            may_stop: it may end earlier, at an event of its own.
        """
        time, span = start, end - start
        for _ in range(_MAX_RETURNS):
            self._give(courses, (time - start) / span, span)
            result = do_step(self._part, time, end - time)
            if result.terminate:
                raise EndedError(f"{self.name} ended its run{self._part.log.tail()}", time=result.time)
            if result.time >= end - 1e-12 * max(abs(end), span):
                self._part.time = end
                self._arrive(courses, 1.0)
                return Reached(end, event=result.event)
            time = result.time
            if result.event and may_stop:
                self._arrive(courses, (time - start) / span)
                return Reached(time, event=True)
            if result.event:
                self._local_event(courses, (time - start) / span)
        raise SimulationError(f"{self.name} returned early from doStep {_MAX_RETURNS} times in one step", time=time)

    def _give(self, courses: Sequence[Course], part: float, span: float) -> None:
        """Tell the FMU its inputs from this part of the step to its end."""
        moving = [c for c in courses if c.variable.is_continuous_input]
        if not moving:
            return
        access = self._access(moving)
        if self._as_start:
            access.write([c.start for c in moving])
            return
        if self._slopes_work:
            access.write([c.at(part) + c.bow for c in moving])
            self._slopes_work = self._part.try_input_slopes(access, [(c.end - c.start) / span for c in moving])
        if not self._slopes_work:
            access.write([c.at(0.5 * (part + 1.0)) + c.bow for c in moving])

    def _arrive(self, courses: Sequence[Course], part: float) -> None:
        """Give the inputs the values that they have at the end, for outputs that show them directly."""
        moving = [c for c in courses if c.variable.is_continuous_input and (c.end != c.start or c.bow)]
        if moving and not self._as_start:
            self._access(moving).write([c.at(part) for c in moving])

    def _local_event(self, courses: Sequence[Course], part: float) -> None:
        """Make an event inside the step; the others do not see it before its end."""
        instance = self._part
        instance.enter_event_mode()
        if courses:
            self._access(courses).write([convert(c.variable, c.at(part)) for c in courses])
        if instance.iterate_events().terminate:
            raise EndedError(f"{self.name} ended its run{instance.log.tail()}", time=instance.time)
        instance.enter_step_mode()

    def _access(self, courses: Sequence[Course]) -> VariableAccess:
        names = tuple(c.variable.name for c in courses)
        if names not in self._accesses:
            self._accesses[names] = self._part.access([c.variable for c in courses])
        return self._accesses[names]

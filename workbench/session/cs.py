"""Co-simulation: the FMU integrates, the workbench steps it from one communication point to the next."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from workbench.core.values.arrays import Floats
from workbench.core.values.calendar import is_due
from workbench.errors import InputError, SimulationError
from workbench.fmi.instance import StepResult
from workbench.fmi.variable import Variable
from workbench.session.base import Recorded
from workbench.session.fmu import FmuSession, Lead
from workbench.session.forcing import convert
from workbench.session.pauses import pause
from workbench.session.rows import Rows
from workbench.session.start_values import COMPUTED, StartPoint

__all__ = ["CsSession", "off_grid"]

STEPS_PER_SHAPE = 25  # of a signal's longest step: 200 steps per period of a sine
STEPS_PER_CALL = 500  # where nothing else says how long a step should be
GRID_ERROR = 1e-6  # of a step: how far a point may lie off a constant grid
MAX_EARLY_RETURNS = 10_000
_DETERMINED = "in co-simulation its initialisation determines it, and it cannot be set afterwards"


class CsSession(FmuSession):
    """Steps one FMU.

    Communication points are the recorded points, the breaks of the signals, and as many more
    between them as keep every step within the communication step. Over a step continuous inputs are
    linear where the FMU interpolates its inputs, given where the FMU asks for them (`kernel/intermediate.c`), else
    held at their value in the middle, which is right to second order; at its start where the step is constant, since
    the FMU may sample there, or where they are to be held.
    """

    _fixed: float | None = None
    _slopes_work = True
    _event_due = False  # the last step ended at an event, which waits for the inputs there

    def _started(self, due: float) -> None:
        self._fixed, self._event_due = None, False
        self._previous = self.time

    def _leave_event_mode(self) -> None:
        if self.instance.iterate_events().terminate:
            raise self._ended()
        self.instance.enter_step_mode()

    def _arrived(self) -> None:
        """Give the inputs of the point, and states where there is a way; what did not take is refused."""
        target = self._target
        if target is None:
            return
        placed = bool(target.missed_states()) and self.instance.place_states(target.values)
        inputs = [v for v in target.inputs if target.missed([v])]
        if placed or inputs:
            if self.instance.event_mode:
                self.instance.enter_event_mode()
            self.instance.access(inputs).write([convert(v, target.values[v.name]) for v in inputs])
            if self.instance.event_mode:
                self._leave_event_mode()
        target.refuse(target.missed(target.inputs), "the FMU does not keep the value of an input")
        if self.setup.lead is not None:
            self._follow(self.setup.lead, target)
        way = self.instance.description.way_out()
        target.refuse([*target.missed_states(), *target.missed_outputs()], f"{_DETERMINED}; {way}")

    def _follow(self, lead: Lead, target: StartPoint) -> None:
        """Run under the inputs of the point up to its time."""
        target.near, target.sizes = COMPUTED, lead.sizes
        own, self.setup = self.setup, replace(self.setup, step=lead.step)
        try:
            self.advance(own.start_time, signals={})
        finally:
            self.setup = own
            self._calls.clear()  # a replay comes here by itself
        if self.instance.capabilities.variable_step:
            self._fixed = None

    def _advance(self, until: float, targets: Floats, variables: Sequence[Variable], *, new: bool) -> Recorded:
        rows = Rows(self.instance, variables, self.forcing)
        with rows.kept():
            self._run(until, targets.tolist(), rows, new=new)
        return rows.record()

    def _run(self, until: float, targets: list[float], rows: Rows, *, new: bool) -> None:
        self._set_inputs(jump=new or self.forcing.next_break(self._previous) <= self.time)
        rows.add(self.time)
        waiting = targets[::-1]
        longest = self._longest(until)
        while self.time < until:
            while waiting[-1] <= self.time:
                waiting.pop()
            target = min(waiting[-1], self.forcing.next_break(self.time))
            tick = self.instance.next_tick  # what is overdue ticks at the next communication point
            target = target if is_due(tick, self.time) or is_due(target, tick) else tick
            self._to_target(target, until, longest, rows)

    def _to_target(self, target: float, until: float, longest: float, rows: Rows) -> None:
        start = self.time
        count = self._steps(start, target, longest)
        for i in range(1, count + 1):
            end = target if i == count else start + (target - start) * (i / count)
            self._communicate(end, rows, last=end == until)
            pause(end)

    def _communicate(self, end: float, rows: Rows, *, last: bool) -> None:
        """Make one step and record its two rows; at `until` the right limit is the next call's."""
        start = self._previous = self.time
        seen = self._give_slopes(end)
        self._step_to(end)
        if self._centres():
            seen = self.forcing.ramp(start, end)[1]
            self.forcing.write_moved(seen)
        self._event_due = self._event_due or is_due(self.instance.next_tick, self.time)
        self.forcing.written = seen
        rows.add(self.time, inputs=seen)
        if not last:
            self._set_inputs(jump=self.forcing.next_break(start) <= end)
            rows.add(self.time)

    # -- inputs ---------------------------------------------------------------------------

    def _set_inputs(self, *, jump: bool) -> None:
        """Set the right limits; jumps and discrete inputs need event mode where there is one.

        An event at the end of the last step is made with the inputs of this point: a sampled input is the one set here.
        """
        if not self.forcing.names and not self._event_due:
            return
        wanted = self.forcing.at(self.time)
        if not self.instance.event_mode:
            self.forcing.write_all(wanted)
        elif self._event_due or (jump and wanted != self.forcing.written) or self.forcing.discrete_differ(wanted):
            self._event_due = False
            self.instance.enter_event_mode()
            self.forcing.write_all(wanted)
            self._leave_event_mode()
        else:
            self.forcing.write_continuous(self.time)

    def _give_slopes(self, end: float) -> list[float]:
        """Tell the FMU how its inputs go on, if it can; returns what it sees just before `end`."""
        interpolates = self.instance.capabilities.interpolates_inputs and not self.setup.hold_inputs
        usable = interpolates and self._slopes_work
        if not usable or not self.forcing.continuous.variables:
            return list(self.forcing.written)
        slopes, ends = self.forcing.ramp(self.time, end)
        if any(slopes) and not self.setup.slopes_act():
            self._slopes_work = False
            return list(self.forcing.written)
        self._slopes_work = self.instance.try_input_slopes(self.forcing.continuous, slopes)
        return ends if self._slopes_work else list(self.forcing.written)

    def _centres(self) -> bool:
        """Whether inputs are held over a step at the value of its middle."""
        claims = self.instance.capabilities
        linear = claims.interpolates_inputs and self._slopes_work
        return claims.variable_step and not self.setup.hold_inputs and not linear

    def _write_inside(self, t: float) -> None:
        if self._centres():
            self.forcing.write_moved(self.forcing.moved_to(t))

    # -- steps ----------------------------------------------------------------------------

    def _step_to(self, end: float) -> None:
        """Step to `end`, going on after early returns and handling events on the way."""
        for _ in range(MAX_EARLY_RETURNS):
            self._write_inside(0.5 * (self.time + end))
            result = self.instance.do_step(self.time, end - self.time)
            early = result.time < end - 1e-12 * max(abs(end), end - self.time)
            self._after(result, early=early)
            if not early:
                self.time = self.instance.time = end
                return
        raise SimulationError(
            f"the FMU returned early from doStep {MAX_EARLY_RETURNS} times in one step", time=self.time
        )

    def _after(self, result: StepResult, *, early: bool) -> None:
        """An event inside the step is made at once; one at its end after the left limits there are recorded."""
        if early or result.terminate:
            self.time = result.time
        if result.terminate:
            raise self._ended()
        if result.event:
            if not self.instance.event_mode:
                raise SimulationError("the FMU requests event mode, which it does not offer", time=result.time)
            self._event_due = not early
            if early:
                self._write_inside(self.time)
                self.instance.enter_event_mode()
                self._leave_event_mode()

    def _longest(self, until: float) -> float:
        """Return the longest communication step of this advance [s]."""
        step = self._choose_step(until)
        if until > self.time:  # else no step is made: one row is asked for
            self.communication_step = step
        return step

    def _choose_step(self, until: float) -> float:
        if self.setup.step is not None:
            return self.setup.step
        experiment = self.instance.description.experiment.step
        if experiment is not None:
            return experiment
        shape = self.forcing.longest_step / STEPS_PER_SHAPE
        return shape if math.isfinite(shape) else max(until - self.time, 1e-300) / STEPS_PER_CALL

    def _steps(self, start: float, target: float, longest: float) -> int:
        """Return into how many equal steps the way to `target` is cut."""
        span = target - start
        if self._fixed is None:
            count = max(1, math.ceil(span / longest - 1e-9))
            if not self.instance.capabilities.variable_step:
                self._fixed = longest if self.setup.step is not None else span / count
            if self._fixed is None:
                return count
        count = round(span / self._fixed)
        if count < 1 or abs(span - count * self._fixed) > GRID_ERROR * self._fixed:
            raise off_grid(self._fixed, target)
        return count

    # -- snapshots ------------------------------------------------------------------------

    def _memory(self) -> tuple[float | None, float, bool]:
        return self._fixed, self._previous, self._event_due

    def _resume(self, memory: object) -> None:
        if not isinstance(memory, tuple):
            raise InputError("this snapshot belongs to another kind of session")
        self._fixed, self._previous, self._event_due = memory

    def _forget(self) -> None:
        """The FMU's solver is its own; there is nothing to reset."""


def off_grid(step: float, point: float) -> InputError:
    """Return the error for a point that a constant communication step cannot meet."""
    return InputError(
        f"the FMU needs a constant communication step, here {step:.9g} s, and {point:.9g} s is no multiple of it, "
        "where the run has to stop (for a recorded value, a break of a signal, a part of a period); use another --step"
    )

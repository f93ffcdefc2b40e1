"""Co-simulation step by step in Python."""

from __future__ import annotations

import math
from collections.abc import Sequence

from tests.oracle.forcing import discrete_differ, moved_to, next_break, ramp, write_continuous, write_moved
from tests.oracle.rows import Rows
from tests.oracle.steps import StepResult, do_step, next_tick
from workbench.core.values.arrays import Floats
from workbench.core.values.calendar import is_due
from workbench.errors import SimulationError
from workbench.fmi.variable import Variable
from workbench.session.base import Recorded
from workbench.session.cs import MAX_EARLY_RETURNS, CsSession, off_grid
from workbench.session.pauses import pause

__all__ = ["OracleCsSession"]

GRID_ERROR = 1e-6  # of a step: how far a point may lie off a constant grid


class OracleCsSession(CsSession):
    """The loop of `kernel/cs.c`."""

    _slopes_work = True

    def _advance(self, until: float, targets: Floats, variables: Sequence[Variable], *, new: bool) -> Recorded:
        rows = Rows(self.instance, variables, self.forcing)
        with rows.kept():
            self._run(until, targets.tolist(), rows, new=new)
        return rows.record()

    def _run(self, until: float, targets: list[float], rows: Rows, *, new: bool) -> None:
        self._set_inputs(jump=new or next_break(self.forcing, self._previous) <= self.time)
        rows.add(self.time)
        waiting = targets[::-1]
        longest = self._longest(until)
        while self.time < until:
            while waiting[-1] <= self.time:
                waiting.pop()
            target = min(waiting[-1], next_break(self.forcing, self.time))
            tick = next_tick(self.instance)  # what is overdue ticks at the next communication point
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
            seen = ramp(self.forcing, start, end)[1]
            write_moved(self.forcing, seen)
        self._event_due = self._event_due or is_due(next_tick(self.instance), self.time)
        self.forcing.written = seen
        rows.add(self.time, inputs=seen)
        if not last:
            self._set_inputs(jump=next_break(self.forcing, start) <= end)
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
        elif self._event_due or (jump and wanted != self.forcing.written) or discrete_differ(self.forcing, wanted):
            self._event_due = False
            self.instance.enter_event_mode()
            self.forcing.write_all(wanted)
            self._leave_event_mode()
        else:
            write_continuous(self.forcing, self.time)

    def _give_slopes(self, end: float) -> list[float]:
        """Tell the FMU how its inputs go on, if it can; returns what it sees just before `end`."""
        interpolates = self.instance.capabilities.interpolates_inputs and not self.setup.hold_inputs
        usable = interpolates and self._slopes_work
        if not usable or not self.forcing.continuous.variables:
            return list(self.forcing.written)
        slopes, ends = ramp(self.forcing, self.time, end)
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
            write_moved(self.forcing, moved_to(self.forcing, t))

    # -- steps ----------------------------------------------------------------------------

    def _step_to(self, end: float) -> None:
        """Step to `end`, going on after early returns and handling events on the way."""
        for _ in range(MAX_EARLY_RETURNS):
            self._write_inside(0.5 * (self.time + end))
            result = self._stepped(end - self.time)
            early = result.time < end - 1e-12 * max(abs(end), end - self.time)
            self._after(result, early=early)
            if not early:
                self.time = self.instance.time = end
                return
        raise SimulationError(
            f"the FMU returned early from doStep {MAX_EARLY_RETURNS} times in one step", time=self.time
        )

    def _stepped(self, step: float) -> StepResult:
        return do_step(self.instance, self.time, step)

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

"""A session on a system with co-simulation components, step by step in Python."""

from __future__ import annotations

import math
from collections.abc import Sequence

from tests.oracle.cs import OracleCsSession
from tests.oracle.master.control import StepControl
from tests.oracle.master.instance import OracleMasterInstance
from tests.oracle.rows import Rows
from tests.oracle.steps import StepResult
from workbench.core.values.arrays import Floats
from workbench.core.values.calendar import is_due
from workbench.errors import InputError
from workbench.fmi.variable import Variable
from workbench.session.base import Recorded
from workbench.session.pauses import pause
from workbench.session.setup import Setup
from workbench.system.master.session import RehearsingSession

__all__ = ["OracleMasterSession", "UndoableRows"]

_SLIVER = 1e-9  # of a step: no piece is as short
_SHORTEST = 1e-4  # of the first step: shorter ones are taken as they are


class OracleMasterSession(RehearsingSession, OracleCsSession):
    """Steps the whole system from one communication point to the next.

    Communication points are those of `CsSession`, and the instants at which something is known to happen in a
    component: samples, time events, connections that close; components with a constant step know only their grid.

    Args:
        setup: see `Setup`.
        tolerance: of one step, which is controlled then; None: the step is fixed.
        rehearses: see `RehearsingSession`.
    """

    def __init__(self, setup: Setup, *, tolerance: float | None = None, rehearses: bool = False) -> None:
        self._tolerance = tolerance
        self._control: StepControl | None = None
        super().__init__(setup, rehearses=rehearses)

    @property
    def master(self) -> OracleMasterInstance:
        """The system's instance."""
        instance = self.instance
        if not isinstance(instance, OracleMasterInstance):
            raise InputError("this session is not one of a system with co-simulation components")
        return instance

    def takes(self, number: int) -> str:
        """Return how a unit takes its inputs over a step."""
        return self.master.takes(number)

    def _started(self, due: float) -> None:
        super()._started(due)
        self._control = None
        if self._tolerance is not None:
            self.master.watch()

    def _give_slopes(self, end: float) -> list[float]:
        begin, written = self.time, list(self.forcing.written)
        ends = super()._give_slopes(end)
        if self.master.decided.extrapolation > 1 and not self.setup.hold_inputs:
            middle = begin + 0.5 * (end - begin)
            for i, (variable, signal, bias) in enumerate(self.forcing.inputs()):
                if variable.is_continuous_input:
                    bow = 2.0 / 3.0 * (signal(middle) + bias - 0.5 * (written[i] + ends[i]))
                    self.master.bow(variable, bow)
        return ends

    def _advance(self, until: float, targets: Floats, variables: Sequence[Variable], *, new: bool) -> Recorded:
        rows = UndoableRows(self.instance, variables, self.forcing)
        with rows.kept():
            self._run(until, targets.tolist(), rows, new=new)
        return rows.record()

    def _longest(self, until: float) -> float:
        longest = super()._longest(until)
        if self._tolerance is not None:
            if self._control is None:
                self._control = StepControl(self._tolerance, longest, self.master.least())
            self.communication_step = 0.0  # it is found on the way
        return longest

    def _to_target(self, target: float, until: float, longest: float, rows: Rows) -> None:
        while self.time < target:
            stop = self._next_stop(target)
            if self._control is None or not isinstance(rows, UndoableRows):
                super()._to_target(stop, until, longest, rows)
            else:
                self._controlled(stop, until, longest, rows)

    def _next_stop(self, target: float) -> float:
        if not self.instance.capabilities.variable_step:
            return target
        stop = self.master.next_stop(self.time)
        return target if is_due(target, stop) else stop

    def _stepped(self, step: float) -> StepResult:
        return self.master.do_step(self.time, step)

    # -- controlled steps ---------------------------------------------------------------------

    def _controlled(self, stop: float, until: float, first: float, rows: UndoableRows) -> None:
        while self._control is not None and self.time < stop:
            step = min(self._control.step, self.forcing.longest_step)
            pieces = max(1, math.ceil((stop - self.time) / step - _SLIVER))
            end = stop if pieces == 1 else self.time + (stop - self.time) / pieces
            self._twice(self._control, end, until, rows, least=_SHORTEST * first)
            pause(self.time)

    def _twice(self, control: StepControl, end: float, until: float, rows: UndoableRows, *, least: float) -> None:
        """Make a step in one, then in two halves, which stay if both agree."""
        begin, span, count = self.time, end - self.time, rows.count
        saved = self.instance.get_state(), self.forcing.written, self._memory()
        try:
            self._give_slopes(end)
            self._step_to(end)
            coarse = self.master.reached
            self._back(begin, saved)
            self._communicate(begin + 0.5 * span, rows, last=False)
            self._communicate(end, rows, last=end == until)
            good, self._control = control.judged(span, coarse, self.master.reached)
            if good or span <= least:
                self.communication_step = max(self.communication_step or 0.0, 0.5 * span)
                return
            rows.cut(count)
            self._back(begin, saved, keep=True)
        finally:
            self.instance.free_state(saved[0])

    def _back(self, time: float, saved: tuple[object, list[float], object], *, keep: bool = False) -> None:
        """Go back to where the step began; `keep`: the control remembers that it was too long."""
        control = self._control
        state, written, memory = saved
        self.instance.set_state(state)
        self.time = self.instance.time = time
        self.forcing.written = list(written)
        self._resume(memory)
        if keep:
            self._control = control

    # -- snapshots ----------------------------------------------------------------------------

    def _memory(self) -> object:  # type: ignore[override]  # more than that of its base
        return super()._memory(), self._control

    def _resume(self, memory: object) -> None:
        if not isinstance(memory, tuple) or len(memory) != 2:
            raise InputError("this snapshot belongs to another kind of session")
        super()._resume(memory[0])
        self._control = memory[1]


# -- rows that can be taken back: those of a step that is refused ----------------------------------


class UndoableRows(Rows):
    """`Rows` with a way back."""

    @property
    def count(self) -> int:
        """Number of rows so far."""
        return len(self._times)

    def cut(self, count: int) -> None:
        """Forget all but the first `count` rows."""
        for column in (self._times, self._values, self._inputs):
            del column[count:]

"""Co-simulation: the FMU integrates, the workbench steps it from one communication point to the next."""

from __future__ import annotations

import math
from dataclasses import replace

from workbench.errors import InputError
from workbench.session.fmu import FmuSession
from workbench.session.forcing import convert
from workbench.session.setup import Lead
from workbench.session.start_values import COMPUTED, StartPoint

__all__ = ["CsSession", "off_grid"]

STEPS_PER_SHAPE = 25  # of a signal's longest step: 200 steps per period of a sine
STEPS_PER_CALL = 500  # where nothing else says how long a step should be
MAX_EARLY_RETURNS = 10_000
_DETERMINED = "in co-simulation its initialisation determines it, and it cannot be set afterwards"


class CsSession(FmuSession):
    """Steps one FMU: how it begins, and how long its steps are.

    Communication points are the recorded points, the breaks of the signals, and as many more
    between them as keep every step within the communication step. Over a step continuous inputs are
    linear where the FMU interpolates its inputs, given where the FMU asks for them (`kernel/intermediate.c`), else
    held at their value in the middle, which is right to second order; at its start where the step is constant, since
    the FMU may sample there, or where they are to be held.
    """

    _fixed: float | None = None
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
        "where the run has to stop (for a recorded value, a break of a signal, a part of a period); use another `step`"
    )

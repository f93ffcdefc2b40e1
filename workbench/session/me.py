"""Model exchange: how a session that the workbench integrates begins."""

from __future__ import annotations

import math
from abc import abstractmethod

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.fmi.instance import EventInfo
from workbench.session.evaluated_point import Stand
from workbench.session.fmu import FmuSession
from workbench.session.start_values import StartPoint

__all__ = ["MeSession"]

SMALLEST_SCALE = 1e-6
NOMINAL_PART = 1e-3


class MeSession(FmuSession):
    """Integrates one FMU from stop to stop.

    A stop is the next of: `until`, a break of a signal, a time event. Between stops the solver
    steps freely and recorded points are interpolated; state events end a step early. At an event
    the FMU goes to event mode, gets the right limits of all inputs, and iterates.

    Inputs that are not continuous reals change at events only: at breaks of any signal and, if
    their value differs there, at recorded points.
    """

    def _started(self, due: float) -> None:
        self._next_time = due
        self.instance.get_states()
        self._make_solver()

    @property
    def next_event(self) -> float:
        """When the model asks for an event next, as far as it has said [s]; infinite: it does not."""
        return self._next_time

    @abstractmethod
    def _make_solver(self) -> None:
        """Open the solver where the session stands."""

    def _placed(self, first: EventInfo) -> float:
        """Stand at the operating point, events iterated; return when the next event is due [s].

        Args:
            first: what the first event iteration ended with.

        Raises:
            NotReachedError: something asked for did not take.
        """
        target, due = self._target, first.next_time
        if target is None:
            return due
        # The states were there already, and the model's own event at the start moved them on.
        handled = first.states_changed and not self._astray
        stand = Stand(self.instance)
        here, before = stand.read()
        x, u = target.moved(here, before, stand.inputs)
        x = here if handled else x
        there = np.array_equal(x, here) and np.array_equal(u, before)
        if not there:
            stand.put(self.time, x, u)
            if not handled:
                target.refuse(target.missed_states(), "the FMU does not keep the value of a state")
            info = stand.event(u)
            if info.terminate:
                raise self._ended()
            due = info.next_time
            handled |= info.states_changed
        if not handled:
            target.refuse(target.missed_states(), "an event there changes the state without reporting it")
        target.refuse(target.missed(target.inputs), "the FMU does not keep the value of an input")
        self._check_discrete(target, moved=not there, timed=due < math.inf)
        return due

    def _check_discrete(self, target: StartPoint, *, moved: bool, timed: bool) -> None:
        """Refuse discrete values that are not those of the point.

        What had its start value may since have been handled by the model's own first event, as it should be; on the way
        from another place it may have been lost. Where nothing is timed, what cannot be set follows from the rest.
        """
        late = [v for v in target.others if moved or (v.start is None and not timed)]
        words = "FMI allows it to be set only before initialisation, and the FMU does not start at this point's states"
        target.refuse(target.missed(late), words)

    def scales(self) -> tuple[Floats, Floats]:
        """Return the scale that each state begins with, and its upper bound, shape (n,) each.

        Error weights: |error_i| ≤ rtol · (|x_i| + scale_i). The scale of a state is the largest magnitude it has had,
        within 1/1000 of its nominal value and the nominal value: a small perturbation of a state is then followed as
        well as a large one. Where the FMU declares no nominal value (or 0), the scale is at least 1e-6 and has no upper
        bound: taking the 1.0 that FMI prescribes as default would drown a state that lives at 1e-4.
        """
        states = self.instance.description.states
        declared = np.zeros(self.instance.nx, dtype=bool)
        named = states[: self.instance.nx]
        declared[: len(named)] = [s.nominal is not None for s in named]
        nominal = np.abs(self.instance.get_nominals())
        usable = np.isfinite(nominal) & (nominal > 0.0)
        # A nominal value other than the default 1.0 was given on purpose even if not in the file.
        known = usable & (declared | (nominal != 1.0))
        return np.where(known, NOMINAL_PART * nominal, SMALLEST_SCALE), np.where(known, nominal, np.inf)

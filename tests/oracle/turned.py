"""Event indicators that an event turned back, or stopped, at their zeros: none of them may go on across."""

from __future__ import annotations

import math

import numpy as np

from tests.oracle.problem import Problem
from workbench.core.values.arrays import Floats
from workbench.fmi.instance import DiscardError
from workbench.session.algebraic_error import UnsolvedError
from workbench.session.compiled_errors import gone_through

__all__ = ["Turned"]

# As in workbench/build/runtime/event_rules.h.
AHEAD = 1e-4  # of the time in which a state moves by its own size: how far ahead a rate is looked at
STOPPED = 1e-3  # an event stops an indicator whose way ahead it makes shorter than this part


class Turned:
    """Tells where a model goes through what an event should have kept it from.

    An event that restarts a state (`reinit`) may turn the rate of the very indicator that caused it, as the bounce of a
    ball does, or stop it. The indicator must then return, or stay. Where the rebound is shorter than an event can be
    located to, it does neither: it never leaves its zero again, so no event follows, and the ball falls through its
    floor. With a restitution of 0 the very first event ends so. A rebound that drowns in the error of integration may
    even arrive with a speed of the wrong sign, which the event turns towards the far side.

    The rate of an indicator is its change along the states' derivatives, before the event and after it. An event that
    neither restarts a state nor changes a derivative leaves the watch as it is.

    Attributes:
        since: when the event was that turned the indicators under watch [s].
    """

    def __init__(self, problem: Problem) -> None:
        self._problem = problem
        self.since = math.nan
        self._side = np.zeros(problem.nz)  # where each indicator stood when the solver began anew: 1, -1; 0 not known
        self._bound = np.zeros(problem.nz)  # where an indicator must not go, beyond zero; 0: it may go anywhere
        self._way: Floats | None = None  # of each indicator ahead, before the event; None: not known
        self._z: Floats = np.zeros(problem.nz)
        self.turned_a_state = False  # by the last event: its rate has another sign
        self._dx: Floats = np.zeros(problem.n)
        self._ahead = 0.0

    def forget(self) -> None:
        """Begin as if there had been no event."""
        self._bound[:] = 0.0
        self._way = None

    @property
    def watches(self) -> bool:
        """Whether an indicator is under watch."""
        return bool(self._bound.any())

    @property
    def caution(self) -> float:
        """How long the next step may be [s]: an indicator that was turned may have but a short way back."""
        return self._ahead if self.watches else math.inf

    def stand(self, t: float, x: Floats) -> None:
        """Note on which side of its zero each indicator stands where the solver begins anew.

        Args:
            t: there [s].
            x: the states there, shape (n,).
        """
        try:
            self._side[:] = np.where(self._problem.indicators(t, x) > 0.0, 1.0, -1.0)
        except (DiscardError, UnsolvedError):
            self._side[:] = 0.0

    def check(self, t: float, x: Floats) -> None:
        """Refuse to go on where an indicator under watch went through.

        Args:
            t: end of an accepted step [s].
            x: the states there, shape (n,).

        Raises:
            SimulationError: it did; with the time of the event.
        """
        if not self.watches:
            return
        z = self._problem.indicators(t, x)
        if (np.sign(self._bound) * (z - self._bound) > 0.0)[self._bound != 0.0].any():
            raise gone_through(self.since)

    def before(self, t: float, x: Floats, size: Floats, longest: float) -> None:
        """Look at the rates just before an event.

        Args:
            t: the event [s].
            x: the states there, shape (n,).
            size: how large each of them is, shape (n,).
            longest: how far ahead at most [s].
        """
        self._way = None
        try:
            self._dx[:] = self._problem.rhs(t, x)
            self._ahead = _ahead(self._dx, size, longest)
            self._z[:] = self._problem.indicators(t, x)
            if self._ahead > 0.0:
                self._way = self._problem.indicators(t + self._ahead, x + self._ahead * self._dx) - self._z
        except (DiscardError, UnsolvedError):
            self._way = None

    def after(self, t: float, x: Floats, *, restarted: bool) -> None:
        """Look at the rates just after the event, and note which indicators it turned.

        Args:
            t: the event [s].
            x: the states after it, shape (n,).
            restarted: whether the event changed them.
        """
        way, old, old_dx = self._way, self._z.copy(), self._dx.copy()
        self._way = None
        try:
            dx = self._problem.rhs(t, x).copy()
            self.turned_a_state = bool((dx * old_dx < 0.0).any())
            z = self._problem.indicators(t, x).copy()
            if way is None or restarted or (dx != old_dx).any():
                self._bound[:] = 0.0
            self._bound[(z > 0.0) != (self._bound > 0.0)] = 0.0
            if way is not None and restarted:
                self._watch(t, way, old, z, self._problem.indicators(t + self._ahead, x + self._ahead * dx) - z)
        except (DiscardError, UnsolvedError):
            self._bound[:] = 0.0

    def _watch(self, t: float, way: Floats, old: Floats, z: Floats, new_way: Floats) -> None:
        """Watch the indicators that came through zero, stand there still, and were turned or stopped."""
        side = np.where(z > 0.0, 1.0, -1.0)
        near = np.maximum(np.abs(old), np.abs(z)) <= np.abs(way)
        came = (self._side == -side) & ((old > 0.0) == (z > 0.0)) & near
        turned = came & ((side * new_way <= STOPPED * np.abs(way)) | (side * way <= 0.0))
        if turned.any():
            self.since = t
            self._bound[turned] = (z + side * np.maximum(np.abs(z), STOPPED * np.abs(way)))[turned]


def _ahead(dx: Floats, size: Floats, longest: float) -> float:
    moving = dx != 0.0
    return min(AHEAD * float(np.min(size[moving] / np.abs(dx[moving]), initial=math.inf)), longest)

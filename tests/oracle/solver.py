"""What a solver of ordinary differential equations is to a session."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from tests.oracle.problem import Problem
from workbench.core.values.arrays import Floats
from workbench.errors import SimulationError

__all__ = ["Solver", "Tolerance"]

ROUNDING = 1e-13  # no error can be asked to be smaller, relative to the size of a state
HYSTERESIS = 1e-9  # of a state's size: exporters give 1e-10 or less


class Tolerance:
    """Error weights: |error_i| ≤ rtol · (|x_i| + scale_i); see `MeSession._scales`.

    Where events follow each other faster and faster (the bounces of a ball that comes to rest), what a state moved in
    the last flight between two of them takes the place of |x_i| + scale_i, or the last flights would drown in the
    tolerance of the first.

    Args:
        rtol: relative tolerance.
        scale: at the beginning, shape (n,).
        most: upper bound of the scale, shape (n,).

    Attributes:
        rtol: relative tolerance.
        scale: largest magnitude of each state so far, within its bounds, shape (n,).
        most: upper bound of the scale, shape (n,).
        flight: what each state moved in the last flight, shape (n,); inf while events do not follow each other so.
    """

    def __init__(self, rtol: float, scale: Floats, most: Floats) -> None:
        self.rtol = rtol
        self.scale: Floats = scale.copy()
        self.most: Floats = most
        self.flight: Floats = np.full(scale.shape, np.inf)
        self._lowest, self._highest = self.flight.copy(), -self.flight

    def grow(self, x: Floats) -> None:
        """Take note of the states."""
        np.maximum(self.scale, np.minimum(np.abs(x), self.most), out=self.scale)
        np.minimum(self._lowest, x, out=self._lowest)
        np.maximum(self._highest, x, out=self._highest)

    def new_flight(self, *, measured: bool) -> None:
        """Begin a flight; errors are measured by what the last one moved, or by the size of the states."""
        self.flight[:] = self._highest - self._lowest if measured else np.inf
        self._lowest[:], self._highest[:] = np.inf, -np.inf

    def stands_still(self) -> bool:
        """Whether no state moved in this flight but within the hysteresis that an exporter gives to a relation."""
        size = np.maximum(self.scale, np.where(np.isfinite(self.most), self.most, 1.0))
        return bool((self._highest - self._lowest <= HYSTERESIS * size).all())

    def allowed(self, rtol: float, x: Floats) -> Floats:
        """Return the largest errors at the states `x`, relative to their size; never below rounding."""
        size = np.abs(x) + self.scale
        return np.where(self.flight < size, np.maximum(rtol * self.flight, ROUNDING * size), rtol * size)


class Solver(ABC):
    """Integrates a `Problem` step by step.

    Obligations of a subclass:
      1. `restart` forgets the past; nothing computed later depends on what was before it.
      2. `step` makes one accepted step from (t, x), never beyond `stop`; it ends early, just
         after it (within 1e-12 relative), where an event indicator changes between > 0 and ≤ 0.
         A step that reaches `stop` ends with t exactly `stop`.
      3. `interpolate(p)` is valid for t_old ≤ p ≤ t of the last step.
      4. Trouble is a SimulationError with the time; DiscardError from the problem and values that are
         not finite shorten the step first.

    Attributes:
        t: present time [s].
        x: present states, shape (n,).
        t_old: where the last step began [s].
    """

    def __init__(self, problem: Problem, tolerance: Tolerance) -> None:
        self.problem = problem
        self.tolerance = tolerance
        self.t = self.t_old = 0.0
        self.x: Floats = np.zeros(problem.n)

    @abstractmethod
    def restart(self, t: float, x: Floats) -> None:
        """Begin anew at (t, x)."""

    @abstractmethod
    def step(self, stop: float, longest: float) -> bool:
        """Make one step of at most `longest` [s]; True if it ended at a state event."""

    @abstractmethod
    def interpolate(self, t: float) -> Floats:
        """Return the states at t [s] inside the last step, shape (n,)."""

    def close(self) -> None:  # noqa: B027  most own nothing
        """Free what the solver owns."""

    def check_finite(self) -> None:
        """Raise a SimulationError that names the state if one is not finite."""
        if np.isfinite(self.x.sum()) or np.isfinite(self.x).all():
            return
        bad = int(np.flatnonzero(~np.isfinite(self.x))[0])
        states = self.problem.instance.description.states
        name = states[bad].name if bad < len(states) else f"state[{bad + 1}]"
        raise SimulationError(f"state {name} is not a finite number", time=self.t)

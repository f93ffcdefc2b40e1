"""`none`: for models without continuous states there is nothing to integrate, only events."""

from __future__ import annotations

import math

import numpy as np

from tests.oracle.location import changed, locate
from tests.oracle.problem import Problem
from tests.oracle.solver import Solver, Tolerance
from workbench.core.values.arrays import Floats

__all__ = ["Algebraic"]

PARTS = 50


class Algebraic(Solver):
    """Walks through time and locates where event indicators change their domain.

    Two changes of one indicator within `longest` (or 1/50 of the way to `stop`) are not seen.
    """

    def __init__(self, problem: Problem, tolerance: Tolerance) -> None:
        super().__init__(problem, tolerance)
        self._z = np.zeros(problem.nz)
        self._part = math.inf
        self._stop = -math.inf

    def restart(self, t: float, x: Floats) -> None:
        self.t = self.t_old = t
        self.x = x.copy()
        self._stop = -math.inf
        self._z = self.problem.indicators(t, self.x).copy()

    def step(self, stop: float, longest: float) -> bool:
        if stop != self._stop:
            self._stop = stop
            self._part = (stop - self.t) / PARTS if self.problem.nz else math.inf
        self.t_old = self.t
        h = min(longest, self._part) if self.problem.nz else math.inf
        self.t = stop if self.t + h * (1.0 + 1e-9) >= stop else self.t + h
        if not self.problem.nz:
            return False
        z = self.problem.indicators(self.t, self.x)
        if not changed(self._z, z):
            self._z = z.copy()
            return False
        self.t = locate(self._indicators_at, self.t_old, self.t, self._z, z)
        return True

    def _indicators_at(self, t: float) -> Floats:
        return self.problem.indicators(t, self.x)

    def interpolate(self, t: float) -> Floats:
        return self.x

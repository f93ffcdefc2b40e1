"""`vkm`: the variable-step method of Kutta and Merson, order 4 with an error estimate."""

from __future__ import annotations

import math

import numpy as np

from tests.oracle.location import changed, locate
from tests.oracle.problem import Problem
from tests.oracle.solver import Solver, Tolerance
from workbench.core.values.arrays import Floats
from workbench.errors import SimulationError
from workbench.fmi.instance import DiscardError
from workbench.session.algebraic_error import UnsolvedError

__all__ = ["KuttaMerson"]

SAFETY, SHRINK, GROW = 0.9, 0.2, 5.0
ERROR_POWER = -0.2


class KuttaMerson(Solver):
    """Explicit Runge–Kutta–Merson: five stages, order 4, error estimate (order 5 if f is linear).

        k1 = f(t, x)                      k2 = f(t + h/3, x + h/3 k1)
        k3 = f(t + h/3, x + h/6 (k1 + k2))  k4 = f(t + h/2, x + h/8 (k1 + 3 k3))
        k5 = f(t + h, x + h/2 (k1 − 3 k3 + 4 k4))
        x⁺ = x + h/6 (k1 + 4 k4 + k5),    error = h/30 (2 k1 − 9 k3 + 8 k4 − k5)

    States inside a step come from a shorter step with the same start, so they do not depend on
    where points are asked for. Not for stiff models: the step is then limited by stability;
    use `gear`.

    Source: R. H. Merson, An operational method for the study of integration processes, 1957;
    E. Hairer, S. Nørsett, G. Wanner, Solving Ordinary Differential Equations I, 2nd ed., II.4.
    """

    def __init__(self, problem: Problem, tolerance: Tolerance) -> None:
        super().__init__(problem, tolerance)
        self._k = np.zeros((5, problem.n))
        self._x_old = self.x
        self._h = 0.0
        self._refused: SimulationError | None = None
        self._z = np.zeros(problem.nz)

    def restart(self, t: float, x: Floats) -> None:
        self.t = self.t_old = t
        self.x = self._x_old = x.copy()
        self._h = 0.0
        self.tolerance.grow(self.x)
        self._z = self.problem.indicators(t, self.x).copy()

    def step(self, stop: float, longest: float) -> bool:
        self.t_old, self._x_old = self.t, self.x
        self._k[0] = self.problem.rhs(self.t, self.x)
        if self._h == 0.0:
            self._h = self._first_step(stop)
        end, x = self._accepted(stop, longest)
        self.t, self.x = end, x
        self.check_finite()
        self.tolerance.grow(self.x)
        return self._event()

    def _first_step(self, stop: float) -> float:
        """Guess a step from |x| and |f| (Hairer, Nørsett, Wanner, II.4)."""
        weight = self.tolerance.allowed(self.tolerance.rtol, self.x)
        size = float(np.max(np.abs(self.x) / weight, initial=0.0))
        slope = float(np.max(np.abs(self._k[0]) / weight, initial=0.0))
        span = stop - self.t
        if slope == 0.0 or size < 1e-5 or not math.isfinite(slope):
            return 1e-3 * span
        return max(min(0.01 * size / slope, 0.1 * span), 64.0 * math.ulp(self.t))  # time must pass

    def _accepted(self, stop: float, longest: float) -> tuple[float, Floats]:
        """Try until a step's error fits; returns its end and the states there."""
        t, self._refused = self.t, None
        while True:
            h = min(self._h, longest)
            end = stop if t + h * (1.0 + 1e-9) >= stop else t + h
            h = end - t
            x, error = self._try(h)
            factor = GROW if error == 0.0 else min(GROW, SAFETY * error**ERROR_POWER)
            if error <= 1.0:
                # A step cut short by `stop` says nothing against the longer one.
                self._h = max(self._h, h * factor) if end == stop else h * factor
                return end, x
            self._h = h * max(SHRINK, factor)
            if self._h < 16.0 * math.ulp(max(abs(t), 1e-300)) or self._h == 0.0:
                if isinstance(self._refused, UnsolvedError):
                    raise self._refused
                raise SimulationError(
                    "vkm: the step became too small; the model is stiff or jumps without an event: use solver gear",
                    time=t,
                )

    def _try(self, h: float) -> tuple[Floats, float]:
        """Return the states after a step h and its error relative to the tolerance."""
        try:
            x = self._merson(h)
        except (DiscardError, UnsolvedError) as refused:
            self._refused = refused
            return self.x, math.inf
        k = self._k
        error = (h / 30.0) * (2.0 * k[0] - 9.0 * k[2] + 8.0 * k[3] - k[4])
        weight = self.tolerance.allowed(self.tolerance.rtol, np.maximum(np.abs(x), np.abs(self.x)))
        ratio = float(np.max(np.abs(error) / weight, initial=0.0))
        return x, ratio if math.isfinite(ratio) else 1e30

    def _merson(self, h: float) -> Floats:
        """Return the states a step h after the step's start."""
        rhs, t, x, k = self.problem.rhs, self.t_old, self._x_old, self._k
        k[1] = rhs(t + h / 3.0, x + (h / 3.0) * k[0])
        k[2] = rhs(t + h / 3.0, x + (h / 6.0) * (k[0] + k[1]))
        k[3] = rhs(t + h / 2.0, x + (h / 8.0) * (k[0] + 3.0 * k[2]))
        k[4] = rhs(t + h, x + (h / 2.0) * (k[0] - 3.0 * k[2] + 4.0 * k[3]))
        result: Floats = x + (h / 6.0) * (k[0] + 4.0 * k[3] + k[4])
        return result

    def interpolate(self, t: float) -> Floats:
        return self.x if t == self.t else self._merson(t - self.t_old)

    def _event(self) -> bool:
        """Cut the step at the first domain change, if there is one."""
        if not self.problem.nz:
            return False
        z = self.problem.indicators(self.t, self.x)
        if not changed(self._z, z):
            self._z = z.copy()
            return False
        end = locate(self._indicators_at, self.t_old, self.t, self._z, z)
        x = self.interpolate(end)
        self.t, self.x = end, x
        return True

    def _indicators_at(self, t: float) -> Floats:
        return self.problem.indicators(t, self._merson(t - self.t_old))

"""Solve the equations of a trim: bounded least squares, then the member of a family that was asked for."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.point.trim.convergence import EquilibriumTest, SearchResult
from workbench.point.trim.null_space import staged_step
from workbench.point.trim.problem import TrimProblem
from workbench.point.trim.scaled import ScaledEquations

__all__ = ["Report", "Solution", "nobody", "solve"]

Report = Callable[[Floats, float], None]
"""Is called with the unknowns, and the largest of the residuals over what they are measured by."""


MAX_DESCENT = 200  # evaluations of the least squares, Jacobians not counted; a search that needs more is lost
MAX_STEPS = 40  # of one walk: a regular root takes five to ten, one without slope three for each extrapolation
SMALLEST_PART = 1.0 / 1024.0  # of a step: ten halvings
MAX_BACK = 4  # corrections after a step along a family; each squares the error
STILL = 1e-10  # a step that ends the refinement, in nominal values: slopes by differences are no better
NEARLY_STILL = 1e-4  # the same, where rounding lets no step come nearer
SLOWLY = (0.2, 0.95)  # ratio 1 − 1/p of one step to the one before it, p = 5/4 to 20
ALIKE = 0.1  # part by which 1/(1 − r), the order p, may change from one ratio to the next


def nobody(_values: Floats, _left: float) -> None:
    """Report to nobody."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Solution:
    """Where the search ended.

    Attributes:
        values: shape (k,), the unknowns.
        residuals: shape (e,), required equations first, then floating derivatives [their units].
        verdict: whether it is an equilibrium, and what each residual is measured by.
        jacobian: shape (e, k), of residuals over scales by the unknowns in nominal values.
        nominal: shape (k,), the nominal values of the unknowns that the search worked with.
        open: shape (k, d), directions of a family of solutions, in nominal values.
        flat: shape (k, f), directions in which slopes vanish, but not along a family of solutions.
        iterations: Jacobians.
        chosen: whether the wanted member of a family was found; True where there is no family.
    """

    values: Floats
    residuals: Floats
    verdict: SearchResult
    jacobian: Floats
    nominal: Floats
    open: Floats
    flat: Floats
    iterations: int
    chosen: bool

    @property
    def converged(self) -> bool:
        """Whether it is an equilibrium, see `EquilibriumTest`."""
        return self.verdict.at_rest

    def refuted(self) -> Solution:
        """Return the same as no equilibrium: a run from there has shown that it is none."""
        return replace(self, verdict=replace(self.verdict, at_rest=False))


def solve(
    problem: TrimProblem, start: Floats, *, tolerance: float, slowest: bool, exact: bool, report: Report = nobody
) -> Solution:
    """Return the solution of F(z) = 0 that belongs to `start`.

    Unknowns are scaled by their nominal values, equations by the change that one nominal value of each unknown
    makes. Phase one takes Gauss-Newton steps of least norm from the start, extrapolated where they shrink by one
    ratio (a root without slope); where these get stuck it minimises ‖F‖² within the bounds (trust region
    reflective) and takes them from there. `EquilibriumTest` decides whether its end is an equilibrium.
    Phase two, in a family of solutions, moves along it: to the least floating derivatives (`slowest`), then to the
    solution nearest to `start`, in nominal values.

    It follows slopes: it finds one solution of several, and none where a minimum of ‖F‖² above zero lies in
    the way. The caller must look at `converged`.

    Args:
        problem: what to solve.
        start: shape (k,), where the search begins.
        tolerance: of every residual over its change around the point.
        slowest: whether floating derivatives are made small.
        exact: whether the balance's own Jacobian is used where it has one.
        report: is called after each step.

    Source: Branch, Coleman, Li, SIAM J. Sci. Comput. 21 (1999) 1-23 for phase one.
    """
    search = _FamilySearch(ScaledEquations(problem, exact=exact), tolerance, start, report)
    return search.run(slowest=slowest)


class _FamilySearch:
    def __init__(self, scaled: ScaledEquations, tolerance: float, start: Floats, report: Report = nobody) -> None:
        self.scaled, self.tolerance, self.report = scaled, tolerance, report
        self.home = np.clip(start / scaled.nominal, scaled.low, scaled.high)
        self.hard = scaled.hard
        begin = np.array([k.start for k in scaled.problem.unknowns], dtype=np.float64)
        self.judge = EquilibriumTest(scaled, scaled.inside(begin / scaled.nominal), tolerance)
        self.iterations = 0
        self.soft = scaled.scales(scaled.jacobian(self.home))[self.hard :]

    def run(self, *, slowest: bool) -> Solution:
        if not self.home.size:
            return self._solution(self.home, chosen=True)
        w = self._straight()
        if not self._converged(w):
            w, _ = self._walk(self._descend(), slowest=False, home=False)
        if not self._converged(w):
            return self._solution(w, chosen=False)
        if not self.judge.directions(w, self._jacobian(w))[0].shape[1]:
            return self._solution(w, chosen=True)
        chosen, w = self._choose(w, slowest=slowest)
        return self._solution(w, chosen=chosen)

    # -- phase one ------------------------------------------------------------------------

    def _straight(self) -> Floats:
        """Return the end of Gauss-Newton steps of least norm from the start, which stay near it."""
        if not math.isfinite(self._left(self.home)):
            return self.home
        return self._walk(self.home, slowest=False, home=False)[0]

    def _descend(self) -> Floats:
        """Return the end of the least squares; the start where nothing can be evaluated there."""
        begin = self._inside(self.home)
        weights = self.scaled.scales(self._jacobian(begin))[: self.hard]
        if not self.hard or not np.isfinite(self.scaled.residuals(begin)).all():
            return self.home
        from scipy.optimize import least_squares  # noqa: PLC0415 - slow to import, and seldom needed

        result = least_squares(
            lambda w: self.scaled.residuals(w)[: self.hard] / weights,
            begin,
            jac=lambda w: self._jacobian(w)[: self.hard] / weights[:, None],
            bounds=(self.scaled.low, self.scaled.high),
            method="trf",
            ftol=1e-15,
            xtol=1e-15,
            gtol=1e-15,
            max_nfev=MAX_DESCENT,
        )
        return np.asarray(result.x, dtype=np.float64)

    def _inside(self, w: Floats) -> Floats:
        """Return a point strictly within the bounds."""
        low, high = self.scaled.low, self.scaled.high
        gap = np.minimum(1e-9 * np.maximum(1.0, np.abs(w)), 1e-3 * (high - low))
        return np.clip(w, low + gap, high - gap)

    def _jacobian(self, w: Floats) -> Floats:
        self.iterations += 1
        return self.scaled.jacobian(w)

    # -- phase two ------------------------------------------------------------------------

    def _choose(self, w: Floats, *, slowest: bool) -> tuple[bool, Floats]:
        """Return whether the wanted member was found, and it, or else the solution at hand."""
        floats = len(self.soft) > 0
        for soft in (True, False) if slowest and floats else (False,):
            moved, ended = self._walk(w, slowest=soft, home=True)
            if self._converged(moved):
                w = moved
                if ended:
                    return soft == slowest or not floats, w
        return False, w

    def _walk(self, w: Floats, *, slowest: bool, home: bool) -> tuple[Floats, bool]:
        """Take steps until they vanish; return the end and whether they did."""
        size = math.inf
        if not math.isfinite(self._left(w)):
            return w, False
        pace = _Pace()
        for _ in range(MAX_STEPS):
            step = self._step(w, slowest=slowest, home=home)
            if not home:
                step = pace.stretched(step)
            size = float(np.abs(step).max()) / max(1.0, float(np.abs(w).max()))
            if size <= STILL:
                return np.clip(w + step, self.scaled.low, self.scaled.high), True
            moved = self._along(w, step, slowest=slowest, home=home)
            if moved is None:
                return w, size <= NEARLY_STILL  # rounding leaves nothing to gain
            w, left = moved
            self.report(w * self.scaled.nominal, left)
        return w, size <= NEARLY_STILL

    def _step(self, w: Floats, *, slowest: bool, home: bool) -> Floats:
        """Return the step to F = 0, and within what that leaves open to the least G, then home, within the bounds."""
        jacobian = self._jacobian(w)
        scales = self.scaled.scales(jacobian)
        scales[self.hard :] = self.soft  # what is made small is the same everywhere
        residuals, jacobian = self.scaled.residuals(w) / scales, jacobian / scales[:, None]
        cut = [slice(0, self.hard), slice(self.hard, None)] if slowest else [slice(0, self.hard)]
        movable = np.ones(len(w))
        while movable.any():
            wishes = [(residuals[c], jacobian[c] * movable) for c in cut]
            step = staged_step(wishes, (self.home - w) * movable if home else None) * movable
            out = ((w >= self.scaled.high) & (step > 0.0)) | ((w <= self.scaled.low) & (step < 0.0))
            if not out.any():
                return step
            movable[out] = 0.0
        return np.zeros_like(w)

    def _along(self, w: Floats, step: Floats, *, slowest: bool, home: bool) -> tuple[Floats, float] | None:
        """Return the end of the longest part of a step that keeps the equations and comes nearer to what is wanted.

        Beside it stands the largest scaled residual there.
        """
        before, wanted = self._left(w), self._wanted(w, slowest=slowest) if home else None
        part = 1.0
        while part >= SMALLEST_PART:
            moved = np.clip(w + part * step, self.scaled.low, self.scaled.high)
            if home:
                moved = self._back(moved)
            left = self._left(moved)
            if left <= max(before, self.tolerance) and (
                wanted is None or self._nearer(self._wanted(moved, slowest=slowest), wanted)
            ):
                return moved, left
            part *= 0.5
        return None

    def _back(self, w: Floats) -> Floats:
        """Return to the family after a step along its tangent."""
        for _ in range(MAX_BACK):
            if self._left(w) <= 1e-3 * self.tolerance:
                break
            step = self._step(w, slowest=False, home=False)
            w = np.clip(w + step, self.scaled.low, self.scaled.high)
        return w

    def _left(self, w: Floats) -> float:
        """Return the largest scaled residual; infinite where the model cannot be evaluated."""
        residuals = self.scaled.residuals(w)[: self.hard]
        if not np.isfinite(residuals).all():
            return math.inf
        scales = self.scaled.scales(self.scaled.jacobian(w))[: self.hard]
        return float(np.abs(residuals / scales).max(initial=0.0))

    def _wanted(self, w: Floats, *, slowest: bool) -> tuple[float, float]:
        """Return what is to be made small: the floating derivatives, then the way from the start."""
        soft = float(np.linalg.norm(self.scaled.residuals(w)[self.hard :] / self.soft)) if slowest else 0.0
        return soft, float(np.linalg.norm(w - self.home))

    @staticmethod
    def _nearer(new: tuple[float, float], old: tuple[float, float]) -> bool:
        return new[0] < old[0] * (1.0 - 1e-6) - 1e-9 or (new[0] <= old[0] + 1e-9 and new[1] < old[1])

    # -- end ------------------------------------------------------------------------------

    def _converged(self, w: Floats) -> bool:
        return self.judge(w).at_rest

    def _solution(self, w: Floats, *, chosen: bool) -> Solution:
        jacobian, verdict = self.scaled.jacobian(w), self.judge(w)
        none = np.zeros((len(w), 0))
        open_, flat = self.judge.directions(w, jacobian) if verdict.at_rest and w.size else (none, none)
        return Solution(
            values=w * self.scaled.nominal,
            residuals=self.scaled.residuals(w),
            verdict=verdict,
            jacobian=jacobian / verdict.scales[:, None],
            nominal=self.scaled.nominal,
            open=open_,
            flat=flat,
            iterations=self.iterations,
            chosen=chosen,
        )


class _Pace:
    """Steps of Newton's method that shrink by one ratio r, as they do towards a p-fold root (r = 1 − 1/p)."""

    def __init__(self) -> None:
        self._before: Floats | None = None
        self._ratio = math.nan

    def stretched(self, step: Floats) -> Floats:
        """Return the step, or the sum s/(1 − r) of all that would follow when r was the same twice."""
        before, self._before = self._before, step
        last, self._ratio = self._ratio, math.nan
        if before is None or not (square := float(before @ before)) or not math.isfinite(square):
            return step
        self._ratio = float(step @ before) / square
        steady = SLOWLY[0] < self._ratio < SLOWLY[1] and abs(self._ratio - last) < ALIKE * (1.0 - self._ratio)
        if not steady:
            return step
        result, self._before, self._ratio = step / (1.0 - self._ratio), None, math.nan
        return result

"""The search: a trust region from each start, noise and parameters estimated in turn until neither moves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from workbench.core.values.arrays import Floats
from workbench.errors import SimulationError
from workbench.identification.calibrate.noise import ColouredNoise, estimated
from workbench.identification.calibrate.problem import CalibrationProblem, Flags, Gradient
from workbench.identification.calibrate.request import Calibrate

__all__ = ["DescentEnd", "Estimate", "descent", "not_held", "search"]

_STILL = 0.01  # standard errors: what moves less has been found
_HELD = 0.3  # standard errors: so far a gradient is that of where it was taken
_FIRST = 1e-3  # relative fall of the cost that ends the first search
_EXACT = 1e-9  # relative step that ends a search without noise to be below
_ROUNDS = 8  # noise and parameters in turn
_POOR = 0.5  # part of the outputs' movement: a fit that leaves more is searched for from other starts as well
_FURTHER = 4  # such starts
_AT = 1e-4  # coordinate: a search that ends so near to a limit, and would go on beyond it, is held by it

_REASONS = {
    0: "the largest number of runs was reached",
    1: "the gradient is zero",
    2: "the misfit no longer falls",
    3: "the parameters no longer move",
    4: "neither the misfit nor the parameters move",
}


@dataclass(frozen=True, eq=False)
class Estimate:
    """Where a search ended.

    Attributes:
        problem: with the noise that was estimated.
        z: coordinates, shape (q,).
        gradient: there.
        reason: why it ended.
        converged: whether it came to its end.
        notes: what was done besides.
    """

    problem: CalibrationProblem
    z: Floats
    gradient: Gradient
    reason: str
    converged: bool
    notes: tuple[str, ...] = ()


_Slopes = tuple[Floats, Gradient]  # coordinates, and the gradient there


@dataclass(frozen=True, eq=False)
class DescentEnd:
    """Where a trust region ended.

    Attributes:
        z: coordinates, shape (q,).
        J: derivatives of the whitened residuals, shape (N, q).
        cost: half of it.
        status: see `scipy.optimize.least_squares`.
        slopes: the last gradient.
    """

    z: Floats
    J: Floats
    cost: float
    status: int
    slopes: _Slopes


def search(problem: CalibrationProblem, request: Calibrate, reached: Callable[[Estimate], None]) -> Estimate:
    """Return the coordinates with the least cost.

    Args:
        problem: with a first guess of the noise.
        request: starts, loss, colour.
        reached: is told where the search stands.

    Raises:
        SimulationError: the model cannot be run at any start.
    """
    place = problem.runs.place
    place.doing = "search from the start values"
    first = descent(problem, problem.quantities.start, request, _FIRST, reached=reached)
    notes: list[str] = []
    count = request.starts
    if not count and not _explains(problem, first):
        count = _FURTHER
        why = "the model cannot be run at the start values" if first is None else "the first search fits poorly"
        notes.append(f"{why}: {count} further starts were tried")
    for number, z in enumerate(problem.quantities.further(count), 1):
        if place.count >= request.max_runs:
            break
        place.doing = f"search from start {number} of {count}"
        other = descent(problem, z, request, _FIRST)
        if other is not None and (first is None or other.cost < first.cost):
            first = other
            notes.append(f"start {number} of {count} led to a better fit than those before it")
    if first is None:
        raise _lost(problem, f"the model cannot be run at the start values, nor at {count} others")
    return replace(_refined(problem, first, request, reached), notes=tuple(notes))


def _explains(problem: CalibrationProblem, ended: DescentEnd | None) -> bool:
    """Return whether a fit leaves less than half of what the outputs move."""
    if ended is None:
        return False
    rest = problem.difference(ended.z) or []
    left = sum(float(np.nansum(r**2)) / _size(problem, r.shape[1], i) for i, r in enumerate(rest))
    return left < _POOR * len(rest)


def _size(problem: CalibrationProblem, outputs: int, i: int) -> float:
    y = problem.data[i].y
    return float(np.nansum((y - np.nanmean(y, axis=0)) ** 2)) or float(outputs)


def descent(
    problem: CalibrationProblem, z0: Floats, request: Calibrate, fall: float = 0.0, *, slopes: _Slopes | None = None,
    reached: Callable[[Estimate], None] | None = None,
) -> DescentEnd | None:  # fmt: skip
    """Return where a trust region ends; None: the model cannot be run at its start.

    A gradient counts up to a third of a standard error from where it was taken.

    Args:
        problem: whose cost.
        z0: where it starts.
        request: with the largest number of runs.
        fall: relative fall of the cost that ends it; 0: that of a hundredth of the standard errors.
        slopes: a gradient that is known.
        reached: is told where it stands.
    """
    if not np.all(np.isfinite(problem.residuals(z0))):
        return None
    left = request.max_runs - problem.runs.place.count
    known = slopes or (z0, problem.gradient(z0, central=False))

    def jacobian(z: Floats) -> Floats:
        nonlocal known
        J = problem.whitened(known[1])[0]
        if np.linalg.norm(J @ (z - known[0])) > _HELD:
            known = z, problem.gradient(z, central=False)
            J = problem.whitened(known[1])[0]
        if reached is not None:
            reached(Estimate(problem, z, known[1], "it was stopped", converged=False))
        return -J

    found = least_squares(
        problem.residuals, z0, jac=jacobian, bounds=problem.quantities.limits, method="trf", x_scale="jac",
        loss=problem.loss.rho or "linear", ftol=fall or _STILL**2 / problem.samples, xtol=_EXACT, gtol=_EXACT,
        max_nfev=max(1, left // ((len(z0) + 1) * len(problem.data))),
    )  # fmt: skip
    return DescentEnd(found.x, found.jac, float(found.cost), int(found.status), known)


def _refined(
    problem: CalibrationProblem, ended: DescentEnd, request: Calibrate, reached: Callable[[Estimate], None]
) -> Estimate:
    """Return the search continued, the noise estimated anew until nothing moves.

    Until then the noise is white: the colour of what a search has left on its way would explain the misfit away.
    """
    white = True
    for number in range(_ROUNDS):
        problem.runs.place.doing = f"noise and parameters in turn, round {number + 1}"
        problem, before = problem.with_noise(_noise(problem, ended.z, request, white=white)), ended.z
        ended = descent(problem, before, request, slopes=ended.slopes, reached=reached) or ended
        moved = np.linalg.norm(ended.J @ (ended.z - before))
        rests = moved < _STILL * np.sqrt(len(before))
        if ended.status == 0 or (rests and not white):
            break
        white = white and not rests and number < _ROUNDS // 2
    problem = problem.with_noise(_noise(problem, ended.z, request))
    gradient, place = problem.gradient(ended.z, central=True), problem.runs.place
    reason, converged = _REASONS[ended.status], ended.status > 0
    if gradient.failed:
        names = ", ".join(problem.quantities[k].name for k in gradient.failed)
        reason, converged = f"runs beside the estimate failed: what {names} does there is not known", False
    elif place.failed and converged and _left(problem, ended.z, gradient) > _HELD:
        reason, converged = "runs failed where the misfit falls: the best values may lie beyond them", False
    if len(gradient.failed) == len(ended.z) or (place.lost and not converged and ended.status > 0):
        raise _lost(problem, reason)  # a process that dies may do so of what it ran before
    return Estimate(problem, ended.z, gradient, reason, converged)


def not_held(problem: CalibrationProblem, z: Floats, slope: Floats) -> Flags:
    """Return which coordinates are not held by a limit, shape (q,).

    Args:
        problem: with the limits.
        z: coordinates.
        slope: of the cost there, shape (q,).
    """
    low, high = problem.quantities.limits
    return np.asarray(~(((z - low <= _AT) & (slope > 0.0)) | ((high - z <= _AT) & (slope < 0.0))), dtype=np.bool_)


def _left(problem: CalibrationProblem, z: Floats, gradient: Gradient) -> float:
    """Return how far a Gauss-Newton step would still go [standard errors]."""
    J, (psi, slope) = problem.whitened(gradient)[0], problem.loss.psi(problem.residuals(z))
    J = J[:, not_held(problem, z, -J.T @ psi)]
    return float(np.linalg.norm(J @ np.linalg.lstsq(J, psi, rcond=None)[0]) / np.mean(slope)) if J.size else 0.0


def _lost(problem: CalibrationProblem, words: str) -> SimulationError:
    """Return the error of runs that failed, of the kind that most of them had."""
    place = problem.runs.place
    reason = place.failed.most_common(1)[0][0] if place.failed else ""
    return place.lost.get(reason, SimulationError)(": ".join(filter(None, [words, reason])))


def _noise(problem: CalibrationProblem, z: Floats, request: Calibrate, *, white: bool = False) -> ColouredNoise:
    rest = problem.difference(z)
    if rest is None:
        return problem.noise
    return estimated(
        rest, problem.segments, fitted=len(z), colour=request.noise == "auto" and not white,
        given=dict(request.weights or {}), robust=request.loss != "gauss",
    )  # fmt: skip

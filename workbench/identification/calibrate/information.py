"""What the data say of the parameters: Fisher's information, what it does not see, in words; regions and their ends."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import qr
from scipy.optimize import least_squares
from scipy.special import stdtrit

from workbench.core.values.arrays import Floats
from workbench.identification.calibrate.problem import Flags
from workbench.identification.calibrate.quantities import FreeValue, FreeValues
from workbench.identification.calibrate.request import Calibrate
from workbench.identification.calibrate.search import Estimate, descent, not_held

__all__ = ["LIKELY", "Information", "bent", "bootstrap", "information", "profile"]

LIKELY = 0.95  # of every region
_OPEN = 1.0  # half a region, in coordinates: a wider one leaves the value open by more than its own size
_ROUNDING = 1e-10  # of the largest singular value
_PART = 0.1  # of the largest in a direction: what has less of it is not named
_BENT = 0.3  # relative: how far the cost at the ends of a region may be off that of an ellipse
_STEPS = 10  # on the way to an end of a profile
_NEAR = 0.02  # relative: cost at that end
_FACTORS = (0.3, 2.5)  # by which a step of the way may shrink and grow
_SEARCHED = 20  # evaluations to find the best of the other coordinates


@dataclass(frozen=True, eq=False)
class Information:
    """Fisher's information at the estimate, in the coordinates of the search.

    Attributes:
        free: which coordinates are not held by a limit, shape (q,).
        covariance: of the coordinates, shape (q, q); infinite on the diagonal where nothing is known.
        quantile: half a region in standard errors.
        open: whether a region is wider than the value itself, shape (q,).
        directions: what is not seen, in words.
        null: the directions themselves, shape (k, q).
        shift: what the integration leaves in each coordinate, see `integration_shift`, shape (q,).
    """

    free: Flags
    covariance: Floats
    quantile: float
    open: Flags
    directions: tuple[str, ...]
    null: Floats
    shift: Floats

    @property
    def errors(self) -> Floats:
        """Standard errors of the coordinates, shape (q,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def correlation(self) -> Floats:
        """Correlation of the coordinates, shape (q, q); NaN where nothing is known."""
        with np.errstate(invalid="ignore"):
            return np.asarray(self.covariance / np.outer(self.errors, self.errors))


def information(found: Estimate) -> Information:
    """Return what the data say at an estimate.

    A direction whose singular value is below the error of the derivatives does not act at all; one along which the
    95 % region is longer than 1 leaves the value open. A coordinate at its limit is taken as known.

    Args:
        found: the estimate.
    """
    problem, quantities = found.problem, found.problem.quantities
    J, error = problem.whitened(found.gradient)
    e = problem.residuals(found.z)
    free = not_held(problem, found.z, -J.T @ e)
    count = int(free.sum())
    quantile = float(stdtrit(max(problem.samples - count, 1), 0.5 + 0.5 * LIKELY))
    widening = problem.loss.widening(e)
    _, s, Vt = np.linalg.svd(J[:, free], full_matrices=False)
    unseen = s <= np.maximum(np.linalg.norm(error[:, free] @ np.abs(Vt).T, axis=0), _ROUNDING * s.max(initial=0.0))
    half = quantile * math.sqrt(widening) / np.where(unseen, np.nan, s)
    covariance = np.zeros((len(free), len(free)))
    inner = (Vt[~unseen].T / s[~unseen] ** 2) @ Vt[~unseen] * widening
    dead = np.any(np.abs(Vt[unseen]) > _PART, axis=0)
    inner[dead], inner[:, dead] = np.nan, np.nan
    inner[dead, dead] = np.inf
    covariance[np.ix_(free, free)] = inner
    is_open = quantile * np.sqrt(np.diag(covariance)) >= _OPEN
    lost = unseen | (half * np.max(np.abs(Vt), axis=1, initial=0.0) >= _OPEN)
    null = np.zeros((int(lost.sum()), len(free)))
    null[:, free] = Vt[lost]
    directions = _sparse(null)
    words = tuple(_words(v, quantities, found.z, half_of(v, covariance, quantile)) for v in directions)
    return Information(free, covariance, quantile, is_open, words, directions, np.zeros(len(free)))


def half_of(v: Floats, covariance: Floats, quantile: float) -> float:
    """Return half the region of what a direction moves most, in coordinates; infinite: it is not seen at all."""
    most = int(np.argmax(np.abs(v)))
    return quantile * math.sqrt(covariance[most, most])


def _sparse(null: Floats) -> Floats:
    """Return directions that span the same with as few coordinates in each as can be, each with 1 as the largest."""
    if not len(null):
        return null
    _, _, order = qr(null, pivoting=True, mode="economic")
    result = np.linalg.solve(null[:, order[: len(null)]], null)
    return np.asarray(result / np.max(np.abs(result), axis=1, keepdims=True))


def _words(v: Floats, quantities: FreeValues, z: Floats, half: float) -> str:
    """Return a direction in words."""
    named = [int(k) for k in np.flatnonzero(np.abs(v) > _PART)]
    names = [quantities[k].name for k in named]
    far = "" if math.isinf(half) else f" (95 %: {_spread(half, [quantities[k] for k in named])})"
    if len(named) == 1:
        return f"{names[0]}: {'does not act on what was measured' if not far else f'the data leave it open{far}'}"
    a, b = (quantities[k].slope(z[k]) * v[k] for k in named[:2])
    if len(named) == 2 and all(quantities[k].low >= 0.0 for k in named):
        a, b = (step / quantities[k].value(z[k]) for step, k in zip((a, b), named, strict=True))
        return f"{' and '.join(names)}: only {_product(names, -a / b)} is seen{far}"
    if len(named) == 2:
        return f"{' and '.join(names)}: only {names[0]} {-a / b:+.3g}·{names[1]} is seen near these values{far}"
    parts = ", ".join(f"{quantities[k].name} {v[k]:+.2g}" for k in named)
    return f"{', '.join(names[:-1])} and {names[-1]} trade off: together by {parts} they are not seen{far}"


def _spread(half: float, quantities: Sequence[FreeValue]) -> str:
    """Return half a region in words: of logarithms it is a factor, which no percentage on both sides tells."""
    if all(q.log for q in quantities):
        return f"up or down by a factor {math.exp(min(half, 20.0)):.2g}"
    return f"± {100.0 * half:.0f} % of {'their' if len(quantities) > 1 else 'its'} size"


def _product(names: Sequence[str], exponent: float) -> str:
    """Return the power product first·second^exponent in words, as "a/b²"."""
    nearest = next((p for p in (1.0, 2.0, 3.0, 0.5, 1.0 / 3.0) if abs(abs(exponent) / p - 1.0) < 0.05), None)
    power = abs(exponent) if nearest is None else nearest
    first, second = names
    sign = "·" if exponent > 0.0 else "/"
    if nearest in (0.5, 1.0 / 3.0):  # a whole power of the first in its place
        return f"{first}{_power(round(1.0 / power))}{sign}{second}"
    return f"{first}{sign}{second}{_power(power)}"


def _power(power: float) -> str:
    signs = {1.0: "", 2.0: "²", 3.0: "³"}
    return signs.get(power, f"^{power:.2g}")


def bent(found: Estimate, known: Information) -> tuple[int, ...]:
    """Return the coordinates whose region is not that of an ellipse: the cost at its ends is not what it should be.

    Two runs for each, along the line on which the others follow.

    Args:
        found: the estimate.
        known: its information.
    """
    problem = found.problem
    least = problem.cost(found.z)
    chosen = [k for k in np.flatnonzero(known.free & ~known.open) if np.all(np.isfinite(known.covariance[:, k]))]
    places = [(int(k), found.z + s * _along(known, int(k))) for k in chosen for s in (1.0, -1.0)]
    low, high = found.problem.quantities.limits
    places = [(k, z) for k, z in places if np.all(z >= low) and np.all(z <= high)]
    found.problem.runs.outputs([z for _, z in places])
    wanted = known.quantile**2 * problem.loss.widening(problem.residuals(found.z))
    off = {k for k, z in places if abs((problem.cost(z) - least) / wanted - 1.0) > _BENT}
    return tuple(sorted(off))


def _along(known: Information, k: int) -> Floats:
    return np.asarray(known.quantile * known.covariance[:, k] / known.errors[k])


@dataclass(frozen=True, eq=False)
class Profile:
    """Cost of one coordinate where all others are the best for it.

    Attributes:
        z: of the coordinate, rising, shape (k,).
        cost: above the least, over what ends the region, shape (k,): 1 at both ends.
        low, high: ends of the region; infinite: not found.
    """

    z: Floats
    cost: Floats
    low: float
    high: float


def profile(found: Estimate, known: Information, k: int) -> Profile:
    """Follow the likelihood of one coordinate to the ends of its region.

    From the estimate the coordinate moves on until the least cost over all others has risen by the quantile's square;
    the place is found by secants on the root of the cost, which is a straight line for an ellipse.

    Args:
        found: the estimate.
        known: its information.
        k: number of the coordinate.
    """
    found.problem.runs.place.doing = f"profile of {found.problem.quantities[k].name}"
    points = {float(found.z[k]): 0.0}
    ends = [_end(found, known, k, side, points) for side in (-1.0, 1.0)]
    order = np.array(sorted(points))
    return Profile(order, np.array([points[x] for x in order.tolist()]), ends[0], ends[1])


def _end(found: Estimate, known: Information, k: int, side: float, points: dict[float, float]) -> float:
    """Return one end of a region, infinite where it is not found, and add the points on the way."""
    problem = found.problem
    least, low, high = problem.cost(found.z), *(limit[k] for limit in problem.quantities.limits)
    limit = known.quantile**2 * problem.loss.widening(problem.residuals(found.z))
    error = known.errors[k]
    z, distance = found.z, 0.5 * min(known.quantile * error if np.isfinite(error) else _OPEN, _OPEN)
    for _ in range(_STEPS):
        x = float(np.clip(found.z[k] + side * distance, low, high))
        z, cost = _constrained(found, known, z, k, x)
        points[x] = ratio = (cost - least) / limit
        if abs(ratio - 1.0) < _NEAR:
            return x
        if not np.isfinite(ratio) or (x in (low, high) and ratio < 1.0):
            break
        distance = abs(x - found.z[k]) * float(np.clip(1.0 / math.sqrt(max(ratio, _NEAR)), *_FACTORS))
    return side * math.inf


def _constrained(found: Estimate, known: Information, z: Floats, k: int, x: float) -> tuple[Floats, float]:
    """Return the best coordinates with one of them given, and their cost."""
    problem, others = found.problem, np.flatnonzero(known.free & (np.arange(len(z)) != k))
    moved = z.copy()
    moved[k] = x

    def at(part: Floats) -> Floats:
        result = moved.copy()
        result[others] = part
        return result

    start = moved[others] + known.covariance[others, k] / known.covariance[k, k] * (x - z[k])
    low, high = (limit[others] for limit in problem.quantities.limits)
    start = np.clip(np.where(np.isfinite(start), start, moved[others]), low, high)
    if not len(others) or not np.all(np.isfinite(problem.residuals(at(start)))):
        return at(start), problem.cost(at(start))
    best = least_squares(
        lambda part: problem.residuals(at(part)), start,
        jac=lambda part: -problem.whitened(problem.gradient(at(part), central=False))[0][:, others],
        bounds=(low, high), x_scale="jac", loss=problem.loss.rho or "linear", ftol=1e-3 / problem.samples, xtol=1e-8,
        max_nfev=_SEARCHED,
    )  # fmt: skip
    return at(best.x), 2.0 * float(best.cost)


def bootstrap(found: Estimate, request: Calibrate, draws: int) -> Floats:
    """Return estimates from records of the estimated model with noise drawn anew, shape (k, q).

    The white part of the noise is drawn from that of the residuals, and coloured as these are. B. Efron, R. Tibshirani,
    An Introduction to the Bootstrap (1993), section 9.4.

    Args:
        found: the estimate.
        request: with the largest number of runs.
        draws: how many; fewer come back where a search fails.
    """
    problem, rng = found.problem, np.random.default_rng(1)
    y = [one for one in problem.runs.outputs([found.z])[0] if one is not None]
    e = problem.residuals(found.z)
    white, result = (e - e.mean()) / e.std(), []
    for number in range(1, draws + 1):
        problem.runs.place.doing = f"draw {number} of {draws}"
        noise = problem.noise.drawn(white, problem.segments, y, rng)
        data = tuple(replace(one, y=a + v) for one, a, v in zip(problem.data, y, noise, strict=True))
        ended = descent(replace(problem, data=data), found.z, request, slopes=(found.z, found.gradient))
        if ended is not None:
            result.append(ended.z)
    return np.array(result)

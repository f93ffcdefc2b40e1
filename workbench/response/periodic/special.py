"""What lies between two places of a branch: folds, period doublings, Neimark-Sacker points, crossings with others."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cache

import numpy as np

from workbench.errors import SimulationError
from workbench.response.periodic.place import Family, Place, stride_from

__all__ = ["Missed", "Special", "between"]

# A special point is located to this part of a stride. At a fold the parameter changes with the square of what is left.
_LOCATED, _CROSSING, _FLAT = 1e-6, 1e-3, 1e-3

# So many strides before or after where it was noticed.
_STRIDES = 6

# A branch on which the parameter stands, as it does where a motion grows without bound, turns back by rounding alone.
_STANDS = 1e-5

# Where a multiplier leaves the unit circle: so near to the real axis it does so at 1 or −1.
_REAL = 1e-6


@dataclass(frozen=True, eq=False)
class Special:
    """A place where something happens.

    Attributes:
        kind: "fold", "period doubling", "Neimark-Sacker", "branch point".
        place: where.
    """

    kind: str
    place: Place


@dataclass(frozen=True)
class Missed:
    """A place where something happens that could not be located.

    Attributes:
        kind: see `Special`.
        p: parameters between which it was passed.
    """

    kind: str
    p: tuple[float, float]


def _tests(place: Place) -> dict[str, float]:
    """Return the test functions: each changes sign where something happens."""
    result = place.multipliers
    complex_ones = result[np.abs(result.imag) > _REAL]
    outside = sum(1 for mu in complex_ones if mu.imag > 0.0 and abs(mu) > 1.0)
    nearest = min((abs(mu) - 1.0 for mu in complex_ones if mu.imag > 0.0), key=abs, default=-1.0)
    doubled = float(np.sign(np.prod(np.sign((result[np.abs(result.imag) <= _REAL] + 1.0).real))))
    return {
        "fold": float(place.direction[-1]),
        "period doubling": doubled * float(np.min(np.abs(result + 1.0), initial=1.0)),
        "Neimark-Sacker": abs(nearest) if outside % 2 else -abs(nearest),
        "branch point": place.regular,
    }


def between(family: Family, a: Place, b: Place) -> Iterator[Special | Missed]:
    """Yield what lies between two neighbouring places.

    A fold that cannot be located is still one: the branch does turn back. Other tests also change sign where nothing
    happens, as where two multipliers meet.

    Args:
        family: period maps.
        a: the place before.
        b: the one after it.
    """
    before, after = _tests(a), _tests(b)
    for kind in before:
        if kind == "fold" and max(abs(before[kind]), abs(after[kind])) < _STANDS:
            continue
        if before[kind] * after[kind] < 0.0:
            place = _locate(family, a, b, kind)
            if place is None and kind == "fold":
                place = _turning(family, a, b)
            if place is not None:
                yield Special(kind, place)
            elif kind == "fold":
                yield Missed(kind, (a.p, b.p))


def _locate(family: Family, a: Place, b: Place, kind: str) -> Place | None:
    """Return the place between two where a test function is zero; None: it does not pass through zero."""
    from scipy.optimize import brentq  # noqa: PLC0415 - slow to import, and every sweep imports this module

    far = float(np.append((b.x - a.x) / a.lap.unit, b.p - a.p) @ a.direction)
    largest = max(abs(_tests(a)[kind]), abs(_tests(b)[kind]))
    tried: list[tuple[float, Place]] = []

    @cache
    def value(s: float) -> float:
        place = stride_from(family, a, s, exact=True)
        result = _tests(place)[kind]
        tried.append((abs(result), place))
        return 0.0 if kind == "fold" and abs(result) < _FLAT * largest else result

    # Where branches cross, Newton's method has no direction: there the nearest place that was reached counts.
    crossing = kind == "branch point"
    with suppress(SimulationError, ValueError):  # the branch is lost between, or nothing changes sign after all
        low, high = _bracket(value, far)
        brentq(value, low, high, xtol=(_CROSSING if crossing else _LOCATED) * abs(far), rtol=1e-12)
    if not tried:
        return None
    least, place = min(tried, key=lambda one: one[0])
    passed = least < (0.1 if crossing else 0.01) * largest
    return place if passed else None


def _turning(family: Family, a: Place, b: Place) -> Place | None:
    """Return where the parameter turns back between two places, by its values alone.

    Where the slopes jump along the motion, as at a limit, the derivative is too rough for the direction of the branch.
    """
    from scipy.optimize import minimize_scalar  # noqa: PLC0415 - slow to import

    far = float(np.append((b.x - a.x) / a.lap.unit, b.p - a.p) @ a.direction)
    sign, tried = float(np.sign(a.direction[-1])), [a, b]

    def lower(s: float) -> float:
        tried.append(stride_from(family, a, float(s)))
        return -sign * tried[-1].p

    with suppress(SimulationError):
        ends = (min(0.0, far), max(0.0, far))  # the tangent at a kink may point away from where the branch goes
        minimize_scalar(lower, bounds=ends, method="bounded", options={"xatol": 1e-4 * abs(far), "maxiter": 30})
    result = max(tried, key=lambda place: sign * place.p)
    return None if result is a or result is b else result


def _bracket(value: Callable[[float], float], far: float) -> tuple[float, float]:
    """Return where a test function changes sign: between 0 and `far`, or some strides before or after.

    A derivative that does for following has a fold elsewhere than the exact one where damping is light.
    """
    low, high = 0.0, far
    at_low, at_high = value(low), value(high)
    for _ in range(_STRIDES):
        if at_low * at_high <= 0.0:
            break
        if abs(at_low) < abs(at_high):
            low, high, at_high = 2.0 * low - high, low, at_low
            at_low = value(low)
        else:
            low, high, at_low = high, 2.0 * high - low, at_high
            at_high = value(high)
    return low, high

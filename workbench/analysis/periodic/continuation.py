"""Branches of periodic motions: pseudo-arclength continuation of the fixed points of a period map."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from workbench.analysis.periodic.monodromy import Tangent
from workbench.analysis.periodic.period_map import Lap
from workbench.analysis.periodic.stability import is_stable
from workbench.core.matrices import Complex
from workbench.errors import SimulationError
from workbench.session.base import Floats

__all__ = ["Family", "Manner", "Place", "Special", "Track", "arrive", "both_ways", "depart", "follow"]

# A place is reached where a further step of Newton's method moves it by less than this, in units of the motion.
# One whose multipliers count, where it hardly moves at all.
_REACHED, _EXACTLY, _NEAR = 1e-5, 1e-7, 1e-2

# A step that is this small, and hardly smaller than the one before, is the integration's error.
_NOISE, _STALLS = 1e-4, 0.2

# There a period closes to this, in units of the motion.
# A multiplier so near to 1 may be that of an integrator.
_INTEGRATES = 1e-3
_CLOSED = 1e-3

# Steps of Newton's method to a place, and how many of them let the next stride be longer.
_ROUNDS, _EASY = 6, 3

# Strides along the branch, in units of the motion of the states and of the span of the parameter.
_FIRST, _LONGEST, _SHORTEST = 0.02, 0.08, 1e-6

# Multipliers that are worse than this, relative to the largest, ask for better derivatives.
_DOUBTED = 0.05

# A place farther from where its stride led than this part of it is another branch's.
_NEARBY = 0.3

# Cosine of the angle that the direction may turn in a stride.
_STRAIGHT = 0.9

# A special point is located to this part of a stride.
_LOCATED, _CROSSING = 1e-7, 1e-3

# So many strides before or after where it was noticed.
_STRIDES = 6

# Where a multiplier leaves the unit circle: so near to the real axis it does so at 1 or −1.
_REAL = 1e-6

_MOST_PLACES = 600


@dataclass(kw_only=True)
class Family(ABC):
    """A family of period maps over one parameter p, in units of its span.

    Attributes:
        intervals: in so many the slopes along a period are taken; 0: as coarsely as does for following.
        by_differences: whether the derivative is taken by differences of whole periods.
    """

    intervals: int = 0
    by_differences: bool = False

    # Intervals to follow a branch, and to locate what is on it.
    coarse: ClassVar[int]
    fine: ClassVar[int]

    def __post_init__(self) -> None:
        self.intervals = self.intervals or self.coarse

    @abstractmethod
    def lap(self, x: Floats, p: float, *, exact: bool = False) -> tuple[Lap, Floats]:
        """Run one period from x; return it with its derivative, and ∂x1/∂p, shape (n,).

        Args:
            x: where to begin, shape (n,).
            p: parameter.
            exact: with a derivative that is good for the multipliers.

        Raises:
            SimulationError: the model cannot be run there.
        """

    def moved_on(self, place: Place) -> str:
        """Hear that the branch has come to another place; return why it ends there, empty: it goes on.

        Args:
            place: the newest; also the first, before anything else is run.
        """
        return ""

    def finer(self) -> bool:
        """Take the slopes at more instants from now on; False: they are as many as there can be."""
        better = self.intervals < self.fine and not self.by_differences
        self.intervals = min(self.fine, 3 * self.intervals)
        return better


@dataclass(frozen=True, eq=False)
class Place:
    """A periodic motion on a branch.

    Attributes:
        x: states at the begin of the period, shape (n,).
        p: parameter.
        lap: one period.
        direction: of the branch, in units of the motion and of the parameter, of length 1, shape (n + 1,).
        regular: smallest singular value of the derivative bordered by the direction, with the sign of its determinant:
            0 where branches cross.
        periods: number run to get here from the place before.
    """

    x: Floats
    p: float
    lap: Lap
    direction: Floats
    regular: float
    periods: int

    @property
    def at(self) -> Tangent:
        """Derivative of the period map."""
        if self.lap.tangent is None:
            raise SimulationError("the model cannot be linearised along its motion")
        return self.lap.tangent

    @property
    def multipliers(self) -> Complex:
        """Floquet multipliers, largest first."""
        return self.at.multipliers

    @property
    def stable(self) -> bool:
        """Whether all multipliers lie inside the unit circle."""
        return is_stable(self.multipliers) is True


@dataclass(frozen=True, eq=False)
class Special:
    """A place where something happens.

    Attributes:
        kind: "fold", "period doubling", "Neimark-Sacker", "branch point".
        place: where.
    """

    kind: str
    place: Place


@dataclass(eq=False)
class Track:
    """A branch.

    Attributes:
        places: in the order of the branch.
        special: folds and bifurcations, likewise.
        closed: whether it comes back to where it began.
        ends: why it ends, at its begin and at its end.
    """

    places: list[Place] = field(default_factory=list)
    special: list[Special] = field(default_factory=list)
    closed: bool = False
    ends: tuple[str, str] = ("", "")


def arrive(family: Family, x: Floats, p: float, *, exact: bool = False) -> Place:
    """Return the periodic motion near x at a fixed parameter, by Newton's method.

    Args:
        family: period maps.
        x: estimate, shape (n,).
        p: parameter.
        exact: with a derivative that is good for the multipliers.

    Raises:
        SimulationError: there is none nearby, or the model cannot be run there.
    """
    level = np.append(np.zeros(len(x)), 1.0)
    return _correct(family, x, p, level, exact=exact, rounds=3 * _ROUNDS)


def depart(other: Family, crossing: Place, multiplier: float, aside: float) -> Place:
    """Return a place on the branch that leaves another at a branch point or period doubling.

    Args:
        other: period maps of the same order, or of twice the order.
        crossing: where a multiplier is 1, or -1.
        multiplier: that.
        aside: how far from it, in units of the motion; negative: to the other side.

    Raises:
        SimulationError: it is not found.
    """
    unit = crossing.lap.unit
    found, vectors = np.linalg.eig(crossing.at.Phi * unit / unit[:, None])
    way = vectors[:, int(np.argmin(np.abs(found - multiplier)))].real
    way *= np.sign(aside) / float(np.linalg.norm(way))
    level = np.append(way, 0.0)
    place = _correct(other, crossing.x + abs(aside) * unit * way, crossing.p, level, rounds=3 * _ROUNDS)
    return place if place.direction[:-1] @ way > 0.0 else _turned(place)


def _correct(
    family: Family, x: Floats, p: float, level: Floats, *, exact: bool = False, rounds: int = _ROUNDS
) -> Place:
    """Return the periodic motion in the plane through (x, p) across `level`, by Newton's method."""
    moved, start = math.inf, (x, p)
    for count in range(1, rounds + 1):
        fine = exact and moved < _NEAR  # on the way there a coarse derivative does
        lap, along = family.lap(x, p, exact=fine)
        if lap.tangent is None:
            raise SimulationError("the model cannot be linearised along its motion")
        matrix = _jacobian(lap, lap.tangent.Phi, along)
        whole = np.vstack([matrix, level])
        aside = np.append((x - start[0]) / lap.unit, p - start[1])
        try:
            step = np.linalg.solve(whole, np.append(lap.defect / lap.unit, -level @ aside))
        except np.linalg.LinAlgError:
            raise SimulationError("the branch has no direction here") from None
        before, moved = moved, float(np.max(np.abs(step)))
        away = not -1.0 <= p + float(step[-1]) <= 2.0
        if not math.isfinite(moved) or away or (moved > 2.0 * before and moved > 1e-3):
            raise SimulationError(f"Newton's method leaves the branch{_standing(lap.tangent)}")
        rate = moved / before if math.isfinite(before) else 1.0
        x, p = x + step[:-1] * lap.unit, p + float(step[-1])
        # A step that converges as fast as the ones before leaves moved·rate. Where multipliers are huge, steps are
        # small though the period does not close.
        there = moved < _REACHED or (rate < 0.1 and moved * rate < 0.1 * _REACHED)
        closes = float(np.max(np.abs(lap.defect / lap.unit))) < _CLOSED
        # What the integration gets wrong, multiplied near a fold, is as near as one can come.
        nearest = fine and (moved < _EXACTLY or (moved < _NOISE and rate > _STALLS))
        if (nearest if exact else there) and closes:
            direction = _direction(matrix, level)
            lap = _settled(lap, lap.tangent.rows @ (step[:-1] * lap.unit))
            return Place(x, p, lap, direction, _regular(matrix, direction), count)
    raise SimulationError(f"Newton's method did not converge in {rounds} periods")


def _standing(at: Tangent) -> str:
    """Return what to think of a multiplier near 1; empty: there is none."""
    found = at.multipliers[np.abs(at.multipliers - 1.0) < _INTEGRATES]
    if not len(found):
        return ""
    return " (a multiplier of 1: an integrator, whose response depends on where it starts? nfr measures such a model)"


def _settled(lap: Lap, change: Floats) -> Lap:
    """Return a lap with its output corrected for what the last step of the states changes."""
    harmonics = lap.period.harmonics.copy()
    harmonics[:3] += change
    return replace(lap, period=replace(lap.period, harmonics=harmonics))


def _jacobian(lap: Lap, Phi: Floats, along: Floats) -> Floats:
    """Return the derivative of x − φ(x, p), shape (n, n + 1), in units of the motion."""
    return np.column_stack([np.eye(len(along)) - Phi * lap.unit / lap.unit[:, None], -along / lap.unit])


def _direction(matrix: Floats, before: Floats) -> Floats:
    """Return the direction of the branch, that way in which `before` points."""
    found = np.linalg.svd(matrix)[2][-1]
    size = float(np.linalg.norm(found))
    direction: Floats = found / size if found @ before >= 0.0 else -found / size
    return direction


def _regular(matrix: Floats, direction: Floats) -> float:
    bordered = np.vstack([matrix, direction])
    return float(np.linalg.slogdet(bordered)[0] * np.linalg.svd(bordered, compute_uv=False)[-1])


@dataclass(frozen=True)
class Manner:
    """How a branch is followed.

    Attributes:
        stopped: asked between places; true ends it by KeyboardInterrupt.
        told: called with each place.
        begun: called with the branch, which fills up while it is followed.
        most: number of places.
        marks: parameters at which there is to be a place.
    """

    stopped: Callable[[], bool] = lambda: False
    told: Callable[[Place], None] = lambda _: None
    begun: Callable[[Track], None] = lambda _: None
    most: int = _MOST_PLACES
    marks: Sequence[float] = ()


def follow(family: Family, first: Place, manner: Manner, *, way: float = 1.0) -> Track:
    """Follow a branch from a place until the parameter leaves its bounds, or the branch closes.

    A stride is made along the direction of the branch, and Newton's method leads back to it in the plane across; so it
    goes around folds. Between two places the tests tell what was passed: the direction's parameter part changes sign
    at a fold, det(Φ + 1) at a period doubling, the number of complex multipliers outside the unit circle at a
    Neimark-Sacker point, the determinant of the bordered matrix at a branch point; the place is then located along the
    branch.

    Args:
        family: period maps.
        first: where to begin.
        manner: how to follow it.
        way: 1: towards higher parameters, -1: lower, 0: as the first place points.

    Source: R. Seydel, Practical Bifurcation and Stability Analysis, 4.5 and 7.5; Yu. A. Kuznetsov, Elements of Applied
    Bifurcation Theory, 10.
    """
    here = first if way == 0.0 or first.direction[-1] * way > 0.0 else _turned(first)
    track, stride = Track([here]), _FIRST
    manner.begun(track)
    family.moved_on(here)  # a walk the other way may have been elsewhere before
    while True:
        if manner.stopped():
            raise KeyboardInterrupt
        if len(track.places) >= manner.most:
            return _ended(track, f"{manner.most} places are enough")
        found = _next(family, here, stride)
        if isinstance(found, str):
            return _ended(track, found)
        place, stride = found
        if not 0.0 <= place.p <= 1.0:
            edge = 0.0 if place.p < 0.0 else 1.0
            last = None if here.p == edge else _at_edge(family, here, place, edge)
            if last is not None:
                _look_between(family, track, here, last)
                track.places += _marked(family, here, last, manner.marks)
                track.places.append(last)
                manner.told(last)
            return _ended(track, "the parameter's bound")
        _look_between(family, track, here, place)
        track.places += _marked(family, here, place, manner.marks)
        track.places.append(place)
        manner.told(place)
        if place.at.doubt > _DOUBTED * max(1.0, float(np.max(np.abs(place.multipliers), initial=0.0))):
            family.finer()
        track.closed = len(track.places) > 5 and _passes(here, place, first)
        if why := "it closes" if track.closed else family.moved_on(place):
            return _ended(track, why)
        here = place


def _marked(family: Family, here: Place, there: Place, marks: Sequence[float]) -> list[Place]:
    """Return the places at the marks between two places, in the order of the branch."""
    between = [p for p in marks if (here.p - p) * (there.p - p) < 0.0]
    found = (_at_edge(family, here, there, p) for p in sorted(between, reverse=there.p < here.p))
    return [place for place in found if place is not None]


def _turned(place: Place) -> Place:
    """Return a place as one comes to it from the other side."""
    return replace(place, direction=-place.direction, regular=-place.regular)


def _ended(track: Track, why: str) -> Track:
    track.ends = (track.ends[0], why)
    return track


def _next(family: Family, here: Place, stride: float) -> tuple[Place, float] | str:
    """Return the next place and a stride for the one after it; in words why there is none."""
    why = ""
    while stride >= _SHORTEST:
        try:
            place = _stride(family, here, stride)
        except SimulationError as error:
            why, stride = str(error), 0.25 * stride
            continue
        missed = _missed(here, place, stride) / stride
        # What is missed in proportion to the stride is a direction that is wrong.
        if missed > _NEARBY and stride < 0.1 * _FIRST and family.finer():
            here = _correct(family, here.x, here.p, here.direction, rounds=3 * _ROUNDS)
            stride = _FIRST
            continue
        if missed > _NEARBY:
            why, stride = "Newton's method leads elsewhere", 0.25 * stride
            continue
        turned = float(_rescaled(here, place) @ place.direction)
        if turned < _STRAIGHT and stride > 16.0 * _SHORTEST:
            stride *= 0.5
            continue
        return place, min(_LONGEST, stride * (1.6 if place.periods <= _EASY and turned > 0.98 else 1.0))
    return f"no place further on: {why}"


def _missed(here: Place, there: Place, stride: float) -> float:
    """Return how far a place is from where the stride led, in units of the motion and of the parameter."""
    way = np.append((there.x - here.x) / here.lap.unit, there.p - here.p) - stride * here.direction
    return float(np.linalg.norm(way))


def _rescaled(here: Place, there: Place) -> Floats:
    """Return the direction of a place in the units of another."""
    moved = np.append(here.direction[:-1] * here.lap.unit / there.lap.unit, here.direction[-1])
    direction: Floats = moved / float(np.linalg.norm(moved))
    return direction


def _stride(family: Family, here: Place, stride: float, *, exact: bool = False) -> Place:
    d = here.direction
    x, p = here.x + stride * d[:-1] * here.lap.unit, here.p + stride * float(d[-1])
    return _correct(family, x, p, d, exact=exact, rounds=2 * _ROUNDS if exact else _ROUNDS)


def _at_edge(family: Family, here: Place, beyond: Place, edge: float) -> Place | None:
    """Return the place at a bound, between two."""
    share = (edge - here.p) / (beyond.p - here.p)
    try:
        found = arrive(family, here.x + share * (beyond.x - here.x), edge)
    except SimulationError:
        return None
    return found if found.direction @ _rescaled(here, found) > 0.0 else _turned(found)


def _passes(here: Place, there: Place, first: Place) -> bool:
    """Whether the branch has come back to where it began, between two places."""
    unit = np.append(first.lap.unit, 1.0)
    a, b, aim = (np.append(p.x, p.p) / unit for p in (here, there, first))
    way = b - a
    share = float(np.clip((aim - a) @ way / max(float(way @ way), 1e-300), 0.0, 1.0))
    near = float(np.linalg.norm(a + share * way - aim)) < 0.1 * float(np.linalg.norm(way))
    return near and float(_rescaled(there, first) @ first.direction) > 0.0


# -- what lies between two places -----------------------------------------------------------------------------------


def _tests(place: Place) -> dict[str, float]:
    """Return the test functions: each changes sign where something happens."""
    found = place.multipliers
    complex_ones = found[np.abs(found.imag) > _REAL]
    outside = sum(1 for mu in complex_ones if mu.imag > 0.0 and abs(mu) > 1.0)
    nearest = min((abs(mu) - 1.0 for mu in complex_ones if mu.imag > 0.0), key=abs, default=-1.0)
    doubled = float(np.sign(np.prod(np.sign((found[np.abs(found.imag) <= _REAL] + 1.0).real))))
    return {
        "fold": float(place.direction[-1]),
        "period doubling": doubled * float(np.min(np.abs(found + 1.0), initial=1.0)),
        "Neimark-Sacker": abs(nearest) if outside % 2 else -abs(nearest),
        "branch point": place.regular,
    }


def _look_between(family: Family, track: Track, a: Place, b: Place) -> None:
    before, after = _tests(a), _tests(b)
    for kind in before:
        if before[kind] * after[kind] < 0.0:
            place = _locate(family, a, b, kind)
            if place is None and kind == "fold":
                place = _turning(family, a, b)
            if place is not None:
                track.special.append(Special(kind, place))


def _locate(family: Family, a: Place, b: Place, kind: str) -> Place | None:
    """Return the place between two where a test function is zero; None: it does not pass through zero."""
    from scipy.optimize import brentq  # noqa: PLC0415 - slow to import, and every sweep imports this module

    far = float(np.append((b.x - a.x) / a.lap.unit, b.p - a.p) @ a.direction)
    tried: list[tuple[float, Place]] = []

    def value(s: float) -> float:
        place = _stride(family, a, s, exact=True)
        found = _tests(place)[kind]
        tried.append((abs(found), place))
        return found

    # Where branches cross, Newton's method has no direction: there the nearest place that was reached counts.
    crossing = kind == "branch point"
    with suppress(SimulationError, ValueError):  # the branch is lost between, or nothing changes sign after all
        low, high = _bracket(value, far)
        brentq(value, low, high, xtol=(_CROSSING if crossing else _LOCATED) * abs(far), rtol=1e-12)
    if not tried:
        return None
    least, place = min(tried, key=lambda one: one[0])
    largest = max(abs(_tests(a)[kind]), abs(_tests(b)[kind]))
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
        tried.append(_stride(family, a, float(s)))
        return -sign * tried[-1].p

    with suppress(SimulationError):
        minimize_scalar(lower, bounds=(0.0, far), method="bounded", options={"xatol": 1e-4 * abs(far), "maxiter": 30})
    found = max(tried, key=lambda place: sign * place.p)
    return None if found is a or found is b else found


def _bracket(value: Callable[[float], float], far: float) -> tuple[float, float]:
    """Return where a test function changes sign: between 0 and `far`, or some strides before or after.

    A derivative that does for following has a fold elsewhere than the exact one where damping is light.
    """
    low, high = 0.0, far
    at_low, at_high = value(low), value(high)
    for _ in range(_STRIDES):
        if at_low * at_high < 0.0:
            break
        if abs(at_low) < abs(at_high):
            low, high, at_high = 2.0 * low - high, low, at_low
            at_low = value(low)
        else:
            low, high, at_low = high, 2.0 * high - low, at_high
            at_high = value(high)
    return low, high


def both_ways(family: Family, first: Place, manner: Manner) -> Track:
    """Follow a branch from a place to both of its ends.

    Args:
        family: period maps.
        first: where to begin.
        manner: how to follow it.
    """
    up = follow(family, first, manner, way=1.0)
    if up.closed:
        return up
    down = follow(family, first, manner, way=-1.0)
    turned = [_turned(p) for p in reversed(down.places)]
    special = [*reversed(down.special), *up.special]
    return Track(turned[:-1] + up.places, special, ends=(down.ends[1], up.ends[1]))

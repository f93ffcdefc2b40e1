"""Branches of periodic motions: pseudo-arclength continuation of the fixed points of a period map."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.errors import SimulationError
from workbench.response.periodic.place import ROUNDS, Family, Place, arrive, correct, stride_from, turned
from workbench.response.periodic.special import Missed, Special, between

__all__ = ["ContinuedBranch", "Manner", "both_ways", "follow"]

# So few steps of Newton's method let the next stride be longer.
_EASY = 3

# Strides along the branch, in units of the motion of the states and of the span of the parameter.
_FIRST, _LONGEST, _SHORTEST = 0.02, 0.08, 1e-6

# So few states may all change by the longest stride.
_FEW = 3

# Multipliers that are worse than this, relative to the largest, ask for better derivatives.
_DOUBTED = 0.05

# A place farther from where its stride led than this part of it is another branch's.
_NEARBY = 0.3

# Cosine of the angle that the direction may turn in a stride.
_STRAIGHT = 0.9

_MOST_PLACES = 600


@dataclass(eq=False)
class ContinuedBranch:
    """A branch.

    Attributes:
        places: in the order of the branch.
        special: folds and bifurcations, likewise.
        missed: folds that were passed and could not be located.
        closed: whether it comes back to where it began.
        ends: why it ends, at its begin and at its end.
    """

    places: list[Place] = field(default_factory=list)
    special: list[Special] = field(default_factory=list)
    missed: list[Missed] = field(default_factory=list)
    closed: bool = False
    ends: tuple[str, str] = ("stopped; not followed further", "stopped; not followed further")

    def passed(self, family: Family, a: Place, b: Place) -> None:
        """Keep what lies between two neighbouring places.

        Args:
            family: period maps.
            a: the place before.
            b: the one after it.
        """
        for one in between(family, a, b):
            if isinstance(one, Missed):
                self.missed.append(one)
            else:
                self.special.append(one)


@dataclass(frozen=True)
class Manner:
    """How a branch is followed.

    Attributes:
        stopped: asked between places; true ends it by KeyboardInterrupt.
        told: called with each place.
        begun: is given what returns the branch as far as it goes.
        most: number of places.
        marks: parameters at which there is to be a place.
    """

    stopped: Callable[[], bool] = lambda: False
    told: Callable[[Place], None] = lambda _: None
    begun: Callable[[Callable[[], ContinuedBranch]], None] = lambda _: None
    most: int = _MOST_PLACES
    marks: Sequence[float] = ()


def follow(family: Family, first: Place, manner: Manner, *, way: float = 1.0) -> ContinuedBranch:
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
    here = first if way == 0.0 or first.direction[-1] * way > 0.0 else turned(first)
    track, stride = ContinuedBranch([here]), _FIRST
    manner.begun(lambda: track)
    family.moved_on(here)  # a walk the other way may have been elsewhere before
    while True:
        if manner.stopped():
            raise KeyboardInterrupt
        if len(track.places) >= manner.most:
            return _ended(track, f"stopped after {manner.most} places; not followed further")
        result = _next(family, here, stride)
        if isinstance(result, str):
            return _ended(track, result)
        place, stride = result
        if not 0.0 <= place.p <= 1.0:
            edge = 0.0 if place.p < 0.0 else 1.0
            last = None if here.p == edge else _at_edge(family, here, place, edge)
            if last is not None:
                track.passed(family, here, last)
                track.places += _marked(family, here, last, manner.marks)
                track.places.append(last)
                manner.told(last)
            return _ended(track, "the parameter's bound")
        track.passed(family, here, place)
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
    result = (_at_edge(family, here, there, p) for p in sorted(between, reverse=there.p < here.p))
    return [place for place in result if place is not None]


def _ended(track: ContinuedBranch, why: str) -> ContinuedBranch:
    track.ends = (why if track.closed else track.ends[0], why)
    return track


def _next(family: Family, here: Place, stride: float) -> tuple[Place, float] | str:
    """Return the next place and a stride for the one after it; in words why there is none."""
    why = ""
    while stride >= _SHORTEST:
        try:
            place = stride_from(family, here, stride)
        except SimulationError as error:
            why, stride = str(error), 0.25 * stride
            continue
        missed = _missed(here, place, stride) / stride
        # What is missed in proportion to the stride is a direction that is wrong.
        if missed > _NEARBY and stride < 0.1 * _FIRST and family.finer():
            try:
                here, stride = correct(family, here.x, here.p, here.direction, rounds=3 * ROUNDS), _FIRST
            except SimulationError as error:
                return f"no place further on: {error}"
            continue
        if missed > _NEARBY:
            why, stride = "Newton's method leads elsewhere", 0.25 * stride
            continue
        straight = float(_rescaled(here, place) @ place.direction)
        if straight < _STRAIGHT and stride > 16.0 * _SHORTEST:
            stride *= 0.5
            continue
        return place, min(_longest(place), stride * (1.6 if place.periods <= _EASY and straight > 0.98 else 1.0))
    return f"no place further on: {why}"


def _longest(here: Place) -> float:
    """Return how long a stride from a place may be.

    Where all of n states change by the same part of their motion, the stride is √n times that. So that a branch of many
    states takes no more places than one of few, it is what the states change by on average that is limited, and the
    parameter by itself.
    """
    many = math.sqrt(max(len(here.x) / _FEW, 1.0))
    return _LONGEST * min(many, 1.0 / max(abs(float(here.direction[-1])), 1e-300))


def _missed(here: Place, there: Place, stride: float) -> float:
    """Return how far a place is from where the stride led, in units of the motion and of the parameter."""
    way = np.append((there.x - here.x) / here.lap.unit, there.p - here.p) - stride * here.direction
    return float(np.linalg.norm(way))


def _rescaled(here: Place, there: Place) -> Floats:
    """Return the direction of a place in the units of another."""
    moved = np.append(here.direction[:-1] * here.lap.unit / there.lap.unit, here.direction[-1])
    direction: Floats = moved / float(np.linalg.norm(moved))
    return direction


def _at_edge(family: Family, here: Place, beyond: Place, edge: float) -> Place | None:
    """Return the place at a bound, between two."""
    share = (edge - here.p) / (beyond.p - here.p)
    try:
        result = arrive(family, here.x + share * (beyond.x - here.x), edge)
    except SimulationError:
        return None
    return result if result.direction @ _rescaled(here, result) > 0.0 else turned(result)


def _passes(here: Place, there: Place, first: Place) -> bool:
    """Whether the branch has come back to where it began, between two places."""
    unit = np.append(first.lap.unit, 1.0)
    a, b, aim = (np.append(p.x, p.p) / unit for p in (here, there, first))
    way = b - a
    share = float(np.clip((aim - a) @ way / max(float(way @ way), 1e-300), 0.0, 1.0))
    near = float(np.linalg.norm(a + share * way - aim)) < 0.1 * float(np.linalg.norm(way))
    return near and float(_rescaled(there, first) @ first.direction) > 0.0


def both_ways(family: Family, first: Place, manner: Manner) -> ContinuedBranch:
    """Follow a branch from a place to both of its ends.

    Args:
        family: period maps.
        first: where to begin.
        manner: how to follow it.
    """
    up = follow(family, first, manner, way=1.0)
    if up.closed:
        return up
    whole = replace(manner, begun=lambda so_far: manner.begun(lambda: _joined(so_far(), up)))
    return _joined(follow(family, first, whole, way=-1.0), up)


def _joined(down: ContinuedBranch, up: ContinuedBranch) -> ContinuedBranch:
    """Return the branch that two tracks from one place are, from the end of the first to that of the second."""
    before = [turned(p) for p in reversed(down.places)]
    special = [*reversed(down.special), *up.special]
    return ContinuedBranch(
        before[:-1] + up.places, special, [*down.missed, *up.missed], ends=(down.ends[1], up.ends[1])
    )

"""Places on branches of periodic motions: Newton's method on a family of period maps."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from workbench.core.values.arrays import Complex, Floats
from workbench.errors import SimulationError
from workbench.response.periodic.monodromy import VariationalEquation
from workbench.response.periodic.period_map import Lap
from workbench.response.periodic.stability import is_stable

__all__ = ["ROUNDS", "Family", "Place", "arrive", "correct", "depart", "stride_from", "turned"]

# A place is reached where a further step of Newton's method moves it by less than this, in units of the motion.
# One whose multipliers count, where it hardly moves at all.
_REACHED, _EXACTLY, _NEAR = 1e-5, 1e-7, 1e-2

# A step that is this small, and hardly smaller than the one before, is the integration's error.
_NOISE, _STALLS = 1e-4, 0.2

# A period closes to this, in units of the motion.
_CLOSED = 1e-3

# A multiplier so near to 1 may be that of an integrator.
_INTEGRATES = 1e-3

# Steps of Newton's method to a place.
ROUNDS = 6


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
    def at(self) -> VariationalEquation:
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
    return correct(family, x, p, level, exact=exact, rounds=3 * ROUNDS)


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
    result, vectors = np.linalg.eig(crossing.at.Phi * unit / unit[:, None])
    way = vectors[:, int(np.argmin(np.abs(result - multiplier)))].real
    way *= np.sign(aside) / float(np.linalg.norm(way))
    level = np.append(way, 0.0)
    place = correct(other, crossing.x + abs(aside) * unit * way, crossing.p, level, rounds=3 * ROUNDS)
    return place if place.direction[:-1] @ way > 0.0 else turned(place)


def correct(family: Family, x: Floats, p: float, level: Floats, *, exact: bool = False, rounds: int = ROUNDS) -> Place:
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
        rate = 1.0 if math.isinf(before) else moved / before if before > 0.0 else float(moved > 0.0)
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


def _standing(at: VariationalEquation) -> str:
    """Return what to think of a multiplier near 1; empty: there is none."""
    result = at.multipliers[np.abs(at.multipliers - 1.0) < _INTEGRATES]
    if not len(result):
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
    result = np.linalg.svd(matrix)[2][-1]
    size = float(np.linalg.norm(result))
    direction: Floats = result / size if result @ before >= 0.0 else -result / size
    return direction


def _regular(matrix: Floats, direction: Floats) -> float:
    bordered = np.vstack([matrix, direction])
    return float(np.linalg.slogdet(bordered)[0] * np.linalg.svd(bordered, compute_uv=False)[-1])


def turned(place: Place) -> Place:
    """Return a place as one comes to it from the other side."""
    return replace(place, direction=-place.direction, regular=-place.regular)


def stride_from(family: Family, here: Place, stride: float, *, exact: bool = False) -> Place:
    """Return the place that lies a stride along the branch: there, and back to it in the plane across.

    Args:
        family: period maps.
        here: where the stride begins.
        stride: its length, in units of the motion and of the parameter.
        exact: with a derivative that is good for the multipliers.

    Raises:
        SimulationError: Newton's method does not come to one.
    """
    d = here.direction
    x, p = here.x + stride * d[:-1] * here.lap.unit, here.p + stride * float(d[-1])
    return correct(family, x, p, d, exact=exact, rounds=2 * ROUNDS if exact else ROUNDS)

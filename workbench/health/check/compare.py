"""How far two test runs lie apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.health.check.result import Answer
from workbench.health.check.subject import Trajectory

__all__ = ["Gap", "largest_gap", "relative_gaps", "unlike", "usual_gap"]

_TINY = 1e-300
_ROUNDING = 1e-12  # relative: what sums whose order changes leave, as with threads


@dataclass(frozen=True)
class Gap:
    """The largest difference of two runs.

    Attributes:
        name: of the variable.
        time: when it is that large [s].
        values: both values there.
        relative: difference over the variable's range (over its magnitude where it does not move).
    """

    name: str
    time: float
    values: tuple[float, float]
    relative: float

    @property
    def words(self) -> str:
        """What differs, in one clause."""
        a, b = self.values
        far = f"{100.0 * self.relative:.2g} % of its range"
        return f"{self.name} is {b:.9g} instead of {a:.9g} at t = {self.time:.4g} s ({far})"


def relative_gaps(a: Trajectory, b: Trajectory) -> Floats:
    """Return |a − b| over the range of each column of both runs, shape of the values.

    Where a column does not move, its magnitude takes the range's place.
    """
    both = Trajectory(np.concatenate([a.time, b.time]), np.concatenate([a.values, b.values]))
    size = np.where(both.scale > 0.0, both.scale, np.abs(both.values).max(axis=0, initial=0.0))
    result: Floats = np.abs(a.values - b.values) / np.maximum(size, _TINY)
    return result


def largest_gap(a: Trajectory, b: Trajectory, names: Sequence[str]) -> Gap:
    """Return the largest difference.

    Args:
        a: one run.
        b: the other, at as many points.
        names: of their columns.
    """
    gaps = relative_gaps(a, b)
    row, column = (int(i) for i in np.unravel_index(int(gaps.argmax()), gaps.shape))
    values = float(a.values[row, column]), float(b.values[row, column])
    return Gap(names[column], float(a.time[row]), values, float(gaps[row, column]))


def unlike(
    a: Trajectory, b: Trajectory, names: Sequence[str], where: str, consequence: str, *, values: int | None = None
) -> Answer:
    """Return the answer on two runs that should be the same to the last bit and are not; watch: by rounding alone.

    Args:
        a: one run.
        b: the other, at as many points.
        names: of their columns.
        where: the other differs, in words.
        consequence: see `Answer`.
        values: how many were compared; None: not told.
    """
    gap = largest_gap(a, b, names)
    verdict = "watch" if gap.relative <= _ROUNDING else "broken"
    counted = {} if values is None else {"values": values}
    return Answer(verdict, f"{where} {gap.words}", consequence, {**counted, "relative": gap.relative})


def usual_gap(a: Trajectory, b: Trajectory, share: float) -> Floats:
    """Return for each column the difference that all but `share` of the points keep within, shape (k,).

    For models that jump: where a jump falls beside a point, rounding decides on which side of it.
    """
    result: Floats = np.quantile(relative_gaps(a, b), 1.0 - share, axis=0)
    return result

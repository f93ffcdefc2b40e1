"""The sector of a static block: between which straight lines its characteristic lies."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from workbench.core.records.record import RecordPart
from workbench.core.values.arrays import Floats
from workbench.loops.describing.base import DescribedBlock

__all__ = ["Sector", "sector_of"]

_PER_DECADE = 200
_DECADES = 10
_STEADY = 1e-6  # relative: f(v)/v that changes by no more over the last half decade has come to its limit
_NOTHING = 1e-9  # of the largest slope: an end that small is 0
_FINE, _ZOOMS = 41, 8
_WITHIN = 0.05  # of the sector's width: a last decade that keeps this far from its ends stays inside
_SHRINKS = 0.5  # steps that shrink at least so fast have an end; those of a slope plus a constant do by 1/√10


@dataclass(frozen=True, kw_only=True)
class Sector(RecordPart):
    """Lines through the operating point that enclose a characteristic: low·v² ≤ v·f(v) ≤ high·v².

    Attributes:
        low, high: their slopes.
        reach: largest |v| for which that is known to hold; None: beyond the inputs that were looked at f(v)/v goes
            towards a value between them, as extrapolated from the last ones.
    """

    low: float
    high: float
    reach: float | None = None


def sector_of(block: DescribedBlock, reach: float) -> Sector:
    """Return the sector of a static block about its operating point.

    f(v)/v is looked at for both signs on a grid of 200 inputs a decade over ten decades up to `reach`, and finer around
    its extremes. Between these inputs it is not known: a characteristic with details finer than that, or a jump off the
    grid, is bounded only nearly. Where f(v)/v still grows towards v = 0 or `reach` (a relay, a cubic) the sector holds
    for the inputs looked at alone, or has no bound.

    Args:
        block: static; `Block.static` evaluates it.
        reach: largest |v| that is looked at, above 0.

    Returns:
        The sector; `high` is infinite, or `low` minus infinity, where f jumps at 0.
    """
    count = _DECADES * _PER_DECADE + 1
    size = np.geomspace(reach * 10.0**-_DECADES, reach, count)
    result = [_side(block, sign * size) for sign in (-1.0, 1.0)]
    low, high = min(f[0] for f in result), max(f[1] for f in result)
    return Sector(low=low + 0.0, high=high, reach=None if all(f[2] for f in result) else reach)


def _side(block: DescribedBlock, v: Floats) -> tuple[float, float, bool]:
    """Return the smallest and the largest f(v)/v on one side, and whether it stays between them farther out."""
    slope = block.static(v) / v
    low, high = (_extreme(block, v, slope, sign) for sign in (1.0, -1.0))
    begin = slope[: _PER_DECADE + 1]
    if abs(begin[0]) > 5.0 * abs(begin[-1]) > 0.0:  # as 1/v: a jump at 0
        low, high = (-math.inf, high) if begin[0] < 0.0 else (low, math.inf)
    size = max(float(np.abs(slope).max()), 1e-300)
    first = _limit(slope[: _PER_DECADE + 1 : _PER_DECADE // 2], size)
    if first is not None:
        low, high = min(low, first), max(high, first)
    tail, width = slope[-_PER_DECADE:], _WITHIN * (high - low)
    if low + width < tail.min() and tail.max() < high - width:
        return low, high, True
    limit = _limit(slope[: -_PER_DECADE - 2 : -_PER_DECADE // 2], size)
    if limit is None:
        return low, high, False
    return min(low, limit), max(high, limit), True


def _limit(last: Floats, size: float) -> float | None:
    """Return where f(v)/v goes, from its values at the three outermost |v|, each √10 apart; None: not known.

    Args:
        last: the outermost first, shape (3,).
        size: of f(v)/v.
    """
    here, before, first = last.tolist()
    step, earlier = here - before, before - first
    shrinking = step / earlier if earlier else math.inf
    if 0.0 < shrinking < _SHRINKS:
        end = float(here + step * shrinking / (1.0 - shrinking))
        return end if abs(end) > _NOTHING * size else 0.0
    return float(here) if abs(step) <= _STEADY * size else None


def _extreme(block: DescribedBlock, v: Floats, slope: Floats, sign: float) -> float:
    """Return the smallest of sign·f(v)/v, times the sign: looked at more closely around the grid's."""
    best = math.inf
    for _ in range(_ZOOMS):  # beside a jump the extreme is only approached
        k = int(np.argmin(sign * slope))
        best = min(best, sign * float(slope[k]))
        v = np.linspace(v[max(k - 1, 0)], v[min(k + 1, len(v) - 1)], _FINE)
        slope = block.static(v) / v
    return sign * best

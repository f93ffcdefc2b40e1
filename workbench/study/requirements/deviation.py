"""How far two curves are apart, beside what their errors allow."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from workbench.core.values.arrays import Floats
from workbench.show.tables import behind
from workbench.study.requirements.base import NotMeasured
from workbench.study.requirements.comparable import Comparable

__all__ = ["Deviation", "Leeway", "deviation"]

_SAME = 1e-9  # places that differ by less, of a frequency or of the length of a time history, are the same


@dataclass(frozen=True, kw_only=True)
class Leeway:
    """What may differ besides the errors that both records state.

    Attributes:
        tolerance: in the unit of the values.
        relative: fraction of the baseline's value; of a time history of its largest one.
        shift: of events in time [s].
    """

    tolerance: float = 0.0
    relative: float = 0.0
    shift: float = 0.0

    @property
    def given(self) -> bool:
        """Whether there is a bound on values whose error is not stated."""
        return self.tolerance > 0.0 or self.relative > 0.0


@dataclass(frozen=True, eq=False, kw_only=True)
class Deviation:
    """Two curves of one name.

    Attributes:
        mine, theirs: measured now; the baseline.
        at: shape (n,), places at which they were compared.
        off: shape (n,), size of the difference there [unit].
        bar: shape (n,), what is allowed there [unit].
    """

    mine: Comparable
    theirs: Comparable
    at: Floats
    off: Floats
    bar: Floats

    @property
    def ratio(self) -> Floats:
        """Difference in error bars, shape (n,); 0 where nothing differs, inf where nothing may and something does."""
        bar = np.where(self.bar > 0.0, self.bar, 1.0)
        ratio: Floats = np.where(self.off == 0.0, 0.0, np.where(self.bar > 0.0, self.off / bar, np.inf))
        return ratio

    @property
    def worst(self) -> int:
        """Number of the place with the most error bars."""
        return int(np.argmax(self.ratio))

    @property
    def where(self) -> str:
        """The worst place in words: "y at 0.35 s: off by 0.011 m, error bar 0.0034 m"."""
        k = self.worst
        at = f" at {self.at[k]:.6g} {self.theirs.along}" if self.theirs.along else ""
        unit = behind(self.theirs.unit)
        return f"{self.theirs.name}{at}: off by {self.off[k]:.3g}{unit}, error bar {self.bar[k]:.2g}{unit}"


def deviation(mine: Comparable, theirs: Comparable, allowed: Leeway) -> Deviation:
    """Return how far a curve is from that of the baseline.

    Single numbers are compared as such, responses at the frequencies of the baseline. Time histories are compared at
    the times of either one; between its rows the other one is a straight line, whose error by the curvature of the
    neighbouring rows is allowed, too. At an event its left and right limit count.

    Args:
        mine: measured now.
        theirs: of the baseline.
        allowed: besides the errors that both state.

    Raises:
        NotMeasured: other units, a point that failed, a history that ends before the baseline, a place of the baseline
            that was not measured, an error that is not stated without a tolerance.
    """
    if mine.unit != theirs.unit:
        raise NotMeasured(
            f"{theirs.name} is in {mine.unit or 'no unit'} now, in {theirs.unit or 'no unit'} in the baseline"
        )
    result = _histories(mine, theirs, allowed) if theirs.along == "s" else _points(mine, theirs, allowed)
    if not len(result.at) and not theirs.along:
        raise NotMeasured(f"{theirs.name} has a value now, but none in the baseline")
    if not len(result.at):
        raise NotMeasured(f"{theirs.name}: was measured at no {theirs.along} of the baseline")
    return result


def _points(mine: Comparable, theirs: Comparable, allowed: Leeway) -> Deviation:
    near = np.abs(mine.at[:, None] - theirs.at) <= _SAME * np.abs(theirs.at)
    i, j = np.nonzero(near & ~np.isnan(theirs.value))
    lost = i[np.isnan(mine.value[i])]
    if len(lost):
        raise NotMeasured(
            f"{mine.name}{_place(mine, lost[0])} has a value in the baseline, but none now{_why(mine, lost[0])}"
        )
    left = theirs.at[np.setdiff1d(np.flatnonzero(~np.isnan(theirs.value)), j)]
    if len(left) and len(j) and theirs.along:
        raise NotMeasured(
            f"{theirs.name}: {len(left)} of {len(theirs.at)} places of the baseline were not measured, the first at "
            f"{left[0]:.6g} {theirs.along}"
        )
    a, b = mine.value[i], theirs.value[j]
    with np.errstate(invalid="ignore"):
        off = np.where(a == b, 0.0, np.abs(a - b))
    bar = _errors(mine, i, allowed) + _errors(theirs, j, allowed) + _given(np.abs(b), allowed)
    return Deviation(mine=mine, theirs=theirs, at=theirs.at[j], off=off, bar=bar)


def _given(size: Floats, allowed: Leeway) -> Floats:
    """Return what the tolerances allow of values of this size; an infinite one must stay."""
    bar: Floats = allowed.tolerance + allowed.relative * np.where(np.isinf(size), 0.0, size)
    return bar


def _place(quantity: Comparable, k: int) -> str:
    return f" at {quantity.at[k]:.6g} {quantity.along}" if quantity.along else ""


def _why(quantity: Comparable, k: int) -> str:
    reason = quantity.failed.get(float(quantity.at[k]))
    return f": {reason}" if reason else ""


def _errors(quantity: Comparable, index: NDArray[np.intp], allowed: Leeway) -> Floats:
    """Return the errors stated at some places; where none is, what rounding may do: a tolerance is given for it."""
    error: Floats = quantity.error[index]
    unknown = index[np.isnan(error)]
    if len(unknown) and not allowed.given:
        why = ", its record states none" if np.isnan(quantity.error).all() else ""
        raise NotMeasured(
            f"the error of {quantity.name}{_place(quantity, unknown[0])} is not known{why}: give the requirement a "
            f"tolerance ({quantity.unit or 'without unit'}), or relative as a fraction"
        )
    return np.where(np.isnan(error), np.broadcast_to(quantity.rounding, quantity.at.shape)[index], error)


# -- time histories ----------------------------------------------------------------------------


def _histories(mine: Comparable, theirs: Comparable, allowed: Leeway) -> Deviation:
    begin, end = theirs.at[0], theirs.at[-1]
    width = max(allowed.shift, _SAME * (end - begin))
    if mine.at[0] > begin + width or mine.at[-1] < end - width:
        raise NotMeasured(
            f"{mine.name} was measured from {mine.at[0]:g} to {mine.at[-1]:g} s, in the baseline from {begin:g} to "
            f"{end:g} s"
        )
    given = float(_given(np.abs(theirs.value).max(), allowed))
    parts = []
    for one, other in ((theirs, mine), (mine, theirs)):
        inside = np.flatnonzero((one.at >= other.at[0] - width) & (one.at <= other.at[-1] + width))
        off, straight = _beside(one.at[inside], _real(one)[inside], other, width)
        bar = _errors(one, inside, allowed) + _between(other, one.at[inside], allowed) + straight + given
        known = ~np.isnan(bar)
        parts.append((one.at[inside][known], off[known], bar[known]))
    at, off, bar = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    order = np.argsort(at, kind="stable")
    return Deviation(mine=mine, theirs=theirs, at=at[order], off=off[order], bar=bar[order])


def _real(quantity: Comparable) -> Floats:
    return np.asarray(quantity.value, dtype=np.float64)


def _between(quantity: Comparable, at: Floats, allowed: Leeway) -> Floats:
    """Return the larger error stated at the rows beside each time."""
    error = _errors(quantity, np.arange(len(quantity.at)), allowed)
    right = np.clip(np.searchsorted(quantity.at, at), 1, len(error) - 1)
    return np.maximum(error[right - 1], error[right])


def _beside(at: Floats, value: Floats, other: Comparable, width: float) -> tuple[Floats, Floats]:
    """Return how far values lie from all that the other history is within `width` of their times.

    Returns:
        Distances, and the error of the straight line between rows, NaN where it is not known; shape of `at` both.
    """
    values = _real(other)
    first, last = np.searchsorted(other.at, at - width), np.searchsorted(other.at, at + width, side="right")
    ends = [np.interp(np.clip(at + side, other.at[0], other.at[-1]), other.at, values) for side in (-width, width)]
    low, high = np.minimum(*ends), np.maximum(*ends)
    for k in np.flatnonzero(last > first):
        rows = values[first[k] : last[k]]
        low[k], high[k] = min(low[k], rows.min()), max(high[k], rows.max())
    off = np.maximum(0.0, np.maximum(value - high, low - value))
    return off, np.where(last > first, 0.0, _straight(at, other))


def _straight(at: Floats, other: Comparable) -> Floats:
    """Return |y''|/2 · (t − a)(b − t), the error of a straight line from row a to row b; NaN where y'' is not known."""
    bend = _bend(other.at, _real(other))
    right = np.clip(np.searchsorted(other.at, at), 1, len(other.at) - 1)
    a, b = other.at[right - 1], other.at[right]
    error: Floats = 0.5 * bend[right - 1] * np.maximum(0.0, (at - a) * (b - at))
    return error


def _bend(time: Floats, value: Floats) -> Floats:
    """Return a bound on |y''| in each interval: the largest divided difference around it, and by how much they vary.

    Differences reach from event to event; NaN where there are too few rows for one.
    """
    h = np.diff(time)
    result = np.full(len(h), np.nan)
    for begin, end in _smooth(h):  # intervals begin … end - 1
        slope = np.diff(value[begin : end + 1]) / h[begin:end]
        if len(slope) > 1:
            second = np.diff(slope) / (0.5 * (h[begin : end - 1] + h[begin + 1 : end]))
            padded = np.pad(second, 2, mode="edge")
            around = np.array([padded[k : k + end - begin] for k in range(4)])
            result[begin:end] = np.abs(around).max(axis=0) + np.ptp(around, axis=0)
    return result


def _smooth(h: Floats) -> Iterator[tuple[int, int]]:
    """Yield the first interval and that after the last one of each part without an event."""
    breaks = [-1, *np.flatnonzero(h <= 0.0).tolist(), len(h)]
    for before, after in pairwise(breaks):
        if after > before + 1:
            yield before + 1, after

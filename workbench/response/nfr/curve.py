"""What the points of a frequency response say of the curve between them, and what they leave open."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.core.values.decibels import decibels

__all__ = ["DROP_DB", "STEEPER", "Fall", "ResonancePeak", "fall_of", "peak_of"]

DROP_DB = 3.0

# A fall from one point to the next by more than this [dB], and so many times as steep as beside it, may be a jump.
_CLIFF_DB, STEEPER = 6.0, 4.0

# Slopes on both sides of the highest point that meet so much above it [dB] leave a peak open; and so does a point
# beside it that is so much lower: a resonance is as wide as the span in which it falls by as much.
_HIDDEN_DB, _SHARP_DB = 0.3, 3.0


@dataclass(frozen=True)
class Fall:
    """Where the gain falls below a level: between two points.

    Attributes:
        low, high: the last point that is surely above, the first one that is surely below [Hz].
        cliff: whether it falls there so steeply that it may jump.
    """

    low: float
    high: float
    cliff: bool


@dataclass(frozen=True)
class ResonancePeak:
    """The highest point.

    Attributes:
        frequency: [Hz].
        gain_db: [dB].
        above_db: by how much it lies above the first point [dB].
        between: points between which the curve may be higher still [Hz]; None: they show no sign of it.
    """

    frequency: float
    gain_db: float
    above_db: float
    between: tuple[float, float] | None


def fall_of(frequency: Floats, gain_db: Floats, error: Floats) -> Fall | None:
    """Return where the gain has first fallen below that of the first point by 3 dB; None: nowhere for sure.

    What a point's error leaves open counts on neither side; a straight line between the points would be more exact than
    they are.

    Args:
        frequency: rising, shape (k,) [Hz].
        gain_db: finite, shape (k,) [dB].
        error: relative, shape (k,); NaN where it is not known.
    """
    if len(frequency) < 2:
        return None
    left = np.where(np.isfinite(error), error, 1.0)
    open_db = np.where(left < 1.0, -decibels(np.maximum(1.0 - left, 1e-9)), np.inf)
    above, margin = gain_db - gain_db[0] + DROP_DB, open_db + open_db[0]
    below = np.flatnonzero(above < -margin)
    if not below.size:
        return None
    last = int(below[0])
    surely = np.flatnonzero(above[:last] > margin[:last])
    if not surely.size:
        return None
    first = int(surely[-1])
    return Fall(float(frequency[first]), float(frequency[last]), _is_cliff(np.log(frequency), gain_db, first, last))


def _is_cliff(f: Floats, gain_db: Floats, first: int, last: int) -> bool:
    falls = gain_db[first] - gain_db[last]
    beside = [(k, k + 1) for k in (first - 1, last) if k >= 0 and k + 1 < len(f)]
    slopes = [abs(gain_db[b] - gain_db[a]) / (f[b] - f[a]) for a, b in beside]
    return bool(falls > _CLIFF_DB and slopes and falls / (f[last] - f[first]) > STEEPER * max(slopes))


def peak_of(frequency: Floats, gain_db: Floats) -> ResonancePeak | None:
    """Return the highest point; None where it is the first or last one.

    Where a peak lies between points, the lines through the two on its left and on its right meet above the highest
    one, or a point beside it is much lower: the points are then farther apart than the peak is wide.

    Args:
        frequency: rising, shape (k,) [Hz].
        gain_db: finite, shape (k,) [dB].
    """
    k = int(np.argmax(gain_db)) if len(gain_db) else 0
    if not 0 < k < len(gain_db) - 1:
        return None
    f = np.log(frequency)
    hidden = [(a, top) for a in (k - 1, k) if (top := _meeting(f, gain_db, a)) > gain_db[k] + _HIDDEN_DB]
    sharp = gain_db[k] - min(gain_db[k - 1], gain_db[k + 1]) > _SHARP_DB
    at = max(hidden, key=lambda one: one[1])[0] if hidden else None
    ends = (k - 1, k + 1) if sharp and at is None else None if at is None else (at, at + 1)
    between = None if ends is None else (float(frequency[ends[0]]), float(frequency[ends[1]]))
    return ResonancePeak(float(frequency[k]), float(gain_db[k]), float(gain_db[k] - gain_db[0]), between)


def _meeting(f: Floats, gain_db: Floats, a: int) -> float:
    """Return where the lines from the left of point a and from the right of the next one meet; −inf: not between."""
    if a < 1 or a + 2 >= len(f):
        return -np.inf
    rise = (gain_db[a] - gain_db[a - 1]) / (f[a] - f[a - 1])
    fall = (gain_db[a + 2] - gain_db[a + 1]) / (f[a + 2] - f[a + 1])
    if rise <= fall:
        return -np.inf
    x = (gain_db[a + 1] - fall * f[a + 1] - gain_db[a] + rise * f[a]) / (rise - fall)
    return float(gain_db[a] + rise * (x - f[a])) if f[a] <= x <= f[a + 1] else -np.inf

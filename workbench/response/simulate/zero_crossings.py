"""When a record passes zero, and its peaks between the samples."""

from __future__ import annotations

import sys

import numpy as np

from workbench.core.values.arrays import Floats

__all__ = ["half_range", "highest", "pass_rate", "rising_passes", "told_mean"]


def rising_passes(time: Floats, x: Floats, *, least: float = 0.0) -> Floats:
    """Return when a record passes zero upwards, between its rows by a straight line, shape (k,) [s].

    Not for noisy records: noise passes many times.

    Args:
        time: not falling, shape (n,) [s].
        x: shape (n,).
        least: rise from row to row below which a pass is rounding.
    """
    up = np.flatnonzero((x[:-1] < 0.0) & (x[1:] >= 0.0) & (np.diff(x) > least))
    return np.asarray(time[up] - x[up] * (time[up + 1] - time[up]) / (x[up + 1] - x[up]), dtype=np.float64)


def pass_rate(passes: Floats, guess: float | None = None) -> float:
    """Return passes per time [1/s].

    Args:
        passes: when, two or more, shape (k,) [s].
        guess: what counts where harmonics pass more than once a period; None: nothing is expected.
    """
    result = float((len(passes) - 1) / (passes[-1] - passes[0]))
    return result if guess is None or result < 1.5 * guess else guess


# -- peaks -------------------------------------------------------------------------------------

_ALIKE = 4.0  # parabolas through neighbouring samples of a smooth peak bend within this factor of each other

SAMPLES = 4096  # of a period, at most, over which answers of blocks and orbits are summed


def half_range(v: Floats) -> float:
    """Return half the peak-to-peak value, the peaks by parabolas through three samples.

    Args:
        v: equidistant samples of one period or more, shape (n,).
    """
    t = np.arange(len(v), dtype=np.float64)
    return 0.5 * (highest(t, v)[0] + highest(t, -v)[0])


def highest(t: Floats, x: Floats) -> tuple[float, float]:
    """Return the largest value and its time; between samples by the parabola through the highest and its neighbours.

    Beside a jump or a kink there is no such parabola: where those through the samples beside it bend otherwise, the
    largest sample is returned.

    Args:
        t: times, rising, shape (n,) [s].
        x: values, shape (n,).

    Example:
        >>> highest(np.arange(5.0), np.array([0.0, 3.0, 4.0, 3.0, 0.0]))
        (4.0, 2.0)
    """
    k = int(np.argmax(x))
    sample = float(x[k]), float(t[k])
    if not 0 < k < len(x) - 1 or not (t[k - 1] < t[k] < t[k + 1]):
        return sample
    around = slice(max(k - 2, 0), k + 3)
    with np.errstate(all="ignore"):  # rows at an event have the same time
        bends = np.diff(np.diff(x[around]) / np.diff(t[around])) / (t[around][2:] - t[around][:-2])
    if not (np.isfinite(bends).all() and bends.max() < 0.0 and bends.min() >= _ALIKE * bends.max()):
        return sample
    left, right = float(t[k - 1] - t[k]), float(t[k + 1] - t[k])
    up, bend = float(x[k + 1] - x[k]), float(bends[k - 1 - around.start])
    slope = up / right - bend * right
    shift = float(np.clip(-0.5 * slope / bend, left, right))
    return float(x[k]) + slope * shift + bend * shift * shift, float(t[k]) + shift


def told_mean(mean: float, *, amplitude: float, residual: float) -> float:
    """Return the mean of a motion; 0 where that cannot be told from it.

    A mean is a sum over samples: rounding leaves the amplitude times their number times the spacing of numbers, and
    what is left of the equations leaves more. Such a number would differ from processor to processor.

    Args:
        mean: as computed, about the operating point.
        amplitude: of the motion.
        residual: of the equations that the motion solves, relative to its amplitude.
    """
    return 0.0 if abs(mean) <= max(SAMPLES * sys.float_info.epsilon, residual) * amplitude else mean

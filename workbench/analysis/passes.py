"""When a record passes zero, and its peaks between the samples."""

from __future__ import annotations

import sys

import numpy as np

from workbench.session.base import Floats

__all__ = ["half_range", "pass_rate", "rising_passes", "told_mean"]


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
    found = float((len(passes) - 1) / (passes[-1] - passes[0]))
    return found if guess is None or found < 1.5 * guess else guess


# -- peaks -------------------------------------------------------------------------------------

SAMPLES = 4096  # of a period, at most, over which answers of blocks and orbits are summed


def half_range(v: Floats) -> float:
    """Return half the peak-to-peak value, the peaks by parabolas through three samples.

    Args:
        v: equidistant samples of one period or more, shape (n,).
    """
    return 0.5 * (_highest(v) + _highest(-v))


def _highest(v: Floats) -> float:
    inner = int(np.argmax(v))
    if not 0 < inner < len(v) - 1:
        return float(v[inner])
    before, top, after = (float(x) for x in v[inner - 1 : inner + 2])
    bend = before - 2.0 * top + after
    return top - (after - before) ** 2 / (8.0 * bend) if bend < 0.0 else top


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

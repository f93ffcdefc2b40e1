"""Peaks between the samples of a record."""

from __future__ import annotations

import sys

import numpy as np

from workbench.analysis.describing.base import Floats

__all__ = ["half_range", "told_mean"]

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

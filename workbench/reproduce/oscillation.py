"""Frequency and amplitude of a recorded oscillation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from workbench.analysis.passes import rising_passes

__all__ = ["frequency", "peak"]

Floats = NDArray[np.float64]


def peak(values: Floats) -> float:
    """Return half the range.

    Args:
        values: shape (n,).
    """
    return float(np.ptp(values)) / 2.0


def frequency(time: Floats, values: Floats) -> float:
    """Return the mean frequency between the first and the last rising crossing of the middle [Hz]; NaN without two.

    Args:
        time: shape (n,), rising [s].
        values: shape (n,).
    """
    moved = values - (values.max() + values.min()) / 2.0
    at = rising_passes(time, moved)
    if len(at) < 2:
        return float("nan")
    return float((len(at) - 1) / (at[-1] - at[0]))

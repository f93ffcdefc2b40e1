"""When a record passes zero."""

from __future__ import annotations

import numpy as np

from workbench.session.base import Floats

__all__ = ["rising_passes"]


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

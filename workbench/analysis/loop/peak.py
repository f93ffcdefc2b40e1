"""The largest gain of a transfer function over frequency."""

from __future__ import annotations

import numpy as np

from workbench.analysis.loop.crossings import gain_crossings, scan
from workbench.core.linear import LinearPart
from workbench.session.base import Floats

__all__ = ["peak"]

_CLOSE = 1e-10  # relative: how exactly the peak is found
_ROUNDS = 30


def peak(f: LinearPart) -> tuple[float, float]:
    """Return max |F(jω)| over all frequencies and where it lies [Hz] (infinity: at no finite frequency).

    A level just above the largest value known is drawn; where F crosses it, the middles of the crossings are higher,
    and so on until nothing crosses any more (N. A. Bruinsma, M. Steinbuch, A fast algorithm to compute the H∞-norm of
    a transfer function matrix, 1990). For a stable F that is its H∞ norm.

    Args:
        f: transfer function without poles on the imaginary axis (or unit circle).
    """
    ends = np.array([0.0, f.highest_hz])
    best, where = _largest(f, np.concatenate([ends, scan(f)]))
    for _ in range(_ROUNDS):
        level = best * (1.0 + _CLOSE)
        if not 0.0 < level < np.inf:
            break
        crossed = np.array(gain_crossings(f.scaled(1.0 / level)))
        if len(crossed) < 2:
            break
        value, at = _largest(f, np.sqrt(crossed[1:] * crossed[:-1]))
        if value <= best:
            break
        best, where = value, at
    return best, where


def _largest(f: LinearPart, frequencies: Floats) -> tuple[float, float]:
    sizes = np.abs(f.response(frequencies))
    sizes = np.where(np.isnan(sizes), -np.inf, sizes)
    k = int(np.argmax(sizes))
    return float(sizes[k]), float(frequencies[k])

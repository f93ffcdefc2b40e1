"""Peaks between the samples of a record."""

from __future__ import annotations

import numpy as np

from workbench.analysis.describing.base import Floats

__all__ = ["half_range"]


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

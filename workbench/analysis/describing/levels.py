"""Find where a static function or its slope jumps."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from workbench.analysis.describing.base import Floats

__all__ = ["find_levels"]

Function = Callable[[Floats], Floats]

_GRID = 1025
_AROUND = 6  # neighbours on each side that a bend is compared with
_STANDS_OUT = 6.0
_NOISE = 1e-11  # of the function's range
_ROUNDS = 26  # each a quarter of the width
_SMOOTH = 0.35  # bends of smooth functions shrink to 1/16 with the width to 1/4, those at a kink to 1/4


def find_levels(function: Function, low: float, high: float) -> Floats:
    """Return the places between `low` and `high` where `function` or its slope jumps, rising, with 0 among them.

    Second differences on a grid that stand out among their neighbours are zoomed into; where they shrink as those of a
    smooth function do they are dropped. Two places within 1/512 of the range may be taken for one.

    Args:
        function: static, takes and returns shape (n,).
        low: lowest input.
        high: highest input.
    """
    x = np.linspace(low, high, _GRID)
    y = function(x)
    bend = np.abs(np.diff(y, 2))
    floor = _NOISE * max(float(np.ptp(y)), 1e-300)
    found = [_zoom(function, x[a], x[b], floor) for a, b in _suspects(bend, floor)]
    return np.unique(np.array([0.0, *(place for place in found if place is not None)]))


def _suspects(bend: Floats, floor: float) -> list[tuple[int, int]]:
    """Return ranges of the grid (first, last point) that hold a bend standing out."""
    padded = np.pad(bend, _AROUND, mode="reflect")
    window = np.lib.stride_tricks.sliding_window_view(padded, 2 * _AROUND + 1)
    usual = np.median(window, axis=1)
    marked = np.flatnonzero(bend > np.maximum(_STANDS_OUT * usual, floor))
    ranges: list[tuple[int, int]] = []
    for i in marked.tolist():
        # The bends at both ends of the interval with a jump belong together.
        if ranges and i <= ranges[-1][1] - 1:
            ranges[-1] = (ranges[-1][0], i + 2)
        else:
            ranges.append((i, i + 2))
    return ranges


def _zoom(function: Function, low: float, high: float, floor: float) -> float | None:
    """Return the place of the sharpest bend in a range, None if there it is smooth."""
    last = np.inf
    for turn in range(_ROUNDS):
        x = np.linspace(low, high, 9)
        bend = np.abs(np.diff(function(x), 2))
        worst = int(np.argmax(bend))
        size = float(bend[worst])
        low, high = float(x[worst]), float(x[worst + 2])
        if size < floor:
            break
        if turn in (2, 4) and size < last * (0.25**2) * _SMOOTH:
            return None
        if turn in (0, 2):
            last = size
    return 0.5 * (low + high)

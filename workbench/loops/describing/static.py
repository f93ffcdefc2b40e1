"""Any static block: its describing function by quadrature."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from workbench.core.values.arrays import Complex, Floats
from workbench.errors import InputError
from workbench.loops.describing.base import DescribedBlock
from workbench.loops.describing.fourier import coefficients

__all__ = ["StaticBlock", "find_levels", "pointwise"]


class StaticBlock(DescribedBlock):
    """y = f(v), about an operating point: f(v + centre) − f(centre).

    N(A) = (1/πA) ∫ f(A sin θ) sin θ dθ [Slotine & Li, Applied Nonlinear Control, 5.2], all harmonics likewise. An
    output without odd symmetry has a mean value besides, which moves the operating point: harmonic balance takes
    it into account, the describing function alone does not.

    Args:
        function: takes and returns shape (n,).
        name: for tables and pictures.
        levels: inputs at which the function or its slope jumps, relative to the centre; None: looked for.
        centre: input at the operating point.
        rest: output there; None: f(centre), and 0 for the centre 0.
    """

    def __init__(
        self,
        function: Callable[[Floats], Floats],
        *,
        name: str = "block",
        levels: Sequence[float] | None = None,
        centre: float = 0.0,
        rest: float | None = None,
    ) -> None:
        self.name = name
        self._function = function
        self.centre = centre
        self._rest = rest if rest is not None else float(function(np.array([centre]))[0]) if centre else 0.0
        self._levels = None if levels is None else np.unique(np.array([0.0, *levels]))
        self._found: dict[int, Floats] = {}

    def static(self, v: Floats) -> Floats:
        y = np.asarray(self._function(np.asarray(v, dtype=np.float64) + self.centre), dtype=np.float64)
        if not np.isfinite(y).all():
            worst = float(np.asarray(v)[~np.isfinite(y)][0]) + self.centre
            raise InputError(f"block {self.name}: its output at the input {worst:g} is not finite")
        return y - self._rest

    def answer(self, v: Complex, frequency: float, count: int) -> Complex:
        reach = float(np.sum(np.abs(v)))
        return coefficients(self.static, v, self.levels_within(reach), count)

    def levels_within(self, reach: float) -> Floats:
        """Return the inputs at which the function or its slope jumps, relative to the centre, rising.

        Args:
            reach: largest size of an input that matters.
        """
        if self._levels is not None:
            return self._levels
        size = math.ceil(math.log(max(reach, 1e-300), 4.0))
        if size not in self._found:
            self._found[size] = find_levels(self.static, -(4.0**size), 4.0**size)
        return self._found[size]

    def slope(self, v: Floats, w: Floats) -> Floats:
        """Return (f(w) − f(v)) / (w − v).

        Args:
            v: inputs, shape (n,).
            w: other inputs, shape (n,), different from `v`.
        """
        return (self.static(w) - self.static(v)) / (w - v)


def pointwise(function: Callable[[Floats], Floats | float]) -> Callable[[Floats], Floats]:
    """Return a static function y = f(u) of shape (1,), as systems have it, as one of shape (n,).

    Args:
        function: takes shape (1,), returns a number or shape (1,).
    """

    def many(v: Floats) -> Floats:
        return np.array([float(np.ravel(function(np.array([x])))[0]) for x in v.tolist()], dtype=np.float64)

    return many


# -- find where a static function or its slope jumps -----------------------------------------------

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
    result = [_zoom(function, x[a], x[b], floor) for a, b in _suspects(bend, floor)]
    return np.unique(np.array([0.0, *(place for place in result if place is not None)]))


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

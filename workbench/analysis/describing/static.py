"""Any static block: its describing function by quadrature."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from workbench.analysis.describing.base import Block, Complex, Floats
from workbench.analysis.describing.fourier import coefficients
from workbench.analysis.describing.levels import find_levels
from workbench.errors import InputError

__all__ = ["StaticBlock", "pointwise"]


class StaticBlock(Block):
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
        return coefficients(self.static, v, self._levels_within(reach), count)

    def _levels_within(self, reach: float) -> Floats:
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

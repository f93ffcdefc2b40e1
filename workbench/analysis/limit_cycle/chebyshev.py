"""A linear part as a polynomial in a parameter."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from workbench.analysis.describing.base import Floats
from workbench.core.linear import LinearPart

__all__ = ["ChebyshevPart", "chebyshev_nodes", "stacked"]

_AGREES = 1e-6


def chebyshev_nodes(low: float, high: float, count: int) -> list[float]:
    """Return count + 1 Chebyshev points of the second kind; those of `count` are among those of 2 · `count`.

    Args:
        low: lowest.
        high: highest.
        count: number of intervals.
    """
    x = 0.5 * (low + high) + 0.5 * (high - low) * np.cos(np.pi * np.arange(count + 1) / count)
    return [float(v) for v in np.round(x, 14)]


def stacked(part: LinearPart) -> Floats:
    """Return [[A, B], [C, D]], shape (n + 1, n + 1).

    Args:
        part: L.
    """
    return np.block([[part.A, part.B], [part.C, part.D]])


class ChebyshevPart:
    """Interpolates matrices by the barycentric formula [Trefethen, Approximation Theory and Practice, chapter 5].

    Args:
        low: lowest value of the parameter.
        high: highest value.
        count: of `chebyshev_nodes`.
        known: matrices at these nodes at least.
    """

    def __init__(self, low: float, high: float, count: int, known: Mapping[float, Floats]) -> None:
        self._x = np.array(chebyshev_nodes(low, high, count))
        self._values = np.array([known[float(x)] for x in self._x])
        self._weights = np.where(np.arange(count + 1) % 2, -1.0, 1.0)
        self._weights[[0, -1]] *= 0.5

    def matrices(self, value: float) -> Floats:
        """Return the matrices at a value of the parameter.

        Args:
            value: of the parameter.
        """
        apart = value - self._x
        exact = np.flatnonzero(apart == 0.0)
        if len(exact):
            return np.asarray(self._values[exact[0]], dtype=np.float64)
        share = self._weights / apart
        return np.asarray(np.tensordot(share, self._values, 1) / share.sum(), dtype=np.float64)

    def agrees(self, finer: ChebyshevPart) -> bool:
        """Whether this polynomial gives the matrices at the nodes of another.

        Args:
            finer: another.
        """
        size = np.abs(finer._values).max(axis=0)
        bound = _AGREES * (size + 1e-6 * size.max(initial=0.0))
        pairs = zip(finer._x.tolist(), finer._values, strict=True)
        return all(bool(np.all(np.abs(self.matrices(x) - there) <= bound)) for x, there in pairs)

    def __call__(self, value: float) -> LinearPart:
        """Return the linear part at a value of the parameter.

        Args:
            value: of the parameter.
        """
        m = self.matrices(value)
        return LinearPart(m[:-1, :-1], m[:-1, -1], m[-1, :-1], float(m[-1, -1]))

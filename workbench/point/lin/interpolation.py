"""Interpolation over a grid: tensor products of Chebyshev polynomials or of cubic splines through all its points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial.chebyshev import chebvander

from workbench.core.values.arrays import Floats

__all__ = ["KINDS", "Axis", "coefficients", "products"]

KINDS = ("chebyshev", "spline")


@dataclass(frozen=True, eq=False)
class Axis:
    """One parameter, with functions of it that interpolate values at its nodes.

    Beyond the nodes the functions stay at their values there.

    Attributes:
        nodes: shape (n,), rising; those of Chebyshev polynomials are their extreme points on the range.
        kind: one of `KINDS`.

    Source: L. N. Trefethen, Approximation Theory and Approximation Practice, chapters 2 and 8; C. de Boor, A Practical
    Guide to Splines, chapters 9 and 13 (not-a-knot).
    """

    nodes: Floats
    kind: str

    def basis(self, at: Floats) -> Floats:
        """Return the n functions at values of the parameter, shape (k, n).

        Args:
            at: shape (k,).
        """
        low, high = float(self.nodes[0]), float(self.nodes[-1])
        held = np.clip(at, low, high)
        if self.kind == "chebyshev":
            return np.asarray(chebvander((2.0 * held - low - high) / (high - low), len(self.nodes) - 1))
        knots, degree = self.knots
        from scipy.interpolate import BSpline  # noqa: PLC0415 - slow to import

        return np.asarray(BSpline.design_matrix(held, knots, degree).toarray())

    @property
    def knots(self) -> tuple[Floats, int]:
        """Knots of the B-splines and their degree: 3, less where there are fewer than four nodes."""
        degree = min(3, len(self.nodes) - 1)
        return np.concatenate(
            [np.full(degree + 1, self.nodes[0]), self.nodes[2:-2], np.full(degree + 1, self.nodes[-1])]
        ), degree

    @cached_property
    def inverse(self) -> Floats:
        """Values at the nodes → factors of the functions, shape (n, n)."""
        return np.asarray(np.linalg.inv(self.basis(self.nodes)), dtype=np.float64)

    def pieces(self) -> list[tuple[float, float, list[tuple[int, Floats]]]]:
        """Return begin and end of each interval of a spline, and the functions that are not 0 there.

        Each function comes with its number and its polynomial in the distance from the begin, highest power first.
        """
        knots, degree = self.knots
        from scipy.interpolate import BSpline, PPoly  # noqa: PLC0415 - slow to import

        every = [PPoly.from_spline(BSpline(knots, row, degree)) for row in np.eye(len(self.nodes))]
        result = []
        for i, (begin, end) in enumerate(zip(knots[:-1].tolist(), knots[1:].tolist(), strict=True)):
            if end > begin:
                some = [(j, np.asarray(p.c[:, i])) for j, p in enumerate(every) if np.any(p.c[:, i])]
                result.append((begin, end, some))
        return result


def products(axes: Sequence[Axis], at: Floats) -> Floats:
    """Return the products of the functions of all axes, those of the last one fastest, shape (k, n₁ n₂ …).

    Args:
        axes: of the grid.
        at: points, shape (k, number of axes).
    """
    result = np.ones((len(at), 1))
    for i, axis in enumerate(axes):
        result = (result[:, :, None] * axis.basis(at[:, i])[:, None, :]).reshape(len(at), -1)
    return result


def coefficients(axes: Sequence[Axis], values: Floats) -> Floats:
    """Return the factors of `products` that give values at the points of the grid, shape (n₁ n₂ …, q).

    Args:
        axes: of the grid.
        values: shape (n₁ n₂ …, q), in the same order.
    """
    shape = [len(axis.nodes) for axis in axes]
    table = values.reshape(*shape, -1)
    for i, axis in enumerate(axes):
        table = np.moveaxis(np.tensordot(axis.inverse, table, axes=(1, i)), 0, i)
    return np.asarray(table.reshape(len(values), -1))

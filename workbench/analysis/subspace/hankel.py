"""The triangular factor of the block Hankel matrix of a record, and rows of it by name."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from workbench.session.base import Floats

__all__ = ["HankelFactor", "factorise", "lower", "pseudo_inverse", "triangular"]

_LEAST_CHUNK = 4096  # columns of the Hankel matrix worked on at a time; fewer cost more calls, more need more memory
ROUNDING = float(np.finfo(np.float64).eps)


@dataclass(frozen=True, eq=False)
class HankelFactor:
    """L of [U; Y] = L Q, all block rows in the order of time, divided by the root of the number of columns.

    Whatever subspace identification wants to know about the Hankel matrix H it can ask of L, since
    H Hᵀ / j = L Lᵀ, and L has as few columns as rows.

    Attributes:
        L: shape (2 i (m + p), 2 i (m + p)), lower triangular: 2 i block rows of u, then 2 i of y.
        horizon: i, block rows of the past and of the future [samples].
        inputs: m.
        outputs: p.
        columns: j = N − 2 i + 1.
    """

    L: Floats
    horizon: int
    inputs: int
    outputs: int
    columns: int

    def u(self, first: int, last: int) -> Floats:
        """Return block rows [first, last) of the inputs, shape ((last − first) m, …)."""
        return self.L[first * self.inputs : last * self.inputs]

    def y(self, first: int, last: int) -> Floats:
        """Return block rows [first, last) of the outputs, shape ((last − first) p, …)."""
        start = 2 * self.horizon * self.inputs
        return self.L[start + first * self.outputs : start + last * self.outputs]

    def past(self, shift: int = 0) -> Floats:
        """Return the past of i samples, inputs then outputs, `shift` samples later."""
        return np.vstack([self.u(shift, self.horizon + shift), self.y(shift, self.horizon + shift)])

    @property
    def excitation(self) -> int:
        """Block rows of the input that are linearly independent (persistent excitation, Verhaegen & Verdult 10.2.4)."""
        size = 2 * self.horizon * self.inputs
        if size == 0:
            return 2 * self.horizon
        corner = self.L[:size, :size]
        floor = 1e3 * ROUNDING * size * float(np.linalg.norm(corner, 2))
        weak = np.flatnonzero(np.abs(np.diag(corner)) <= floor)
        return 2 * self.horizon if weak.size == 0 else int(weak[0]) // self.inputs


def factorise(u: Floats, y: Floats, horizon: int) -> HankelFactor:
    """Return the triangular factor of the block Hankel matrix without ever forming that matrix.

    A stretch of columns at a time is stacked below the factor so far and triangularised again (QR by
    Householder reflections, LAPACK). Squares of the data are never formed: in double precision they
    would hide singular values below 1e-8 of the largest.

    Args:
        u: shape (N, m).
        y: shape (N, p).
        horizon: i; 2 i < N.
    """
    (samples, m), p = u.shape, y.shape[1]
    columns = samples - 2 * horizon + 1
    rows = 2 * horizon * (m + p)
    chunk = max(_LEAST_CHUNK, 4 * rows)
    factor = np.zeros((0, rows))
    for first in range(0, columns, chunk):
        last = min(first + chunk, columns)
        piece = np.hstack([_windows(signal[first : last + 2 * horizon - 1], 2 * horizon) for signal in (u, y)])
        factor = triangular(np.vstack([factor, piece]))
    square = np.zeros((rows, rows))
    square[: len(factor)] = factor
    return HankelFactor(square.T / np.sqrt(columns), horizon, m, p, columns)


def _windows(signal: Floats, length: int) -> Floats:
    """Return every stretch of `length` samples as a row, shape (N − length + 1, length · channels)."""
    windows = sliding_window_view(signal, length, axis=0).transpose(0, 2, 1)
    return windows.reshape(len(windows), -1)


def triangular(matrix: Floats) -> Floats:
    """Return R of the QR factorisation, shape (min(n, k), k).

    Args:
        matrix: shape (n, k).
    """
    return np.asarray(np.linalg.qr(matrix, mode="r"))


def lower(rows: Floats) -> Floats:
    """Return the lower triangular factor of `rows`, padded to a square.

    Args:
        rows: shape (n, k).
    """
    factor = triangular(rows.T)
    square = np.zeros((len(rows), len(rows)))
    square[: len(factor)] = factor
    return square.T


def pseudo_inverse(matrix: Floats) -> Floats:
    """Return the pseudo-inverse, singular values that are rounding left out.

    Args:
        matrix: shape (n, k).
    """
    rcond = 10.0 * max(matrix.shape, default=1) * ROUNDING
    return np.asarray(np.linalg.pinv(matrix, rcond=rcond), dtype=np.float64)

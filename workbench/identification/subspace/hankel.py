"""The triangular factor of the block Hankel matrix of a record, and rows of it by name."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from workbench.core.values.arrays import Floats

__all__ = ["ROUNDING", "HankelFactor", "excitation", "factorise", "lower", "pseudo_inverse", "triangular"]

_LEAST_CHUNK = 4096  # columns of the Hankel matrix worked on at a time; fewer cost more calls, more need more memory
_ENOUGH = 8  # columns per row that show whether rows are independent
ROUNDING = float(np.finfo(np.float64).eps)


@dataclass(frozen=True, eq=False)
class HankelFactor:
    """L of [U; Y] = L Q, all block rows in the order of time, divided by the root of the number of columns.

    The mean of each row is taken off: a constant part of an input or output, which no mean over the whole record
    takes off exactly, is not dynamics (it would be a pole at 1).

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
    L = _lower_factor((u, y), 2 * horizon)
    return HankelFactor(L / np.sqrt(columns), horizon, m, p, columns)


def _lower_factor(signals: tuple[Floats, ...], length: int) -> Floats:
    """Return L of [H1; H2; …] = L Q, the block Hankel matrices of `length` block rows of each signal, rows centred.

    A first row of ones takes the means with it; what is left of the others is orthogonal to it.
    """
    rows = length * sum(s.shape[1] for s in signals)
    columns, chunk = len(signals[0]) - length + 1, max(_LEAST_CHUNK, 4 * rows)
    factor = np.zeros((0, rows + 1))
    for first in range(0, columns, chunk):
        last = min(first + chunk, columns) + length - 1
        piece = np.hstack(
            [np.ones((last - length + 1 - first, 1)), *(_windows(s[first:last], length) for s in signals)]
        )
        factor = triangular(np.vstack([factor, piece]))
    square = np.zeros((rows, rows))
    square[: len(factor) - 1] = factor[1:, 1:]
    return square.T


def excitation(u: Floats, length: int) -> int:
    """Return how many successive block rows of the input are linearly independent, at most `length`.

    The order of persistent excitation (Verhaegen & Verdult 2007, section 10.2.4). The beginning of a long record is
    asked first: what is independent there is so in the whole.

    Args:
        u: shape (N, m).
        length: block rows that are looked at; less than N.
    """
    beginning = u[: length + _ENOUGH * length * u.shape[1]]
    found = _independent(beginning, length)
    return found if found == length or len(beginning) == len(u) else _independent(u, length)


def _independent(u: Floats, length: int) -> int:
    size = length * u.shape[1]
    corner = _lower_factor((u,), length)
    floor = 1e3 * ROUNDING * size * float(np.linalg.norm(corner, 2))
    weak = np.flatnonzero(np.abs(np.diag(corner)) <= floor)
    return length if weak.size == 0 else int(weak[0]) // u.shape[1]


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

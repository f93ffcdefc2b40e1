"""The block Hankel matrix of a record and its weighted projections.

With U_f the future inputs, W_p the past inputs and outputs and Y_f the future outputs, all three methods take the
singular values of W1 O W2, where O is the oblique projection of Y_f along U_f on W_p
(Van Overschee & De Moor 1996, section 4.3; theorem 12):

====== ========================= ============================ =======================================
method W1                        W2                           basis of the states
====== ========================= ============================ =======================================
n4sid  I                         I                            balanced, weighted by the input's spectrum
moesp  I                         projection past U_f          balanced as if the input were white
cva    (Y_f Π Y_fᵀ)^(−1/2)       projection past U_f          canonical: cosines of principal angles
====== ========================= ============================ =======================================

The source report's keyword `basis` chooses W1 alone: "combined" is W1 of cva, so that the scales of inputs and outputs
do not matter and principal angles show the order; "unscaled" is W1 = I, and singular values do.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from workbench.core.values.arrays import Floats
from workbench.errors import InputError, suggest

__all__ = [
    "BASES",
    "METHODS",
    "ROUNDING",
    "HankelFactor",
    "Projection",
    "Subspace",
    "basis_of",
    "excitation",
    "factorise",
    "lower",
    "oblique_loss",
    "project",
    "subspace",
    "triangular",
]

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
    result = _independent(beginning, length)
    return result if result == length or len(beginning) == len(u) else _independent(u, length)


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


@dataclass(frozen=True, eq=False)
class Projection:
    """Parts of the triangular factor of [U_f; W_p; Y_f].

    Attributes:
        past: L22, W_p beyond what U_f explains.
        past_by_input: L21.
        seen: L32, Y_f as W_p explains it.
        unseen: L33, what neither explains: noise.
        gain: L32 L22⁺, so that the oblique projection is gain · W_p.
        scale: largest singular value of Y_f.
    """

    past: Floats
    past_by_input: Floats
    seen: Floats
    unseen: Floats
    gain: Floats
    scale: float


@dataclass(frozen=True, eq=False)
class Method:
    """One method.

    Attributes:
        columns: what stands to the right of W1 in the matrix whose singular values are taken.
        basis: the one that belongs to the method.
    """

    columns: Callable[[Projection], Floats]
    basis: str


@dataclass(frozen=True, eq=False)
class Subspace:
    """Singular value decomposition of the weighted projection.

    Attributes:
        singular_values: shape (k,), falling; cosines where `basis` is "combined" and the method projects past U_f.
        observability: shape (i p, k), columns span the extended observability matrix, scaled by √σ.
        memory: shape (k, i (m + p)), states = memory · W_p.
        floor: singular values at or below are rounding.
        noisy: the future output has more independent directions than the states explain.
    """

    singular_values: Floats
    observability: Floats
    memory: Floats
    floor: float
    noisy: bool

    @property
    def rank(self) -> int:
        """Number of singular values that are more than rounding."""
        return int(np.sum(self.singular_values > self.floor))


def project(factor: HankelFactor) -> Projection:
    """Return the projections that all methods start from.

    Args:
        factor: of the record.
    """
    i = factor.horizon
    future_u, past, future_y = factor.u(i, 2 * i), factor.past(), factor.y(i, 2 * i)
    L = lower(np.vstack([future_u, past, future_y]))
    a, b = len(future_u), len(future_u) + len(past)
    gain = L[b:, a:b] @ pseudo_inverse(L[a:b, a:b])
    scale = float(np.linalg.norm(L[b:], 2))
    return Projection(L[a:b, a:b], L[a:b, :a], L[b:, a:b], L[b:, b:], gain, scale)


def _oblique(parts: Projection) -> Floats:
    return parts.gain @ np.hstack([parts.past_by_input, parts.past])


def _orthogonal(parts: Projection) -> Floats:
    return parts.seen


METHODS: Mapping[str, Method] = {
    "n4sid": Method(_oblique, "unscaled"),
    "moesp": Method(_orthogonal, "unscaled"),
    "cva": Method(_orthogonal, "combined"),
}


def _identity(parts: Projection) -> tuple[Floats, Floats]:
    unit = np.eye(len(parts.seen))
    return unit, unit


def _whitening(parts: Projection) -> tuple[Floats, Floats]:
    """Return W1 and its pseudo-inverse; directions in which the output is rounding only are left out."""
    left, size, _ = np.linalg.svd(np.hstack([parts.seen, parts.unseen]), full_matrices=False)
    keep = size > rounding(parts)
    return (left[:, keep] / size[keep]).T, left[:, keep] * size[keep]


BASES: Mapping[str, Callable[[Projection], tuple[Floats, Floats]]] = {"unscaled": _identity, "combined": _whitening}


def rounding(parts: Projection) -> float:
    """Return the size below which an entry of the projections is rounding."""
    return float(10.0 * ROUNDING * max(parts.seen.shape) * parts.scale)


def basis_of(method: str, basis: str | None) -> str:
    """Return the basis that holds.

    Args:
        method: name in `METHODS`.
        basis: name in `BASES`, None for the method's own.

    Raises:
        InputError: unknown name, or cva without its own weighting.
    """
    if method not in METHODS:
        raise InputError(f"method '{method}' is unknown; {suggest(method, METHODS)}")
    if basis is None:
        return METHODS[method].basis
    if basis not in BASES:
        raise InputError(f"basis '{basis}' is unknown; {suggest(basis, BASES)}")
    if method == "cva" and basis != "combined":
        raise InputError("cva is the method whose basis is combined; use moesp for the same without that weighting")
    return basis


def subspace(parts: Projection, method: str, basis: str) -> Subspace:
    """Return the singular value decomposition that a method and a basis ask for.

    Args:
        parts: from `project`.
        method: name in `METHODS`.
        basis: name in `BASES`.
    """
    weight, back = BASES[basis](parts)
    left, values, _ = np.linalg.svd(weight @ METHODS[method].columns(parts), full_matrices=False)
    root = np.sqrt(values)
    inverse = np.divide(1.0, root, out=np.zeros_like(root), where=root > 0.0)
    floor = rounding(parts) if basis == "unscaled" else 0.0
    memory = inverse[:, None] * (left.T @ weight @ parts.gain)
    noise = np.linalg.norm(parts.unseen, 2) > rounding(parts)
    return Subspace(values, back @ (left * root), memory, floor, bool(noise))


def oblique_loss(parts: Projection) -> float:
    """Return how many times more noise counts in the oblique projection (n4sid) than in the orthogonal one (moesp).

    Both are L32 times something: of the directions of the past beyond the future inputs, L22 = P S Qᵀ, white noise
    enters each column of L32 Q alike. The orthogonal projection takes them as they are, the oblique one multiplies
    column k by the length of row k of S⁻¹ Pᵀ [L21 L22], which is large where the past hardly differs from what the
    future inputs tell. Each is compared with the size of its projection.

    Args:
        parts: from `project`.
    """
    P, size, _ = np.linalg.svd(parts.past)
    kept = size > 10.0 * ROUNDING * len(size) * size[0]
    columns = np.hstack([parts.past_by_input, parts.past])
    stretch = np.linalg.norm(P.T[kept] @ columns, axis=1) / size[kept]
    oblique = np.linalg.norm(stretch) / np.linalg.norm(parts.gain @ columns)
    return float(oblique * np.linalg.norm(parts.seen) / np.sqrt(np.sum(kept)))


def principal_angles(parts: Projection) -> Floats:
    """Return the principal angles between past and future past the future input, shape (k,), rising [deg].

    Sines and cosines both come from orthonormal parts, so that small angles keep their digits.

    Args:
        parts: from `project`.
    """
    _, size, right = np.linalg.svd(np.hstack([parts.seen, parts.unseen]), full_matrices=False)
    unit = right[size > rounding(parts)]
    left, cosines, _ = np.linalg.svd(unit[:, : parts.seen.shape[1]], full_matrices=False)
    sines = np.linalg.norm(left.T @ unit[:, parts.seen.shape[1] :], axis=1)
    return np.asarray(np.degrees(np.arctan2(sines, cosines)))

"""The weighted projections of n4sid, moesp and cva, whose singular values show the order.

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

from workbench.core.values.arrays import Floats
from workbench.errors import InputError, suggest
from workbench.identification.subspace.hankel import ROUNDING, HankelFactor, lower, pseudo_inverse

__all__ = ["BASES", "METHODS", "Projection", "Subspace", "basis_of", "oblique_loss", "project", "subspace"]


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

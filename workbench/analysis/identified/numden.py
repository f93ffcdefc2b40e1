"""Numerator, denominator and zeros of a state-space model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from workbench.session.base import Floats

__all__ = ["NumDen", "numden", "transmission_zeros"]

Complex = NDArray[np.complex128]
_INFINITE = 1e-8  # eigenvalues of the pencil with β below this part of α lie at infinity


@dataclass(frozen=True, eq=False)
class NumDen:
    """A transfer matrix with a common denominator, coefficients of falling powers.

    Attributes:
        num: shape (p, m, n + 1).
        den: shape (n + 1,), first coefficient 1.
    """

    num: Floats
    den: Floats


def numden(A: Floats, B: Floats, C: Floats, D: Floats) -> NumDen:
    """Return numerators and denominator.

    The numerator is the product of the denominator and the series of Markov parameters D, C B, C A B, …, which
    breaks off after n + 1 coefficients (Kailath 1980, section 2.3).

    Args:
        A: shape (n, n).
        B: shape (n, m).
        C: shape (p, n).
        D: shape (p, m).
    """
    n = len(A)
    den = np.real(np.poly(A)) if n else np.ones(1)
    markov, reach = [D], B
    for _ in range(n):
        markov.append(C @ reach)
        reach = A @ reach
    h = np.array(markov)
    num = np.array([np.tensordot(den[: k + 1], h[k::-1], 1) for k in range(n + 1)])
    return NumDen(np.moveaxis(num, 0, -1), den)


def transmission_zeros(A: Floats, B: Floats, C: Floats, D: Floats) -> Complex:
    """Return the finite transmission zeros, shape (k,).

    Generalised eigenvalues of the system pencil [A − z I, B; C, D] (Emami-Naeini & Van Dooren 1982). A model with
    unequal numbers of inputs and outputs is made square in two arbitrary ways; what both have in common is its own.

    Args:
        A: shape (n, n).
        B: shape (n, m).
        C: shape (p, n).
        D: shape (p, m).
    """
    p, m = D.shape
    if p == m:
        return _square_zeros(A, B, C, D)
    rng = np.random.default_rng(0)
    found = []
    for _ in range(2):
        mix = rng.standard_normal((min(p, m), max(p, m)))
        found.append(_square_zeros(A, B, mix @ C, mix @ D) if p > m else _square_zeros(A, B @ mix.T, C, D @ mix.T))
    return np.array([z for z in found[0] if np.any(np.abs(z - found[1]) < 1e-6 * (1.0 + abs(z)))], dtype=np.complex128)


def _square_zeros(A: Floats, B: Floats, C: Floats, D: Floats) -> Complex:
    n, m = B.shape
    b, c = np.linalg.norm(B) or 1.0, np.linalg.norm(C) or 1.0
    left = np.block([[A, B / b], [C / c, D / (b * c)]])
    right = np.zeros((n + m, n + m))
    right[:n, :n] = np.eye(n)
    alpha, beta = scipy.linalg.eigvals(left, right, homogeneous_eigvals=True)
    finite = np.abs(beta) > _INFINITE * np.abs(alpha)
    return np.asarray(alpha[finite] / beta[finite], dtype=np.complex128)

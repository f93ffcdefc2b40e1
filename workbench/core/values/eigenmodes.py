"""Modes of linear models: all of them, or of chains of storages those that are not over at once."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workbench.core.machine.blas import one_thread
from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.matrices import places_of

__all__ = ["Eigenmodes", "symmetric_form"]

_SYMMETRIC = 1e-11  # pairs of entries that are as equal as products of ratios along a path leave them
_HARMLESS = 1e4  # largest ratio of scales: so many digits of sixteen an eigenvector may lose by it
_EXACT = 1e-9  # eigenvectors that give the matrix back to this relative accuracy are used
_ALL = 200  # states: of no more, all modes are found as fast as the slow ones
_NO_MOTION = 1e-12  # of a mode in a period
_SHIFT, _TERMS = 1e-2, 9  # of the least rate that is left out; of the series in it: 1e-18


@dataclass(frozen=True, eq=False)
class Eigenmodes:
    """Poles of a matrix A with their eigenvectors, A ≈ V·diag(λ)·W; what is left out of them decays quickly.

    Attributes:
        poles: λ, shape (k,).
        vectors: V, shape (n, k); real where all poles are.
        inverse: W, shape (k, n).
        beyond: the modes that are left out decay faster than that [1/s]; infinite: there are none.
        chain: where some are left out: d, shape (n,), diagonal and the one beside it of the symmetric D⁻¹AD.
    """

    poles: Complex
    vectors: NDArray[Any]
    inverse: NDArray[Any]
    beyond: float = math.inf
    chain: tuple[Floats, Floats, Floats] | None = None

    @classmethod
    def of(cls, A: Floats, quick: float = math.inf, span: float = math.inf) -> Eigenmodes | None:
        """Return the modes of a matrix; None where they do not give it back: poles coincide.

        Args:
            A: shape (n, n).
            quick: modes that decay faster than this may be left out [1/s] …
            span: … if they decay so many times faster than the slowest one, too.
        """
        form = symmetric_form(A)
        with one_thread():
            if form is not None:  # whose eigenvectors always give it back
                d, at, values = form
                if len(A) > 1 and (np.abs(at[0] - at[1]) <= 1).all():
                    with suppress(np.linalg.LinAlgError):
                        return cls._of_chain(d, *_bands(len(A), at, values), (quick, span))
                symmetric = np.zeros_like(A)
                symmetric[at] = values
                rates, q = np.linalg.eigh(symmetric)
                return cls(rates.astype(np.complex128), q * d[:, None], q.T / d)
            poles, vectors = np.linalg.eig(A)
            try:
                inverse = np.linalg.inv(vectors)
            except np.linalg.LinAlgError:
                return None
            again = (vectors * poles) @ inverse
        good = np.linalg.norm(again - A) <= _EXACT * np.linalg.norm(A)
        return cls(poles.astype(np.complex128), vectors, inverse) if good else None

    @classmethod
    def _of_chain(cls, d: Floats, diagonal: Floats, beside: Floats, quickest: tuple[float, float]) -> Eigenmodes:
        """Return modes of D·S·D⁻¹ with a tridiagonal S; see `of`."""
        from scipy.linalg import eigh_tridiagonal  # noqa: PLC0415  slow to import
        from scipy.linalg.lapack import dstevd  # noqa: PLC0415  as above

        n, (quick, span) = len(d), quickest
        beyond = math.inf
        if n > _ALL:
            slowest = eigh_tridiagonal(diagonal, beside, eigvals_only=True, select="i", select_range=(n - 1, n - 1))
            beyond = max(quick, span * abs(float(slowest[0])))
        # No eigenvalue is larger than a sum of magnitudes in a row (Gershgorin).
        largest = float((np.abs(diagonal) + np.abs(np.append(beside, 0.0)) + np.abs(np.append(0.0, beside))).max())
        if beyond <= largest:
            rates, q = eigh_tridiagonal(diagonal, beside, select="v", select_range=(-beyond, 1.0 + largest))
            return cls(rates.astype(np.complex128), q * d[:, None], q.T / d, beyond, (d, diagonal, beside))
        rates, q, failed = dstevd(diagonal, beside)
        if failed:
            raise np.linalg.LinAlgError
        return cls(rates.astype(np.complex128), q * d[:, None], q.T / d)

    def held(self, c: Floats, period: float) -> Floats:
        """Return c·∫₀ᵀ e^(At) dt, shape (n,).

        Args:
            c: shape (n,).
            period: T [s]; the modes that are left out are over by then.
        """
        rates = self.poles if self.poles.imag.any() else self.poles.real
        still = np.abs(rates) * period < _NO_MOTION
        integral = np.where(still, period, np.expm1(rates * period) / np.where(still, 1.0, rates))
        with one_thread():
            known = ((c @ self.vectors * integral) @ self.inverse).real
        return np.asarray(known + self._resting(c))

    def _resting(self, c: Floats) -> Floats:
        """Return −c·A⁻¹ in the modes that are left out, shape (n,): where A is singular, it is not in these.

        1/λ is the sum of powers of a small σ over those of λ − σ, which no mode left out is near.
        """
        if self.chain is None:
            return np.zeros_like(c)
        from scipy.linalg.lapack import dgttrf, dgttrs  # noqa: PLC0415  slow to import

        d, diagonal, beside = self.chain
        shift = _SHIFT * self.beyond
        *factors, _ = dgttrf(-beside, shift - diagonal, -beside)
        term = self._left(c * d)
        result = np.zeros_like(term)
        for _ in range(_TERMS):
            term = np.asarray(dgttrs(*factors, term)[0])
            result += term
            term *= shift
        return self._left(result) / d

    def _left(self, symmetric: Floats) -> Floats:
        """Return what vectors, in coordinates in which A is symmetric, have in the modes that are left out."""
        if self.chain is None:
            return np.zeros_like(symmetric)
        d = self.chain[0].reshape(-1, *[1] * (symmetric.ndim - 1))
        return np.asarray(symmetric - self.vectors @ (self.inverse @ (symmetric * d)) / d)

    def bound(self, defects: Floats, rates: Floats) -> Floats:
        """Return Σ|V|·max|W·w|/r, how far defects w of the derivatives move each state at most, shape (n,).

        Of the modes that are left out, whose eigenvectors are orthonormal but for D, the norm is taken: it is no less.

        Args:
            defects: w at several instants, shape (n, m).
            rates: r of each mode that is not left out [1/s], shape (k,).
        """
        with one_thread():
            known = np.abs(self.vectors) @ (np.abs(self.inverse @ defects).max(axis=1) / rates)
            if self.chain is None:
                return np.asarray(known)
            d = self.chain[0]
            return np.asarray(known + d * float(np.linalg.norm(self._left(defects / d[:, None]))) / self.beyond)


def _bands(n: int, at: tuple[Any, Any], values: Floats) -> tuple[Floats, Floats]:
    """Return the diagonal of a symmetric matrix by its entries, and the one beside it."""
    diagonal, beside = np.zeros(n), np.zeros(n - 1)
    rows, columns = at
    diagonal[rows[rows == columns]] = values[rows == columns]
    beside[rows[columns == rows + 1]] = values[columns == rows + 1]
    return diagonal, beside


def symmetric_form(A: Floats) -> tuple[Floats, tuple[NDArray[np.intp], NDArray[np.intp]], Floats] | None:
    """Return d, shape (n,), places and values of the entries of the symmetric D⁻¹AD, D = diag(d).

    None: there is no d that is harmless. Networks of storages and resistances (heat, laminar flow) have such matrices:
    their poles are real, and their eigenvectors are orthogonal but for d. Of what rounding leaves apart the mean is
    taken: that moves poles by its square only.

    Args:
        A: shape (n, n).

    Source: J. Z. Hearon, The kinetics of linear systems, Bull. Math. Biophys. 15 (1953) (detailed balance).
    """
    rows, columns = places_of(A)
    there, back = A[rows, columns], A[columns, rows]
    if not len(A) or not np.isfinite(there).all() or (np.sign(there) != np.sign(back)).any():
        return None
    with np.errstate(over="ignore", under="ignore"):
        ratios = np.sqrt(back / there).tolist()
    d = _scales(len(A), np.searchsorted(rows, np.arange(len(A) + 1)).tolist(), columns.tolist(), ratios)
    if d is None:
        return None
    there, back = there * d[columns] / d[rows], back * d[rows] / d[columns]
    if not np.allclose(there, back, rtol=_SYMMETRIC, atol=0.0):
        return None
    return d, (rows, columns), (there + back) / 2.0


def _scales(n: int, begins: list[int], columns: list[int], ratios: list[float]) -> Floats | None:
    """Return d for `symmetric_form`, from row to row by the ratios of pairs of entries; None: some are not harmless.

    Args:
        n: number of rows.
        begins: of each row among the entries, and their number.
        columns: of the entries.
        ratios: of d in the column to d in the row.
    """
    d = [0.0] * n
    for first in range(n):
        reached = [] if d[first] else [first]
        d[first] = d[first] or 1.0
        for i in reached:  # and what is appended meanwhile
            for k in range(begins[i], begins[i + 1]):
                if not d[j := columns[k]]:
                    d[j] = d[i] * ratios[k]
                    if not 1.0 / _HARMLESS <= d[j] <= _HARMLESS:  # a 0 would be begun anew for ever
                        return None
                    reached.append(j)
    return np.array(d) if max(d) <= _HARMLESS * min(d) else None

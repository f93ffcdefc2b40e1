"""Scalings with full blocks for numbers that stand several times on the diagonal, by the method of centres."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, eigh

from workbench.core.values.arrays import Complex, Floats
from workbench.loops.mu.blocks import MuBlock, places

__all__ = ["improved"]

_ROUNDS, _STEPS = 30, 40  # of the level, and of Newton's method at each
_CENTRED = 0.5  # a step so small, in the norm of the Hessian, ends them
_TOWARDS = 0.1  # the next level lies so far from the least one that is proved towards the one before
_ENOUGH = 0.01  # relative: a level that falls by less ends the search
_LARGEST_G = 100.0  # beside a matrix of size 1: G grows no further, which a real block could let it do for ever

_Factors = tuple[Complex, Complex]  # of t D - Mᴴ D M - j (G M - Mᴴ G), and of D


def improved(
    matrix: Complex, blocks: Sequence[MuBlock], d: Complex, g: Complex, *, enough: float = 0.0
) -> tuple[Complex, Complex]:
    """Return scalings D and G with a bound that is smaller, or as small.

    t D - Mᴴ D M - j (G M - Mᴴ G) > 0 is convex in D and G. For a level t its analytic centre is found by Newton's
    method; the least level that the centre proves leads to the next one.

    Args:
        matrix: M, of size 1 or so, shape (n, n).
        blocks: the structure.
        d: D to begin with.
        g: G to begin with.
        enough: a bound as small as this ends the search.

    Source: S. Boyd, L. El Ghaoui, E. Feron, V. Balakrishnan, Linear Matrix Inequalities in System and Control Theory
    (1994), section 2.4.
    """
    search = _CentreSearch(matrix, blocks)
    identity, size = np.eye(len(d), dtype=np.complex128), len(d) / np.trace(d).real
    starts = search.coordinates(size * (0.99 * d) + 0.01 * identity, size * g), search.coordinates(identity, 0.0 * g)
    x = min(starts, key=search.least)  # those that are given may be on the edge of what is allowed
    best, smallest = (d, g), search.least(search.coordinates(d, g))
    t = 1.1 * search.least(x) + 1e-9
    for _ in range(_ROUNDS):
        if not 1e-10 < t < np.inf:
            break
        inside = search.factors(x, t)
        for _ in range(_STEPS):
            if inside is None:
                break
            x, inside, decrement = search.step(x, t, inside)
            if decrement < _CENTRED:
                break
        found = search.least(x)
        if found < smallest:
            best, smallest = search.matrices(x), found
        if found <= enough**2:
            break
        following = found + _TOWARDS * (t - found)
        if not following < t * (1.0 - _ENOUGH):
            break
        t = following
    return best


class _CentreSearch:
    """The inequality in coordinates.

    Args:
        matrix: M.
        blocks: the structure.
    """

    def __init__(self, matrix: Complex, blocks: Sequence[MuBlock]) -> None:
        n = len(matrix)
        back = matrix.conj().T
        d = [_placed(n, at, e) for at, e in _basis(blocks, real_only=False)]
        g = [_placed(n, at, e) for at, e in _basis(blocks, real_only=True)]
        self._basis = np.array([*d, *g])
        self._turns = np.arange(len(self._basis)) >= len(d)  # those of G
        # What each coordinate adds to D, and to Mᴴ D M + j (G M - Mᴴ G).
        self._own = np.where(self._turns[:, None, None], 0.0, self._basis)
        self._left = np.array([back @ e @ matrix for e in d] + [1j * (e @ matrix - back @ e) for e in g])
        self._trace = np.trace(self._own, axis1=1, axis2=2).real
        self._bent = np.where(self._turns, _LARGEST_G**-2, 0.0)

    def coordinates(self, d: Complex, g: Complex) -> Floats:
        """Return those of D and G; the elements of the basis are orthogonal."""
        e = self._basis.conj()
        onto = [np.einsum("kij,ij->k", e, m).real for m in (d, g)]
        sizes = np.einsum("kij,kij->k", e, self._basis).real
        return np.asarray(np.where(self._turns, onto[1], onto[0]) / sizes)

    def matrices(self, x: Floats) -> tuple[Complex, Complex]:
        """Return D and G."""
        return _sum(x, self._own), _sum(np.where(self._turns, x, 0.0), self._basis)

    def least(self, x: Floats) -> float:
        """Return the least t, the square of the bound."""
        try:
            values = eigh(_sum(x, self._left), _sum(x, self._own), eigvals_only=True, check_finite=False)
        except LinAlgError:
            return np.inf
        return max(float(values[-1]), 0.0) if np.isfinite(values).all() else np.inf

    def step(self, x: Floats, t: float, inside: _Factors) -> tuple[Floats, _Factors, float]:
        """Return the coordinates after a step of Newton's method, the trace of D as it was; their factors; its size.

        The damped step, which is always inside, is doubled as long as the barrier falls.

        Args:
            x: coordinates.
            t: the level.
            inside: factors there.
        """
        first, second = (_seen(f, m) for f, m in zip(inside, (t * self._own - self._left, self._own), strict=True))
        diagonal = slice(None, None, len(inside[0]) + 1)
        gradient = self._bent * x - first[:, diagonal].real.sum(axis=1) - second[:, diagonal].real.sum(axis=1)
        both = np.hstack([first, second]).view(np.float64)
        system = np.zeros((len(x) + 1, len(x) + 1))
        system[:-1, :-1] = both @ both.T + np.diag(self._bent)
        system[:-1, -1] = system[-1, :-1] = self._trace
        try:
            move = np.linalg.solve(system, np.append(-gradient, 0.0))[:-1]
        except np.linalg.LinAlgError:
            return x, inside, 0.0
        decrement = float(np.sqrt(max(-gradient @ move, 0.0)))
        share, best, lowest = 1.0 / (1.0 + decrement), None, np.inf
        while share <= 1.0:
            further = x + share * move
            found = self.factors(further, t)
            barrier = np.inf if found is None else self._barrier(further, found)
            if not (found is not None and barrier < lowest):
                break
            best, lowest, share = (further, found), barrier, 2.0 * share
        return (x, inside, 0.0) if best is None else (*best, decrement)

    def _barrier(self, x: Floats, inside: _Factors) -> float:
        logarithms = sum(float(np.log(f.diagonal().real).sum()) for f in inside)
        return 0.5 * float(self._bent @ x**2) - 2.0 * logarithms

    def factors(self, x: Floats, t: float) -> _Factors | None:
        """Return the Cholesky factors of both matrices that have to be positive; None: one of them is not.

        Args:
            x: coordinates.
            t: the level.
        """
        d = _sum(x, self._own)
        try:
            f, own = (np.asarray(np.linalg.cholesky(m)) for m in (t * d - _sum(x, self._left), d))
        except np.linalg.LinAlgError:
            return None
        return (f, own) if np.isfinite(f).all() and np.isfinite(own).all() else None  # not every LAPACK tells of NaN


def _sum(x: Floats, matrices: Complex) -> Complex:
    """Return Σ xₖ Xₖ."""
    k, n, _ = matrices.shape
    return np.asarray((x @ matrices.reshape(k, -1).view(np.float64)).view(np.complex128).reshape(n, n))


def _seen(factor: Complex, matrices: Complex) -> Complex:
    """Return L⁻¹ X L⁻ᴴ of matrices X, shape (k, n²)."""
    inverse = np.linalg.inv(factor)
    return np.asarray((inverse @ matrices @ inverse.conj().T).reshape(len(matrices), -1))


def _basis(blocks: Sequence[MuBlock], *, real_only: bool) -> Iterator[tuple[slice, NDArray[np.complex128]]]:
    """Yield place and matrix of each element of what commutes with the structure; of G: in real blocks only."""
    for block, at in places(blocks):
        n = block.size
        if not block.real:
            if not real_only:
                yield at, np.eye(n, dtype=np.complex128)
            continue
        for i in range(n):
            for j in range(n):
                e = np.zeros((n, n), dtype=np.complex128)
                e[i, j] += 1.0 if i <= j else 1j
                yield at, e if i == j else e + e.conj().T


def _placed(n: int, at: slice, block: Complex) -> Complex:
    result = np.zeros((n, n), dtype=np.complex128)
    result[at, at] = block
    return result

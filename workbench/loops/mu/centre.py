"""Scalings with full blocks for numbers that stand several times on the diagonal, by the method of centres."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cholesky, eigh, solve_triangular

from workbench.core.values.arrays import Complex, Floats
from workbench.loops.mu.blocks import MuBlock, places

__all__ = ["improved"]

_ROUNDS, _STEPS = 30, 8  # of the level, and of Newton's method at each
_CENTRED = 0.5  # a step so small, in the norm of the Hessian, ends them
_TOWARDS = 0.2  # the next level lies so far from the least one that is proved towards the one before
_ENOUGH = 2e-3  # relative: a level that falls by less ends the search
_LARGEST_G = 100.0  # beside a matrix of size 1: G grows no further, which a real block could let it do for ever


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
    start = d * (len(d) / np.trace(d).real)
    x = search.coordinates(0.99 * start + 0.01 * np.eye(len(d)), g * (len(d) / np.trace(d).real))
    best, level = (d, g), search.least(x)
    smallest = search.least(search.coordinates(start, g * (len(d) / np.trace(d).real)))
    t = 1.1 * level + 1e-9
    for _ in range(_ROUNDS):
        if not 1e-10 < t < np.inf:
            break
        for _ in range(_STEPS):
            x, decrement = search.step(x, t)
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
        self._matrix = matrix
        self._d = np.array([_placed(n, at, e) for at, e in _basis(blocks, real_only=False)])
        turns = [_placed(n, at, e) for at, e in _basis(blocks, real_only=True)]
        self._g = np.array(turns) if turns else np.zeros((0, n, n), dtype=np.complex128)
        self._fixed = np.array([back @ e @ matrix for e in self._d])
        self._turned = np.array([1j * (e @ matrix - back @ e) for e in self._g]).reshape(-1, n, n)
        self._trace = np.concatenate([np.trace(self._d, axis1=1, axis2=2).real, np.zeros(len(self._g))])

    def coordinates(self, d: Complex, g: Complex) -> Floats:
        """Return those of D and G; the elements of the basis are orthogonal."""
        parts = [np.einsum("kij,ij->k", e.conj(), m).real / np.einsum("kij,kij->k", e.conj(), e).real
                 for e, m in ((self._d, d), (self._g, g)) if len(e)]  # fmt: skip
        return np.concatenate(parts)

    def matrices(self, x: Floats) -> tuple[Complex, Complex]:
        """Return D and G."""
        k = len(self._d)
        return np.tensordot(x[:k], self._d, 1), np.tensordot(x[k:], self._g, 1)

    def least(self, x: Floats) -> float:
        """Return the least t, the square of the bound."""
        k = len(self._d)
        left = np.tensordot(x[:k], self._fixed, 1) + np.tensordot(x[k:], self._turned, 1)
        try:
            return max(float(eigh(left, self.matrices(x)[0], eigvals_only=True)[-1]), 0.0)
        except (LinAlgError, ValueError):
            return np.inf

    def step(self, x: Floats, t: float) -> tuple[Floats, float]:
        """Return the coordinates after a damped step of Newton's method, the trace of D as it was; and its size."""
        inside = self._factors(x, t)
        if inside is None:
            return x, 0.0
        f, d = inside
        k = len(self._d)
        first = _seen(f, np.concatenate([t * self._d - self._fixed, -self._turned]))
        second = _seen(d, np.concatenate([self._d, np.zeros_like(self._g)]))
        n = len(f)
        gradient = -first[:, :: n + 1].real.sum(axis=1) - second[:, :: n + 1].real.sum(axis=1)
        gradient[k:] += x[k:] / _LARGEST_G**2
        hessian = (first.conj() @ first.T).real + (second.conj() @ second.T).real
        hessian[np.diag_indices_from(hessian)] += np.concatenate([np.zeros(k), np.full(len(x) - k, _LARGEST_G**-2)])
        system = np.block([[hessian, self._trace[:, None]], [self._trace[None], np.zeros((1, 1))]])
        try:
            move = np.linalg.solve(system, np.append(-gradient, 0.0))[:-1]
        except np.linalg.LinAlgError:
            return x, 0.0
        decrement = float(np.sqrt(max(-gradient @ move, 0.0)))
        share = 1.0 / (1.0 + decrement)
        for _ in range(20):
            if self._factors(x + share * move, t) is not None:
                return np.asarray(x + share * move), decrement
            share *= 0.5
        return x, 0.0

    def _factors(self, x: Floats, t: float) -> tuple[Complex, Complex] | None:
        """Return the Cholesky factors of both matrices that have to be positive; None: one of them is not."""
        k = len(self._d)
        d = self.matrices(x)[0]
        f = t * d - np.tensordot(x[:k], self._fixed, 1) - np.tensordot(x[k:], self._turned, 1)
        try:
            return cholesky(f, lower=True), cholesky(d, lower=True)
        except (LinAlgError, ValueError):
            return None


def _seen(factor: Complex, matrices: Complex) -> Complex:
    """Return L⁻¹ X L⁻ᴴ of Hermitian matrices X, shape (k, n²)."""
    n = len(factor)
    half = solve_triangular(factor, matrices.transpose(1, 0, 2).reshape(n, -1), lower=True).reshape(n, -1, n)
    other = solve_triangular(factor, half.conj().transpose(2, 1, 0).reshape(n, -1), lower=True).reshape(n, -1, n)
    return np.asarray(other.transpose(1, 0, 2).reshape(-1, n * n))


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

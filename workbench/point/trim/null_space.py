"""Families of solutions: the directions an equation system leaves open, and steps that respect an order of wishes."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.core.values.matrices import as_sparse, is_sparse

__all__ = ["RANK", "Factors", "Solver", "least_norm", "readable", "regular", "staged_step"]

Solver = Callable[[Floats], Floats]

RANK = 1e-7  # singular values below this part of the largest count as zero
LARGE = 32  # unknowns: singular values of fewer take less than a millisecond
_ITERATIONS = 30  # of the smallest singular value, which falls with each …
_SETTLED = 0.99  # … until it falls by less than this
_CLEARLY = 1.25  # times RANK: what it may still fall by


def least_norm(jacobian: Floats, *, size: float = 0.0) -> tuple[Solver, Floats]:
    """Return what maps r to the s of least norm with J s = r by least squares, and the null space, shape (k, d).

    Rows and columns must be scaled alike; a singular value below 1e-7 of the largest counts as zero, so
    that derivatives by differences are precise enough. A large square matrix without such is factored instead.

    Args:
        jacobian: J, shape (e, k).
        size: the largest singular value counts as at least so large.
    """
    k = jacobian.shape[1]
    if jacobian.size == 0:
        return lambda r: np.zeros((k, *r.shape[1:])), np.eye(k)
    factors = regular(jacobian, size=size)
    if factors is not None:
        return factors.solve, np.zeros((k, 0))
    u, sigma, vt = np.linalg.svd(jacobian, full_matrices=True)
    rank = int((sigma > RANK * max(float(sigma[0]), size)).sum()) if sigma[0] > 0.0 else 0
    inverse = (vt[:rank].T / sigma[:rank]) @ u[:, :rank].T
    return lambda r: inverse @ r, np.asarray(vt[rank:].T, dtype=np.float64)


@dataclass(frozen=True)
class Factors:
    """A regular matrix J.

    Attributes:
        solve: returns s with J s = r.
        least: its smallest singular value.
    """

    solve: Solver
    least: float


def regular(jacobian: Floats, *, size: float = 0.0) -> Factors | None:
    """Return the LU factors of a matrix; None: it is small, not square, or not clearly of full rank.

    Args:
        jacobian: see `least_norm`.
        size: see `least_norm`.

    Source: Golub and Van Loan, Matrix Computations, 2013, sections 2.3 (σ₁² ≤ ‖J‖₁‖J‖∞) and 8.2 (inverse iteration).
    """
    n = len(jacobian)
    if n < LARGE or jacobian.shape != (n, n):
        return None
    solvers = _factored(jacobian)
    if solvers is None:
        return None
    sizes = np.abs(jacobian)
    largest = math.sqrt(float(sizes.sum(axis=0).max()) * float(sizes.sum(axis=1).max()))  # at least σ₁
    with np.errstate(over="ignore"):
        least = _least(*solvers, n)
    return Factors(solvers[0], least) if least > _CLEARLY * RANK * max(largest, size) else None


def _factored(matrix: Floats) -> tuple[Solver, Solver] | None:
    """Return what solves A x = b and Aᵀ x = b; None: A is singular to rounding."""
    if is_sparse(matrix):
        from scipy.sparse.linalg import splu  # noqa: PLC0415 - slow to import, and seldom needed

        try:
            lu = splu(as_sparse(matrix, "csc"))
        except RuntimeError:  # a pivot is zero
            return None
        return lu.solve, lambda b: lu.solve(b, trans="T")
    from scipy.linalg import lapack  # noqa: PLC0415

    factors, pivots, singular = lapack.dgetrf(matrix)
    if singular:
        return None
    return lambda b: lapack.dgetrs(factors, pivots, b)[0], lambda b: lapack.dgetrs(factors, pivots, b, trans=1)[0]


def _least(solve: Solver, back: Solver, n: int) -> float:
    """Return the smallest singular value of A, from what solves A x = b and Aᵀ x = b, by inverse iteration."""
    v, result = np.random.default_rng(3).standard_normal(n), math.inf
    for _ in range(_ITERATIONS):
        v = solve(back(v / np.linalg.norm(v)))
        size = float(np.linalg.norm(v))
        if not 0.0 < size < math.inf:
            return 0.0  # out of the range of numbers: singular values tell
        before, result = result, 1.0 / math.sqrt(size)
        if result > _SETTLED * before:
            break
    return result


def readable(basis: Floats) -> Floats:
    """Return another basis of the same space that names as few variables per direction as it can.

    Gauss-Jordan elimination with full pivoting: each direction has one variable that no other has. The
    largest entry of each is 1, positive; entries below 1e-6 are 0.

    Args:
        basis: shape (k, d), orthonormal.
    """
    rows = basis.T.copy()
    free = list(range(len(rows)))
    while free:
        block = np.abs(rows[free])
        i, j = np.unravel_index(int(block.argmax()), block.shape)
        pivot = free.pop(int(i))
        rows[pivot] /= rows[pivot, j]
        for other in range(len(rows)):
            if other != pivot:
                rows[other] -= rows[other, j] * rows[pivot]
    rows /= np.take_along_axis(rows, np.abs(rows).argmax(axis=1)[:, None], axis=1)
    rows[np.abs(rows) < 1e-6] = 0.0
    return rows.T


def staged_step(wishes: list[tuple[Floats, Floats]], home: Floats | None) -> Floats:
    """Return the step that meets the first wish, then as far as that allows the second, …, then goes home.

    A wish (r, J) is met by a step s with r + J s = 0, in the sense of least squares; of all steps that do, the
    next wish chooses, and last the least distance from `home`, or the least norm.

    Args:
        wishes: (residual (e,), Jacobian (e, k)), most important first.
        home: shape (k,), the step to the point that is wanted if all else leaves a choice; None: no step.

    Source: the null-space method, Nocedal and Wright, Numerical Optimization, 2006, chapter 15.
    """
    k = wishes[0][1].shape[1]
    step, open_ = np.zeros(k), np.eye(k)
    for residual, jacobian in wishes:
        if not len(residual) or not open_.shape[1]:
            continue
        whole = open_.shape[1] == k  # nothing has chosen yet
        solve, left = least_norm(jacobian if whole else jacobian @ open_)
        part = solve(residual + jacobian @ step)
        step = step - (part if whole else open_ @ part)
        open_ = left if whole else open_ @ left
    return step if home is None else step + open_ @ (open_.T @ (home - step))

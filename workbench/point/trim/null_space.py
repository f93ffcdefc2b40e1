"""Families of solutions: the directions an equation system leaves open, and steps that respect an order of wishes."""

from __future__ import annotations

import numpy as np

from workbench.core.values.arrays import Floats

__all__ = ["RANK", "null_space", "readable", "staged_step"]

RANK = 1e-7  # singular values below this part of the largest count as zero


def null_space(jacobian: Floats, *, size: float = 0.0) -> Floats:
    """Return an orthonormal basis of the null space of a matrix (e, k), shape (k, d).

    Rows and columns must be scaled alike; a singular value below 1e-7 of the largest counts as zero, so
    that derivatives by differences are precise enough.

    Args:
        jacobian: the matrix.
        size: the largest singular value counts as at least so large.
    """
    if jacobian.size == 0:
        return np.eye(jacobian.shape[1])
    _, sigma, vt = np.linalg.svd(jacobian, full_matrices=True)
    rank = int((sigma > RANK * max(float(sigma[0]), size)).sum()) if sigma[0] > 0.0 else 0
    return np.asarray(vt[rank:].T, dtype=np.float64)


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
        left = jacobian @ open_
        step = step - open_ @ (np.linalg.pinv(left, rcond=RANK) @ (residual + jacobian @ step))
        open_ = open_ @ null_space(left)
    return step if home is None else step + open_ @ (open_.T @ (home - step))

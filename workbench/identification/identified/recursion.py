"""Linear recursions over long records, many steps at a time.

R(k + 1) = R(k) A + f(k) is stepped through in all stripes of the record at once: a first pass gives each stripe's end
from a start at zero, from these the true starts follow, a second pass fills in what lies between. Python then makes
2 √N steps instead of N; no matrix is diagonalised, so that repeated poles and poles at 0 do no harm.
"""

from __future__ import annotations

import numpy as np

from workbench.core.values.arrays import Floats

__all__ = ["march", "march_one"]


def march(driven: Floats, A: Floats, start: Floats) -> tuple[Floats, Floats]:
    """Return R(0) … R(N − 1) and R(N) of R(k + 1) = R(k) A + f(k).

    Args:
        driven: f, shape (N, r, n).
        A: shape (n, n).
        start: R(0), shape (r, n).
    """
    samples, rows, n = driven.shape
    length = max(1, int(np.sqrt(samples)))
    stripes = samples // length
    whole = stripes * length
    grid = driven[:whole].reshape(stripes, length, rows, n)
    starts, after = _starts(grid, A, start)
    states = np.empty((samples, rows, n))
    _fill(grid, A, starts, states[:whole].reshape(stripes, length, rows, n))
    for k in range(whole, samples):
        states[k] = after
        after = after @ A + driven[k]
    return states, after


def _starts(grid: Floats, A: Floats, start: Floats) -> tuple[Floats, Floats]:
    """Return the state at the beginning of every stripe and after the last."""
    stripes, length, rows, n = grid.shape
    ends = np.zeros((stripes, rows, n))
    for k in range(length):
        ends = ends @ A + grid[:, k]
    power = np.linalg.matrix_power(A, length)
    starts = np.empty((stripes, rows, n))
    for s in range(stripes):
        starts[s] = start
        start = start @ power + ends[s]
    return starts, start


def _fill(grid: Floats, A: Floats, state: Floats, out: Floats) -> None:
    for k in range(grid.shape[1]):
        out[:, k] = state
        state = state @ A + grid[:, k]


def march_one(driven: Floats, A: Floats, start: Floats) -> tuple[Floats, Floats]:
    """Return x(0) … x(N − 1) and x(N) of x(k + 1) = A x(k) + f(k).

    Args:
        driven: f, shape (N, n).
        A: shape (n, n).
        start: x(0), shape (n,).
    """
    states, after = march(driven[:, None, :], A.T, start[None, :])
    return states[:, 0], after[0]

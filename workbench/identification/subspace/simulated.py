"""B, D and the initial state by linear least squares on the simulated output.

With A and C given, the output y = C (qI − A)⁻¹ (B u + x0 δ) + D u + c is linear in B, D, x0 and a constant c
(Verhaegen & Verdult 2007, section 9.2.4.2; Ljung 1999, section 10.6). Noise at the output does not correlate with the
regressors in open loop, so the estimate has no bias, whatever the colour of the noise.

A model that is not stable cannot be simulated over a long record. With a gain K for which A − K C is stable the same
holds for the one-step prediction, with A − K C in place of A, B − K D in place of B and K y added; without c then.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.identification.identified.recursion import march, march_one
from workbench.identification.subspace.hankel import ROUNDING, triangular

__all__ = ["InputFit", "fit_inputs", "residual"]

_STRIPE = 1024  # samples
_CHUNK_BYTES = 2.0**26  # of regressors held at a time


@dataclass(frozen=True, eq=False)
class InputFit:
    """What the regression gives.

    Attributes:
        B: shape (n, m).
        D: shape (p, m).
        x0: shape (n,), state at the first sample.
        offset: shape (p,), constant part of the output.
    """

    B: Floats
    D: Floats
    x0: Floats
    offset: Floats


def fit_inputs(
    u: Floats,
    y: Floats,
    A: Floats,
    C: Floats,
    *,
    feedthrough: bool,
    K: Floats | None = None,
    weight: Floats | None = None,
) -> InputFit:
    """Return B, D, x0 and constant part that fit the output best.

    Args:
        u: shape (N, m).
        y: shape (N, p).
        A: shape (n, n).
        C: shape (p, n).
        feedthrough: D is estimated; else it is zero.
        K: shape (n, p), fit the one-step prediction with this gain; None: the simulation.
        weight: shape (p, p), residuals are multiplied by it; None: all outputs count the same.
    """
    (_, m), (p, n) = u.shape, C.shape
    gain = np.zeros((n, p)) if K is None else K
    size = n * (m + 1) + (p * m if feedthrough else 0) + p
    triangle = np.zeros((0, size + 1))
    with np.errstate(over="ignore", invalid="ignore"):  # a model that is not stable overflows
        for rows in _regression(u, y, A - gain @ C, C, gain, feedthrough=feedthrough):
            weighted = rows if weight is None else weight @ rows
            triangle = triangular(np.vstack([triangle, weighted.reshape(-1, size + 1)]))
    solution = _solve(triangle)
    parts = solution[: n * (m + 1)].reshape(m + 1, n)
    D = solution[n * (m + 1) : size - p].reshape(p, m) if feedthrough else np.zeros((p, m))
    return InputFit(parts[:m].T + gain @ D, D, parts[m], solution[size - p :])


def _solve(triangle: Floats) -> Floats:
    """Solve the triangular least-squares problem; columns are brought to one length before rank is judged.

    Where the model grew beyond all numbers nothing fits: NaN.
    """
    if not np.all(np.isfinite(triangle)):
        return np.full(triangle.shape[1] - 1, np.nan)
    matrix, right = triangle[:, :-1], triangle[:, -1]
    length = np.linalg.norm(matrix, axis=0)
    length[length == 0.0] = 1.0
    found = np.linalg.lstsq(matrix / length, right, rcond=10.0 * len(length) * ROUNDING)[0]
    return np.asarray(found / length, dtype=np.float64)


def _regression(u: Floats, y: Floats, A: Floats, C: Floats, K: Floats, *, feedthrough: bool) -> Iterator[Floats]:
    """Yield stretches of [regressors, output], shape (samples, p, columns + 1).

    Row block l of the state is p × n and follows R(k + 1) = R(k) A + u_l(k) C, so that R(k) vec of column l of B is
    that column's part in y(k); the last block belongs to x0. What K feeds back is one more such block, summed over
    the outputs with K already in it: x(k + 1) = A x(k) + K y(k).
    """
    (samples, m), (p, n) = u.shape, C.shape
    chunk = max(_STRIPE, int(_CHUNK_BYTES / (16.0 * p * (n * (m + 1) + p * m + 1))))
    state, known = np.vstack([np.zeros((m * p, n)), C]), np.zeros(n)
    for first in range(0, samples, chunk):
        part = slice(first, min(first + chunk, samples))
        driven = (u[part, :, None, None] * C).reshape(len(u[part]), m * p, n)
        driven = np.concatenate([driven, np.zeros((len(driven), p, n))], axis=1)
        states, state = march(driven, A, state)
        columns = [states.reshape(len(states), m + 1, p, n).transpose(0, 2, 1, 3).reshape(len(states), p, (m + 1) * n)]
        if feedthrough:
            columns.append(np.einsum("km,pq->kpqm", u[part], np.eye(p)).reshape(-1, p, p * m))
        # A column of zeros leaves the constant at zero.
        constant = np.zeros((p, p)) if K.any() else np.eye(p)
        columns.append(np.broadcast_to(constant, (len(states), p, p)))
        right = y[part]
        if K.any():
            fed, known = march_one(y[part] @ K.T, A, known)
            right = right - fed @ C.T
        yield np.concatenate([*columns, right[:, :, None]], axis=2)


def residual(u: Floats, y: Floats, A: Floats, C: Floats, fit: InputFit) -> Floats:
    """Return what the simulation leaves of the output, shape (N, p).

    Args:
        u: shape (N, m).
        y: shape (N, p).
        A: shape (n, n).
        C: shape (p, n).
        fit: B, D and x0.
    """
    states, _ = march_one(u @ fit.B.T, A, fit.x0)
    left: Floats = y - states @ C.T - u @ fit.D.T - fit.offset
    return left

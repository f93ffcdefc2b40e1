"""The matrices of a model from its subspaces.

The sequence is states = memory · W_p, one sample later memory · W_p one sample later, all by way of the triangular
factor. [A B; C D] by regression of the next state and the output on the state and the input is biased as long as
the horizon is finite (Van Overschee & De Moor 1996, section 4.4.2; the state of a finite past is not the state of
the stationary filter), but has a small variance; its residuals give the covariances of the noise.

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
import scipy.linalg

from workbench.core.values.arrays import Floats
from workbench.identification.identified.recursion import march, march_one
from workbench.identification.subspace.projections import ROUNDING, HankelFactor, triangular

__all__ = [
    "InputFit",
    "Noise",
    "StateFit",
    "fit_inputs",
    "fit_states",
    "noise_of",
    "radius",
    "residual",
    "shifted_observability",
    "stabilise",
]


def shifted_observability(observability: Floats, outputs: int) -> tuple[Floats, Floats]:
    """Return A and C of the extended observability matrix [C; C A; C A²; …] by its shift (Kung 1978).

    In trials with noise at the output this was as good as the regression on the state sequence with all future
    inputs (Van Overschee & De Moor 1996, figure 4.8), and as exact without noise.

    Args:
        observability: shape (i p, n).
        outputs: p.
    """
    upper, below = observability[:-outputs], observability[outputs:]
    A = np.asarray(np.linalg.lstsq(upper, below, rcond=None)[0], dtype=np.float64)
    return A, observability[:outputs]


def radius(A: Floats) -> float:
    """Return the largest magnitude of an eigenvalue.

    Args:
        A: shape (n, n).
    """
    return float(np.max(np.abs(np.linalg.eigvals(A)), initial=0.0))


# -- a stable model in place of one that is not ---------------------------------------------------

# Poles outside the unit circle are mirrored at it, in the real Schur form (an orthogonal change of basis, so that well
# and badly separated poles are treated alike); B, D and x0 are estimated again afterwards, so that the fit is the best
# one for the new A. Mirroring keeps a pole's frequency and, up to a constant, the size of its frequency response. The
# alternative, a zero block below the shifted observability matrix (Chui & Maciejowski 1996), moves all poles, also the
# good ones.
STABLE_RADIUS = 1.0 - 1e-6  # poles at the unit circle itself are drawn in to here


def stabilise(A: Floats) -> tuple[Floats, int]:
    """Return A with all eigenvalues inside the unit circle, and how many were moved.

    Args:
        A: shape (n, n).
    """
    T, Q = scipy.linalg.schur(A, output="real")
    moved = 0
    for block in _blocks(T):
        size = float(np.sqrt(abs(np.linalg.det(T[block, block]))))
        size = size if T[block, block].shape == (2, 2) else size**2
        if size > STABLE_RADIUS:
            T[block, block] *= min(1.0 / size, STABLE_RADIUS) / size
            moved += T[block, block].shape[0]
    return (Q @ T @ Q.T, moved) if moved else (A, 0)


def _blocks(T: Floats) -> list[slice]:
    """Return the diagonal blocks of a real Schur form: one real eigenvalue or one complex pair each."""
    blocks, k = [], 0
    while k < len(T):
        size = 2 if k + 1 < len(T) and T[k + 1, k] != 0.0 else 1
        blocks.append(slice(k, k + size))
        k += size
    return blocks


@dataclass(frozen=True, eq=False)
class StateFit:
    """Regression on the state sequence.

    Attributes:
        A, B, C, D: the biased model.
        residual: shape (n + p, k), of next state and output, in the columns of the triangular factor.
        scale: shape (n + p,), size of next state and output.
    """

    A: Floats
    B: Floats
    C: Floats
    D: Floats
    residual: Floats
    scale: Floats


@dataclass(frozen=True, eq=False)
class Noise:
    """The innovation form.

    Attributes:
        K: shape (n, p); A − K C is stable.
        covariance: shape (p, p), of the innovations.
        note: why K is zero; empty if it is not.
    """

    K: Floats
    covariance: Floats
    note: str = ""


def fit_states(factor: HankelFactor, memory: Floats, *, feedthrough: bool) -> StateFit:
    """Return the regression of next state and output on state and input.

    Args:
        factor: of the record.
        memory: shape (n, i (m + p)).
        feedthrough: D is estimated.
    """
    i, n = factor.horizon, len(memory)
    now, later = memory @ factor.past(), memory @ factor.past(1)
    u, y = factor.u(i, i + 1), factor.y(i, i + 1)
    known = np.vstack([now, u])
    AB = _regress(later, known)
    CD = _regress(y, known if feedthrough else now)
    D = CD[:, n:] if feedthrough else np.zeros((len(y), len(u)))
    C = CD[:, :n]
    residual = np.vstack([later - AB @ known, y - C @ now - D @ u])
    scale = np.linalg.norm(np.vstack([later, y]), axis=1)
    return StateFit(AB[:, :n], AB[:, n:], C, D, residual, scale)


def _regress(what: Floats, on: Floats) -> Floats:
    solution = np.linalg.lstsq(on.T, what.T, rcond=10.0 * max(on.shape) * ROUNDING)[0]
    return np.asarray(solution.T, dtype=np.float64)


def noise_of(fit: StateFit, A: Floats, C: Floats) -> Noise:
    """Return gain and covariance of the innovations for A and C in the basis of `fit`.

    The stationary Kalman gain follows from the residuals' covariance by the discrete Riccati equation
    (Van Overschee & De Moor 1996, section 4.4.3 and appendix A), which makes A − K C stable.

    Args:
        fit: from `fit_states`.
        A: shape (n, n).
        C: shape (p, n).
    """
    n, p = len(A), len(C)
    covariance = fit.residual @ fit.residual.T
    R = covariance[n:, n:]
    floor = 1e3 * ROUNDING * float(np.max(fit.scale[n:], initial=0.0))
    if np.linalg.norm(fit.residual[n:], 2) <= floor:
        return Noise(np.zeros((n, p)), R, "the data contain no noise beyond rounding: K is zero")
    if n == 0:
        return Noise(np.zeros((0, p)), R)
    try:
        return _riccati(covariance, A, C)
    except (np.linalg.LinAlgError, ValueError):
        return Noise(np.zeros((n, p)), R, "the noise gives no stable predictor: K is zero")


def _riccati(covariance: Floats, A: Floats, C: Floats) -> Noise:
    n = len(A)
    Q, S, R = covariance[:n, :n], covariance[:n, n:], covariance[n:, n:]
    P = scipy.linalg.solve_discrete_are(A.T, C.T, Q, R, s=S)
    spread = C @ P @ C.T + R
    K = np.linalg.solve(spread.T, (A @ P @ C.T + S).T).T
    if not np.all(np.isfinite(K)) or radius(A - K @ C) >= 1.0:
        raise ValueError
    return Noise(K, (spread + spread.T) / 2.0)


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
    result = np.linalg.lstsq(matrix / length, right, rcond=10.0 * len(length) * ROUNDING)[0]
    return np.asarray(result / length, dtype=np.float64)


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

"""What the Kalman state sequence tells: the biased model, the noise and the predictor's gain.

The sequence is states = memory · W_p, one sample later memory · W_p one sample later, all by way of the triangular
factor. [A B; C D] by regression of the next state and the output on the state and the input is biased as long as
the horizon is finite (Van Overschee & De Moor 1996, section 4.4.2; the state of a finite past is not the state of
the stationary filter), but has a small variance; its residuals give the covariances of the noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from workbench.core.values.arrays import Floats
from workbench.identification.subspace.hankel import ROUNDING, HankelFactor
from workbench.identification.subspace.matrices import radius

__all__ = ["Noise", "StateFit", "fit_states", "noise_of"]


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

"""A long linear difference equation fitted to data, the common ground of several questions.

y[k] = Σ a_i y[k−i] + Σ b_j u[k−j] + constant + drift + e[k], each output on all outputs and inputs. With many lags its
residual e is white whatever the noise of a linear system, in open and in closed loop (L. Ljung, System
Identification, 2nd ed., sections 4.2, 13.4 and 16.4).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from workbench.core.machine.blas import one_thread
from workbench.core.values.arrays import Floats

__all__ = ["LongArx", "fit_long_arx", "lagged"]

_MOST_LAGS = 25
_ROUNDING = 1e-11  # relative; columns and residuals below it are numerical noise


@dataclass(frozen=True, eq=False)
class LongArx:
    """The fitted equation.

    Attributes:
        lags: so many past outputs, inputs 0 … lags.
        a: shape (lags, p, p), [i, q, r]: output q from output r, i + 1 samples ago.
        b: shape (lags + 1, p, m).
        drift: shape (p,), change of the output per sample that no input explains, as forced through the equation.
        residual: shape (n − lags, p), its first row is sample `lags`.
        sigma: shape (p,), standard deviation of the residual, degrees of freedom taken off.
        floor: shape (p,), what rounding makes of a perfect fit.
    """

    lags: int
    a: Floats
    b: Floats
    drift: Floats
    residual: Floats
    sigma: Floats
    floor: Floats

    @property
    def exact(self) -> bool:
        """Whether the equation fits to rounding: no noise at all and nothing nonlinear."""
        return bool(np.all(self.sigma <= self.floor))

    def simulate(self, u: Floats) -> Floats:
        """Return the output by the inputs alone, from rest, shape (n, p).

        Args:
            u: shape (n, m).
        """
        n, p = len(u), self.a.shape[1]
        forced = sum(np.vstack([np.zeros((j, p)), u[: n - j] @ self.b[j].T]) for j in range(min(self.lags + 1, n)))
        return self._recurse(np.asarray(forced))

    def impulse(self, count: int) -> Floats:
        """Return the impulse response, shape (count, p, m)."""
        m = self.b.shape[2]
        unit = np.zeros((m, count, m))
        unit[np.arange(m), 0, np.arange(m)] = 1.0
        return np.stack([self.simulate(u) for u in unit], axis=2)

    def _recurse(self, forced: Floats) -> Floats:
        """Return y of y[k] = Σ a_i y[k−i] + forced[k], by one triangular solution with a band."""
        n, p = forced.shape
        # Row r of the band is the r-th diagonal below the main one; unknowns in the order y1[0], y2[0], …, y1[1], ….
        band = np.zeros((p * (self.lags + 1), p))
        band[0] = 1.0
        for q, r, i in np.ndindex(p, p, self.lags):
            band[(i + 1) * p + q - r, r] = -self.a[i, q, r]
        with np.errstate(all="ignore"):
            solved, _ = linalg.lapack.dtbtrs(np.tile(band, n), forced.reshape(-1, 1), uplo="L")
        return np.asarray(solved, dtype=np.float64).reshape(n, p)


def lagged(x: Floats, first: int, last: int, start: int) -> Floats:
    """Return the columns x[k − first], …, x[k − last] for k = start … n − 1, shape (n − start, c·lags).

    Args:
        x: shape (n, c).
        first: smallest lag.
        last: largest lag, at most `start`.
        start: the sample of the first row.
    """
    n = len(x)
    return np.hstack([x[start - lag : n - lag] for lag in range(first, last + 1)])


def fit_long_arx(u: Floats, y: Floats, *, truncate: float = _ROUNDING, lags: int | None = None) -> LongArx:
    """Fit by least squares (QR with column pivoting, as exact data make columns dependent).

    Args:
        u: shape (n, m).
        y: shape (n, p).
        truncate: directions that the data hold less of, relative to the largest, are left at 0. Larger values keep
            the equation tame at frequencies without excitation and cost accuracy.
        lags: so many past outputs and inputs; None: as many as are ever needed, if the record is long enough.
    """
    n, m, p = len(u), u.shape[1], y.shape[1]
    most = max(1, min(_MOST_LAGS, n // (8 * (m + p))))
    lags = most if lags is None else min(lags, most)
    clock = np.linspace(-1.0, 1.0, n - lags)
    columns = np.hstack([lagged(y, 1, lags, lags), lagged(u, 0, lags, lags), np.ones((n - lags, 1)), clock[:, None]])
    scale = np.maximum(np.sqrt(np.mean(columns**2, axis=0)), 1e-300)
    with one_thread():
        theta, rank = _least_squares(columns / scale, y[lags:], truncate)
    residual = y[lags:] - columns / scale @ theta
    theta /= scale[:, None]
    split = lags * p
    size = np.sqrt(np.mean((y - y.mean(axis=0)) ** 2, axis=0))
    return LongArx(
        lags=lags,
        a=np.transpose(theta[:split].reshape(lags, p, p), (0, 2, 1)),
        b=np.transpose(theta[split:-2].reshape(lags + 1, m, p), (0, 2, 1)),
        drift=theta[-1] * 2.0 / max(n - lags - 1, 1),
        residual=residual,
        sigma=np.sqrt(np.sum(residual**2, axis=0) / max(n - lags - rank, 1)),
        floor=1e-8 * size + 1e-14 * np.max(np.abs(y), axis=0),
    )


def _least_squares(columns: Floats, target: Floats, truncate: float) -> tuple[Floats, int]:
    """Return the solution of minimum norm, shape (c, p), and the rank."""
    theta, _, rank, _ = linalg.lstsq(columns, target, cond=truncate, lapack_driver="gelsy")
    return np.asarray(theta), int(rank)

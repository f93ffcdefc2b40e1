"""The one-step predictor of a linear model, and how it depends on the model: predictor.h."""

from __future__ import annotations

import ctypes

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.kernel.library import kernel
from workbench.kernel.structs import Predictor

__all__ = ["predict", "sensitivities"]


def predict(
    matrices: tuple[Floats, Floats, Floats, Floats, Floats, Floats], u: Floats, y: Floats, state: Floats
) -> tuple[Floats, Floats]:
    """Return states (N, n) and errors (N, p) of the one-step prediction; both overflow where it is not stable.

    Args:
        matrices: A (n, n), B (n, m), C (p, n), D (p, m), K (n, p), offset (p,).
        u: shape (N, m).
        y: shape (N, p).
        state: shape (n,), of the first sample; afterwards of the sample behind the last.
    """
    a, b, c, d, k, offset = (np.ascontiguousarray(matrix, dtype=np.float64) for matrix in matrices)
    n, m, p, samples = len(a), b.shape[1], len(c), len(u)
    model = Predictor(n, m, p, *(matrix.ctypes.data for matrix in (a, b, c, d, k, offset)))
    inputs, outputs = np.ascontiguousarray(u), np.ascontiguousarray(y)
    states, errors = np.empty((samples, n)), np.empty((samples, p))
    kernel().kernel_predict(
        ctypes.addressof(model), samples, inputs.ctypes.data, outputs.ctypes.data, state.ctypes.data,
        states.ctypes.data, errors.ctypes.data,
    )  # fmt: skip
    return states, errors


def sensitivities(f: Floats, c: Floats, signals: Floats, rows: Floats) -> Floats:
    """Return R(k) of R(k + 1) = R(k) f + signals(k) ⊗ c, shape (N, p, s, n).

    R[r, s, i] is what signal s at entry i of the state does to output r.

    Args:
        f: shape (n, n).
        c: shape (p, n).
        signals: shape (N, s).
        rows: R(0), shape (p, s, n); afterwards R(N).
    """
    given, outputs, driven = (np.ascontiguousarray(matrix, dtype=np.float64) for matrix in (f, c, signals))
    (samples, count), (p, n) = driven.shape, outputs.shape
    out = np.empty((samples, p, count, n))
    kernel().kernel_sensitivities(
        given.ctypes.data, outputs.ctypes.data, n, p, count, samples, driven.ctypes.data, rows.ctypes.data,
        out.ctypes.data,
    )  # fmt: skip
    return out

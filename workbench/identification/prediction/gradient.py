"""The errors of the one-step prediction and their exact derivatives, gathered stretch by stretch."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.identification.prediction.innovations import Entries, Innovations
from workbench.kernel.native_predictor import predict, sensitivities

__all__ = ["Normal", "errors_of", "jacobian", "normal_equations"]

_BYTES = 2.0**24  # of derivatives held at a time
Record = tuple[Floats, Floats]


@dataclass(frozen=True, eq=False)
class Normal:
    """The normal equations of the weighted errors.

    Attributes:
        matrix: shape (f, f), Σ Jᵀ W J, with J the derivatives of the prediction by the directions.
        right: shape (f,), Σ Jᵀ W e.
    """

    matrix: Floats
    right: Floats


def errors_of(model: Innovations, record: Record) -> Floats:
    """Return the errors of the one-step prediction, shape (N, p); not finite where it is not stable.

    Args:
        model: to predict with, from its x0.
        record: u (N, m) and y (N, p).
    """
    return predict(model.matrices, *record, model.x0.copy())[1]


def normal_equations(
    model: Innovations, record: Record, weight: Floats, entries: Entries, directions: Floats
) -> Normal:
    """Return the normal equations of some directions of the free entries.

    Args:
        model: where the derivatives are taken.
        record: u (N, m) and y (N, p).
        weight: shape (p, p), the errors are multiplied by it.
        entries: numbers of the free entries.
        directions: shape (entries, f).
    """
    count = directions.shape[1]
    matrix, right = np.zeros((count, count)), np.zeros(count)
    for J, e in jacobian(model, record, entries, directions):
        weighted = np.ascontiguousarray(np.matmul(weight, J)).reshape(-1, count)
        matrix += weighted.T @ weighted
        right += weighted.T @ (e @ weight.T).ravel()
    return Normal(matrix, right)


def jacobian(
    model: Innovations, record: Record, entries: Entries, directions: Floats
) -> Iterator[tuple[Floats, Floats]]:
    """Yield stretches of the derivatives of the prediction by directions of the free entries, and its errors (k, p).

    An entry (i, j) of A, B or K drives state i by signal j of x, u or e; its effect on the outputs is a row of the
    kernel's sensitivities. C, D and the offset act on the outputs at once, and through K on the states. The
    initial state is one more signal, zero but for the start. All of that is linear in the sensitivities and the
    signals, so that the directions are multiplied first, and only with these: there are fewer of them than entries.

    Args:
        model: where the derivatives are taken.
        record: u (N, m) and y (N, p).
        entries: numbers of the free entries.
        directions: shape (entries, f).

    Yields:
        Derivatives, shape (k, p, f), and errors, shape (k, p).
    """
    u, y = record
    (samples, m), p, n = u.shape, y.shape[1], len(model.A)
    signals, count = n + m + p + 2, directions.shape[1]  # x, u, e, 1 and the pulse
    state, rows = model.x0.copy(), np.zeros((p, signals, n))
    rows[:, -1] = model.C
    by_states, at_once = _folded(model, entries, directions)
    chunk = max(64, int(_BYTES / (8.0 * p * (signals * n + 2 * count))))
    F, outer = model.predictor, [*range(n + m), n + m + p]
    for first in range(0, samples, chunk):
        part = slice(first, min(first + chunk, samples))
        x, e = predict(model.matrices, u[part], y[part], state)
        driven = np.hstack([x, u[part], e, np.ones((len(x), 1)), np.zeros((len(x), 1))])
        R = sensitivities(F, model.C, driven, rows)
        found = (R.reshape(len(x) * p, signals * n) @ by_states).reshape(len(x), p, count)
        found += (driven[:, outer] @ at_once).reshape(len(x), p, count)
        yield found, e


def _folded(model: Innovations, entries: Entries, directions: Floats) -> tuple[Floats, Floats]:
    """Return what the directions make of the sensitivities, and of the signals x, u and 1 at once.

    Args:
        model: with its sizes and K.
        entries: numbers of the free entries.
        directions: shape (entries, f).

    Returns:
        Shape (s n, f), signals and states in the order of the sensitivities, and (n + m + 1, p f).
    """
    n, m, p, count = len(model.A), model.B.shape[1], len(model.C), directions.shape[1]
    sizes = np.cumsum([0, *(part.size for part in model.parts)])
    full = np.zeros((sizes[-1], count))
    full[entries] = directions
    A, B, K, C, D, offset, x0 = (
        full[a:b].reshape(*part.shape, count) for a, b, part in zip(sizes, sizes[1:], model.parts, strict=False)
    )
    states = np.zeros((n + m + p + 2, n, count))
    states[: n + m + p] = np.concatenate([A, B, K], axis=1).transpose(1, 0, 2)
    states[-1] = x0
    outer = np.concatenate([C, D, offset[:, None]], axis=1).transpose(1, 0, 2)  # (n + m + 1, p, f)
    states[[*range(n + m), n + m + p]] -= np.einsum("ir,jrf->jif", model.K, outer)
    return states.reshape(-1, count), outer.reshape(n + m + 1, p * count)

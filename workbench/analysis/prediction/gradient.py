"""The errors of the one-step prediction and their exact derivatives, gathered stretch by stretch."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from workbench.analysis.prediction.innovations import Entries, Innovations
from workbench.kernel.native_predictor import predict, sensitivities
from workbench.session.base import Floats

__all__ = ["Normal", "errors_of", "jacobian", "normal_equations"]

_BYTES = 2.0**24  # of derivatives held at a time
Record = tuple[Floats, Floats]


@dataclass(frozen=True, eq=False)
class Normal:
    """The normal equations of the weighted errors.

    Attributes:
        matrix: shape (entries, entries), Σ Jᵀ W J, with J the derivatives of the prediction.
        right: shape (entries,), Σ Jᵀ W e.
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


def normal_equations(model: Innovations, record: Record, weight: Floats, entries: Entries) -> Normal:
    """Return the normal equations of the free entries.

    Args:
        model: where the derivatives are taken.
        record: u (N, m) and y (N, p).
        weight: shape (p, p), the errors are multiplied by it.
        entries: numbers of the free entries.
    """
    count = len(entries)
    matrix, right = np.zeros((count, count)), np.zeros(count)
    for J, e in jacobian(model, record, entries):
        weighted = np.ascontiguousarray(np.matmul(weight, J)).reshape(-1, count)
        matrix += weighted.T @ weighted
        right += weighted.T @ (e @ weight.T).ravel()
    return Normal(matrix, right)


def jacobian(model: Innovations, record: Record, entries: Entries) -> Iterator[tuple[Floats, Floats]]:
    """Yield stretches of the derivatives of the prediction by the free entries (k, p, entries), and its errors (k, p).

    An entry (i, j) of A, B or K drives state i by signal j of x, u or e; its effect on the outputs is a row of the
    kernel's sensitivities. C, D and the offset act on the outputs at once, and through K on the states. The
    initial state is one more signal, zero but for the start.

    Args:
        model: where the derivatives are taken.
        record: u (N, m) and y (N, p).
        entries: numbers of the free entries.
    """
    u, y = record
    (samples, m), p, n = u.shape, y.shape[1], len(model.A)
    signals = n + m + p + 2  # x, u, e, 1 and the pulse
    state, rows = model.x0.copy(), np.zeros((p, signals, n))
    rows[:, -1] = model.C
    F = model.predictor
    columns = (n + m + p) * n + p * (n + m + 1) + n
    chunk = max(64, int(_BYTES / (8.0 * p * (signals * n + 2 * columns))))
    outputs = np.eye(p)
    for first in range(0, samples, chunk):
        part = slice(first, min(first + chunk, samples))
        x, e = predict(model.matrices, u[part], y[part], state)
        driven = np.hstack([x, u[part], e, np.ones((len(x), 1)), np.zeros((len(x), 1))])
        R = sensitivities(F, model.C, driven, rows)
        by_state = R[:, :, : n + m + p].transpose(0, 1, 3, 2)  # (k, p, n, signals)
        through = R[:, :, [*range(n + m), n + m + p]] @ model.K  # (k, p, x u 1, p)
        at_once = driven[:, [*range(n + m), n + m + p]]
        direct = outputs[None, :, :, None] * at_once[:, None, None, :] - through.transpose(0, 1, 3, 2)
        every = np.concatenate([
            *(by_state[..., a:b].reshape(len(x), p, -1) for a, b in ((0, n), (n, n + m), (n + m, n + m + p))),
            *(direct[..., a:b].reshape(len(x), p, -1) for a, b in ((0, n), (n, n + m), (n + m, n + m + 1))),
            R[:, :, -1],
        ], axis=2)  # fmt: skip
        yield (every if len(entries) == columns else every[:, :, entries]), e

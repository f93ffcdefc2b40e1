"""A linear model in innovations form, the errors of its prediction and their derivatives.

    x(k + 1) = A x(k) + B u(k) + K e(k),   y(k) = C x(k) + D u(k) + offset + e(k)

The first states are the plant's, the others the disturbance's. What may be changed is said by the structure:

- *shared*: K drives the plant's states: plant and disturbance have their poles in common (ARMAX, for one output);
- *output error*: K is zero, the disturbance is white;
- *Box–Jenkins*: the disturbance has states of its own, which no input reaches; A is block diagonal.

The free entries of all matrices are more than the model's degrees of freedom: every change of the state basis leaves
the model the same. The directions at right angles to these changes are the local coordinates (data-driven local
coordinates: T. McKelvey, A. Helmersson and T. Ribarits, Automatica 40, 2004); they are found anew at each step.

A steady gain of the plant, C (I − A)⁻¹ B + D, can be held: the local coordinates then are those at right angles to its
derivative, too, and what a step leaves of it is taken away by Newton's method, by the smallest change of the entries.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from workbench.core.values.arrays import Floats
from workbench.identification.subspace.matrices import radius
from workbench.kernel.native_predictor import predict, sensitivities

__all__ = ["Entries", "Innovations", "errors_of", "jacobian", "normal_equations"]

Entries = NDArray[np.intp]

_NEAR = 0.9999  # from here on gramians are too large to balance with
_HELD = 1e-12  # of a gain that is held, relative to the larger of it and 1
_CORRECTIONS = 30  # of Newton's method


@dataclass(frozen=True, eq=False, kw_only=True)
class Innovations:
    """Matrices and structure.

    Attributes:
        A: shape (n + d, n + d).
        B: shape (n + d, m).
        C: shape (p, n + d).
        D: shape (p, m).
        K: shape (n + d, p).
        offset: shape (p,), constant part of the output.
        x0: shape (n + d,), state at the first sample.
        plant: n, states of the plant.
        shared: K drives the plant's states; there are no others then.
        feedthrough: D is free, else it stays as it is.
        gains: shape (p, m), steady gains of the plant that are held; not a number where one is free; None: all are.
    """

    A: Floats
    B: Floats
    C: Floats
    D: Floats
    K: Floats
    offset: Floats
    x0: Floats
    plant: int
    shared: bool
    feedthrough: bool = True
    gains: Floats | None = None

    @property
    def disturbance(self) -> int:
        """Number of states of the disturbance."""
        return len(self.A) - self.plant

    @property
    def predictor(self) -> Floats:
        """A − K C, whose poles are those of the one-step prediction."""
        return self.A - self.K @ self.C

    @property
    def matrices(self) -> tuple[Floats, Floats, Floats, Floats, Floats, Floats]:
        """A, B, C, D, K and offset."""
        return self.A, self.B, self.C, self.D, self.K, self.offset

    # -- free entries ------------------------------------------------------------------------------

    @property
    def parts(self) -> tuple[Floats, ...]:
        """A, B, K, C, D, offset and x0, in the order of the entries."""
        return self.A, self.B, self.K, self.C, self.D, self.offset, self.x0

    def free(self) -> Entries:
        """Return which entries may be changed, as numbers in the order of `parts`, by rows."""
        size, n = len(self.A), self.plant
        own = np.arange(size) < n
        masks = (
            own[:, None] == own[None, :],
            np.broadcast_to(own[:, None], self.B.shape),
            np.broadcast_to(own[:, None] == self.shared, self.K.shape) if self.shared or size > n else self.K != self.K,
            np.ones(self.C.shape, dtype=np.bool_),
            np.full(self.D.shape, self.feedthrough),
            np.ones(self.offset.shape, dtype=np.bool_),
            np.ones(self.x0.shape, dtype=np.bool_),
        )
        return np.flatnonzero(np.concatenate([mask.ravel() for mask in masks]))

    def moved(self, entries: Entries, change: Floats) -> Innovations:
        """Return the model with a change of its free entries.

        Args:
            entries: numbers of the free entries.
            change: as many.
        """
        return self._changed(entries, change).held()

    def _changed(self, entries: Entries, change: Floats) -> Innovations:
        flat = np.concatenate([part.ravel() for part in self.parts])
        flat[entries] += change
        return self._from(flat)

    def _from(self, flat: Floats) -> Innovations:
        result, first = [], 0
        for part in self.parts:
            result.append(flat[first : first + part.size].reshape(part.shape))
            first += part.size
        A, B, K, C, D, offset, x0 = result
        return replace(self, A=A, B=B, K=K, C=C, D=D, offset=offset, x0=x0)

    def coordinates(self, entries: Entries) -> Floats:
        """Return the local coordinates: orthonormal directions of the free entries, shape (entries, freedom).

        With T a small change of basis, A changes by T A − A T, B by T B, K by T K, C by −C T, x0 by T x0; the
        directions are those at right angles to all of these.

        Args:
            entries: numbers of the free entries.
        """
        size = len(self.A)
        eye = np.eye(size)
        tangent = np.vstack([
            np.kron(eye, self.A.T) - np.kron(self.A, eye), np.kron(eye, self.B.T), np.kron(eye, self.K.T),
            -np.kron(self.C, eye), np.zeros((self.D.size + self.offset.size, size * size)),
            np.kron(eye, self.x0[None, :]),
        ])  # fmt: skip
        own = np.arange(size) < self.plant
        within = np.flatnonzero((own[:, None] == own[None, :]).ravel())
        full, _ = scipy.linalg.qr(tangent[np.ix_(entries, within)])
        directions = np.asarray(full[:, len(within) :])
        if self.gains is None:
            return directions
        return np.asarray(directions @ scipy.linalg.null_space(self._gains_off(entries)[1] @ directions))

    # -- steady gains that are held ------------------------------------------------------------------

    @property
    def holds(self) -> bool:
        """Whether the plant has the steady gains that are held."""
        if self.gains is None:
            return True
        off = self._gains_off(self.free())[0]
        wanted = np.abs(self.gains[~np.isnan(self.gains)])
        return bool(np.all(np.abs(off) <= 1e3 * _HELD * np.maximum(wanted, 1.0)))

    def held(self) -> Innovations:
        """Return the model with the steady gains that are held, by the smallest change of its free entries.

        Where they cannot be reached (`holds` tells), it comes back as it is.
        """
        if self.gains is None:
            return self
        model, entries = self, self.free()
        wanted = np.maximum(np.abs(self.gains[~np.isnan(self.gains)]), 1.0)
        for _ in range(_CORRECTIONS):
            off, slopes = model._gains_off(entries)
            if not (np.all(np.isfinite(off)) and np.all(np.isfinite(slopes))):
                return self
            if np.all(np.abs(off) <= _HELD * wanted):
                return model
            change: Floats = -np.asarray(np.linalg.lstsq(slopes, off, rcond=None)[0], dtype=np.float64)
            model = model._changed(entries, change)
        return model if model.holds else self

    def _gains_off(self, entries: Entries) -> tuple[Floats, Floats]:
        """Return by how much the gains that are held are off, and their derivatives by the entries, (c, entries)."""
        wanted = np.full(self.D.shape, np.nan) if self.gains is None else self.gains
        n = self.plant
        try:
            inner = np.linalg.inv(np.eye(n) - self.A[:n, :n])
        except np.linalg.LinAlgError:
            inner = np.full((n, n), np.nan)
        left, right = self.C[:, :n] @ inner, inner @ self.B[:n]
        gain = self.C[:, :n] @ right + self.D
        off, rows = [], []
        for i, j in np.argwhere(~np.isnan(wanted)):
            parts = [np.zeros_like(part) for part in self.parts]
            parts[0][:n, :n] = np.outer(left[i], right[:, j])
            parts[1][:n, j], parts[3][i, :n], parts[4][i, j] = left[i], right[:, j], 1.0
            off.append(gain[i, j] - wanted[i, j])
            rows.append(np.concatenate([part.ravel() for part in parts])[entries])
        return np.array(off), np.array(rows).reshape(len(off), len(entries))

    # -- basis ---------------------------------------------------------------------------------------

    def balanced(self) -> Innovations:
        """Return the same model, the states of plant and disturbance each in a basis where all are alike in size.

        The gramians are those of the predictor's part, which is stable where the plant itself is not.
        """
        T, back = np.eye(len(self.A)), np.eye(len(self.A))
        for part in self._blocks():
            T[part, part], back[part, part] = _balancing(
                self.A[part, part], np.hstack([self.B[part], self.K[part]]), self.C[:, part], self.K[part]
            )
        return replace(
            self, A=T @ self.A @ back, B=T @ self.B, K=T @ self.K, C=self.C @ back, x0=T @ self.x0
        )  # fmt: skip

    def _blocks(self) -> Iterator[slice]:
        if self.plant:
            yield slice(0, self.plant)
        if self.disturbance:
            yield slice(self.plant, len(self.A))


def _balancing(A: Floats, driven: Floats, C: Floats, K: Floats) -> tuple[Floats, Floats]:
    """Return T and its inverse that balance a stable model, or one whose predictor is; else nothing is changed."""
    same = np.eye(len(A)), np.eye(len(A))
    stable = A if radius(A) < _NEAR else A - K @ C
    if radius(stable) >= _NEAR:
        return same
    reach = scipy.linalg.solve_discrete_lyapunov(stable, driven @ driven.T)
    seen = scipy.linalg.solve_discrete_lyapunov(stable.T, C.T @ C)
    try:
        root = np.linalg.cholesky(reach + 1e-12 * np.trace(reach) / len(A) * np.eye(len(A)))
    except np.linalg.LinAlgError:
        return same
    values, vectors = np.linalg.eigh(root.T @ seen @ root)
    values = np.maximum(values, 1e-10 * max(float(values[-1]), 1e-300))
    quarter = values**0.25
    return quarter[:, None] * vectors.T @ np.linalg.inv(root), (root @ vectors) / quarter


_BYTES = 2.0**24  # of derivatives held at a time
Record = tuple[Floats, Floats]


def errors_of(model: Innovations, record: Record) -> Floats:
    """Return the errors of the one-step prediction, shape (N, p); not finite where it is not stable.

    Args:
        model: to predict with, from its x0.
        record: u (N, m) and y (N, p).
    """
    return predict(model.matrices, *record, model.x0.copy())[1]


def normal_equations(
    model: Innovations, record: Record, weight: Floats, entries: Entries, directions: Floats
) -> tuple[Floats, Floats]:
    """Return the normal equations of the weighted errors: Σ Jᵀ W J, shape (f, f), and Σ Jᵀ W e, shape (f,).

    J are the derivatives of the prediction by the directions.

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
    return matrix, right


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
        result = (R.reshape(len(x) * p, signals * n) @ by_states).reshape(len(x), p, count)
        result += (driven[:, outer] @ at_once).reshape(len(x), p, count)
        yield result, e


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

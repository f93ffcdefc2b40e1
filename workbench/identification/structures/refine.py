"""A chain of a static block, a linear one and a static one, and how all of it is fitted at once.

    v = f(u),   x(k + 1) = A x(k) + B v(k),   w = C x + D v + offset,   y = g(w) + n,   n(k) = −Σ aᵢ n(k − i) + e(k)

What is made least is Σ e², by Gauss–Newton steps with Levenberg's damping on all parameters at once: values of f and g
at their knots, and the linear block in local coordinates (see `prediction/innovations.py`). The coefficients aᵢ, found
from what the chain leaves in between, make e white, so that the inverse of the normal equations times the variance of e
is the covariance (Ljung 1999, section 9.4).

Scales can be moved from block to block. So f keeps mean and regression line of its input over the data, y = x, and g
the slope of its own. The offset is then free before g only where g is not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg

from workbench.core.values.arrays import Floats, filtered
from workbench.identification.prediction.innovations import Entries, Innovations, errors_of, jacobian
from workbench.identification.prediction.refine import STEADY
from workbench.identification.structures.table import places, weights
from workbench.identification.subspace.matrices import radius

__all__ = ["Fitted", "PiecewiseLinearBlock", "WienerHammersteinModel", "fitted", "line_of"]

_MOST = 60  # steps
_NEAR = 0.01  # gain in χ² of a step that is the last
_TRIES = 10
_COLOUR = 25  # coefficients of the noise's equation that are tried
_ROUNDS = 3  # of the noise's colour


@dataclass(frozen=True, eq=False)
class PiecewiseLinearBlock:
    """A static block that is fitted.

    Attributes:
        knots: shape (k,).
        values: shape (k,).
        free: shape (k, f), directions in which the values may change.
    """

    knots: Floats
    values: Floats
    free: Floats

    def of(self, at: Floats) -> Floats:
        """Return values, shape (N,).

        Args:
            at: shape (N,).
        """
        k, t = places(at, self.knots)
        return np.asarray((1.0 - t) * self.values[k] + t * self.values[k + 1])

    def slope(self, at: Floats) -> Floats:
        """Return slopes, shape (N,).

        Args:
            at: shape (N,).
        """
        k, _ = places(at, self.knots)
        return np.asarray((np.diff(self.values) / np.diff(self.knots))[k])


@dataclass(frozen=True, eq=False)
class WienerHammersteinModel:
    """The blocks.

    Attributes:
        before: f; None: v = u.
        linear: with one input and output, and no disturbance.
        behind: g; None: y = w.
    """

    before: PiecewiseLinearBlock | None
    linear: Innovations
    behind: PiecewiseLinearBlock | None

    def inner(self, u: Floats) -> tuple[Floats, Floats]:
        """Return what goes into the linear block and what comes out, shape (N,) each.

        Args:
            u: shape (N,).
        """
        v = u if self.before is None else self.before.of(u)
        return v, -errors_of(self.linear, (v[:, None], np.zeros((len(v), 1))))[:, 0]

    def output(self, u: Floats) -> Floats:
        """Return the output without noise, shape (N,).

        Args:
            u: shape (N,).
        """
        w = self.inner(u)[1]
        return w if self.behind is None else self.behind.of(w)

    def entries(self) -> Entries:
        """Return numbers of the linear block's free entries; where g is there it has the offset."""
        result = self.linear.free()
        if self.behind is None:
            return result
        sizes = np.cumsum([part.size for part in self.linear.parts])
        return np.asarray(result[(result < sizes[4]) | (result >= sizes[5])], dtype=np.intp)


def line_of(signal: Floats, knots: Floats) -> tuple[Floats, Floats]:
    """Return factors of a table's values: their sums are mean and slope of the regression of its output on its input.

    Args:
        signal: shape (N,), the input.
        knots: shape (k,).
    """
    hats, about = weights(signal, knots), signal - signal.mean()
    return np.asarray(hats.mean(axis=0)), np.asarray(about @ hats / (about @ about))


@dataclass(frozen=True, eq=False)
class Fitted:
    """A chain that was fitted.

    Attributes:
        chain: the blocks.
        colour: shape (c,), coefficients of the noise's equation.
        variance: of e.
        covariance: shape (f, f), of the parameters: free directions of f, local coordinates, free directions of g.
        coordinates: shape (entries, l), local coordinates of the linear block.
        samples: N, also those that the noise's equation leaves out.
        settled: a further step would change nothing.
    """

    chain: WienerHammersteinModel
    colour: Floats
    variance: float
    covariance: Floats
    coordinates: Floats
    samples: int
    settled: bool

    @property
    def criterion(self) -> float:
        """The Bayesian criterion, smallest is best."""
        count = len(self.covariance) + len(self.colour)
        return self.samples * math.log(max(self.variance, 1e-300)) + count * math.log(self.samples)


def fitted(start: WienerHammersteinModel, u: Floats, y: Floats, *, stable: bool = True) -> Fitted | None:
    """Return the chain with the least prediction error near a start; None: it has no finite output.

    Args:
        start: the blocks.
        u: shape (N,), of size one.
        y: shape (N,), likewise.
        stable: the linear block's poles stay inside the unit circle.
    """
    chain, colour, settled = start, np.zeros(0), False
    for k in range(_ROUNDS):
        result = _steps(chain, u, y, colour, stable=stable)
        if result is None:
            return None
        chain, settled = result
        if k + 1 < _ROUNDS:
            colour = _coloured(y - chain.output(u))
    e = filtered(y - chain.output(u), np.append(1.0, colour))
    J, coordinates = _slopes(chain, u)
    J = filtered(J, np.append(1.0, colour))
    left = max(len(e) - J.shape[1] - len(colour), 1)
    variance = float(e @ e) / left
    values, vectors = np.linalg.eigh(J.T @ J)
    good = values > 1e-13 * values[-1]
    root = vectors[:, good] / np.sqrt(values[good])
    return Fitted(chain, colour, variance, variance * root @ root.T, coordinates, len(y), settled and bool(good.all()))


def _steps(
    chain: WienerHammersteinModel, u: Floats, y: Floats, colour: Floats, *, stable: bool
) -> tuple[WienerHammersteinModel, bool] | None:
    """Return a chain from which no step leads further, and whether that was reached."""
    damping, e = 1e-3, filtered(y - chain.output(u), np.append(1.0, colour))
    cost = float(e @ e)
    if not math.isfinite(cost):
        return None
    for _ in range(_MOST):
        J, coordinates = _slopes(chain, u)
        J = filtered(J, np.append(1.0, colour))
        H, right = J.T @ J, J.T @ e
        size = np.sqrt(np.maximum(np.diag(H), 1e-12 * max(float(np.diag(H).max()), 1e-300)))
        even, rhs = H / np.outer(size, size), right / size
        for _ in range(_TRIES):
            step = scipy.linalg.solve(even + damping * np.eye(len(even)), rhs, assume_a="pos") / size
            tried = _moved(chain, coordinates, step)
            new = (
                filtered(y - tried.output(u), np.append(1.0, colour))
                if _fine(tried, stable=stable)
                else np.array([np.inf])
            )
            value = float(new @ new)
            if value < cost:
                break
            damping = max(10.0 * damping, 1e-6)
        else:
            return chain, True
        gain, damping = 1.0 - value / cost, max(damping / 10.0, 1e-12)
        chain, e, cost = replace(tried, linear=tried.linear.balanced()), new, value
        if gain < _NEAR / len(y):
            return chain, True
    return chain, False


def _fine(chain: WienerHammersteinModel, *, stable: bool) -> bool:
    return radius(chain.linear.A) < (STEADY if stable else 1.0 + 1e-9)


def _moved(chain: WienerHammersteinModel, coordinates: Floats, step: Floats) -> WienerHammersteinModel:
    """Return the chain with a change of its parameters."""
    before, behind = chain.before, chain.behind
    first = 0 if before is None else before.free.shape[1]
    last = len(step) - (0 if behind is None else behind.free.shape[1])
    if before is not None:
        before = replace(before, values=before.values + before.free @ step[:first])
    if behind is not None:
        behind = replace(behind, values=behind.values + behind.free @ step[last:])
    return WienerHammersteinModel(before, chain.linear.moved(chain.entries(), coordinates @ step[first:last]), behind)


def _slopes(chain: WienerHammersteinModel, u: Floats) -> tuple[Floats, Floats]:
    """Return the derivatives of the output by the parameters, shape (N, f), and the local coordinates."""
    v, w = chain.inner(u)
    entries = chain.entries()
    coordinates = chain.linear.coordinates(entries)
    record = v[:, None], np.zeros((len(v), 1))
    inner = np.concatenate([J[:, 0] for J, _ in jacobian(chain.linear, record, entries, coordinates)])
    columns = [inner]
    if chain.before is not None:
        bare = replace(chain.linear, offset=np.zeros(1), x0=np.zeros_like(chain.linear.x0))
        hats = weights(u, chain.before.knots) @ chain.before.free
        through = [errors_of(bare, (column[:, None], record[1]))[:, 0] for column in hats.T]
        columns.insert(0, -np.array(through).T)
    if chain.behind is not None:
        slope = chain.behind.slope(w)[:, None]
        columns = [slope * part for part in columns] + [weights(w, chain.behind.knots) @ chain.behind.free]
    return np.hstack(columns), coordinates


def _coloured(noise: Floats) -> Floats:
    """Return the coefficients of an equation that makes the noise white, as many as the Bayesian criterion takes."""
    about = noise - noise.mean()
    most = min(_COLOUR, len(noise) // 10)
    own = np.array([about[: len(about) - k] @ about[k:] for k in range(most + 1)]) / len(about)
    if own[0] <= 0.0:
        return np.zeros(0)
    best, result = len(noise) * math.log(own[0]), np.zeros(0)
    for count in range(1, most + 1):
        taps = scipy.linalg.solve_toeplitz(own[:count], own[1 : count + 1])
        variance = own[0] - taps @ own[1 : count + 1]
        criterion = len(noise) * math.log(max(variance, 1e-300)) + count * math.log(len(noise))
        if criterion < best:
            best, result = criterion, -taps
    return result

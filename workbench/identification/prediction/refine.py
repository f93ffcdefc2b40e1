"""From a start to the model of the least prediction error, or of none that knows a reference.

The prediction errors e of a model with a disturbance of its own are not made as small as can be, which feedback would
mislead, but uncorrelated with what the reference can know:

    Σ ζ(k)ᵀ Λ⁻¹ e(k) = 0

with ζ the derivatives of the prediction where the inputs' part by the reference stands in the inputs' place, and those
of the disturbance as they are. As ζ knows nothing of the disturbance, the plant is right in a closed loop, whatever the
model of the disturbance; where that is right, too, e is white, and the covariance of the parameters is

    (Σ ζᵀ Λ⁻¹ ψ)⁻¹ (Σ ζᵀ Λ⁻¹ ζ) (Σ ψᵀ Λ⁻¹ ζ)⁻¹,

with ψ the derivatives under the inputs as they are. The error of the instrument itself is of second order in it
(T. Söderström and P. Stoica, System Identification, 1989, section 8.2; M. Gilson and P. M. J. Van den Hof, Automatica
41, 2005).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg

from workbench.core.values.arrays import Floats
from workbench.identification.prediction.innovations import (
    Entries,
    Innovations,
    Record,
    errors_of,
    jacobian,
    normal_equations,
)
from workbench.identification.subspace.matrices import radius
from workbench.identification.subspace.order import cost

__all__ = ["STEADY", "Refined", "instrumented", "refine"]

_MOST = 60  # steps
_TRIES = 20  # dampings tried for a step
_FIRST, _LEAST, _MUCH = 1e-3, 1e-9, 1e9  # of the damping
_GOOD = 0.75  # of the gain expected
_MORE = 3.0  # times the damping where a step fails
_NEAR = 1e-3  # of a standard deviation (its square: in χ²): from here on a step changes nothing
STEADY = 0.99999  # largest pole of the predictor


@dataclass(frozen=True, eq=False)
class Refined:
    """The model with the smallest prediction error of its structure.

    Attributes:
        model: in a balanced basis.
        covariance: shape (p, p), of the errors.
        cost: log det of it.
        information: shape (f, f), Fisher's, of the local coordinates.
        directions: shape (entries, f), the local coordinates.
        entries: numbers of the free entries.
        samples: N.
        steps: done.
        settled: a further step would change nothing.
    """

    model: Innovations
    covariance: Floats
    cost: float
    information: Floats
    directions: Floats
    entries: Entries
    samples: int
    steps: int
    settled: bool

    @property
    def freedom(self) -> int:
        """How many numbers were fitted, but for initial states and offset."""
        return int(self.directions.shape[1]) - len(self.model.A) - len(self.model.offset)

    @property
    def criterion(self) -> float:
        """The Bayesian criterion N log det + f log N, smallest is best."""
        return self.samples * self.cost + self.freedom * math.log(self.samples)


def refine(start: Innovations, record: Record, *, stable: bool = False, most: int = _MOST) -> Refined | None:
    """Return the model of the smallest log det of the prediction error's covariance, reached from a start.

    The maximum-likelihood estimate where the noise is normal (Ljung 1999, section 7.4), whatever the colour of the
    disturbance and whether or not the inputs react to it, as long as the structure has room for both.

    Args:
        start: with its structure.
        record: u (N, m) and y (N, p), of size one.
        stable: the plant's poles stay inside the unit circle.
        most: steps.

    Returns:
        The model; None where the start has no finite prediction, or cannot have the gains that are held.
    """
    model = start.held().balanced()
    if not model.holds:
        return None
    errors = errors_of(model, record)
    best = cost(errors)
    if not math.isfinite(best):
        return None
    damping, steps, settled = _FIRST, 0, False
    entries = model.free()
    while True:
        spread = errors.T @ errors / len(errors)
        weight = np.linalg.inv(np.linalg.cholesky(spread + 1e-14 * np.trace(spread) * np.eye(len(spread))))
        Q = model.coordinates(entries)
        H, g = normal_equations(model, record, weight, entries, Q)
        done = None
        if steps < most and not settled:
            done = _step((model, errors, best), (H, g, Q, entries), damping, record, stable=stable)
        if done is None:
            return Refined(model, spread, best, H, Q, entries, len(errors), steps, settled or steps < most)
        (model, errors, best), damping, expected = done
        settled = expected < _NEAR
        model = model.balanced()
        steps += 1


def _step(
    now: tuple[Innovations, Floats, float],
    equations: tuple[Floats, Floats, Floats, Entries],
    damping: float,
    record: Record,
    *,
    stable: bool,
) -> tuple[tuple[Innovations, Floats, float], float, float] | None:
    """Return a better model, the next damping and what the step was expected to gain [χ²]; None: there is none."""
    model, _, best = now
    H, g, Q, entries = equations
    scale = np.sqrt(np.maximum(np.diag(H), 1e-12 * max(float(np.max(np.diag(H))), 1e-300)))
    even, right = H / np.outer(scale, scale), g / scale
    for _ in range(_TRIES):
        factor = scipy.linalg.cho_factor(even + damping * np.eye(len(even)), check_finite=False)
        step = scipy.linalg.cho_solve(factor, right, check_finite=False)
        expected = float(step @ right)
        tried = model.moved(entries, Q @ (step / scale))
        if tried.holds and radius(tried.predictor) < STEADY and not (stable and _unstable(tried)):
            new = errors_of(tried, record)
            value = cost(new)
            if value < best:
                # Where the step was good the next may be longer; where it hardly was, it would only fail.
                good = (best - value) * len(new) > _GOOD * expected
                return (tried, new, value), max(damping / (10.0 if good else 1.0), _LEAST), expected
        if expected < _NEAR * _NEAR:
            return None
        damping = min(max(damping * _MORE, 1e-6), _MUCH)
    return None


def _unstable(model: Innovations) -> bool:
    return radius(model.A[: model.plant, : model.plant]) >= 1.0


_MOST_NEWTON = 100  # steps
_NEWTON_TRIES = 12  # dampings tried for a step
_MET = 1e-4  # χ² of the equations: from here on a step changes nothing


@dataclass(frozen=True, eq=False)
class _Equations:
    """The equations Σ ζᵀ W e = 0 at a model.

    Attributes:
        model: where they are.
        covariance: shape (p, p), of the errors e.
        directions: shape (entries, f), the local coordinates.
        cross: shape (f, f), Σ ζᵀ W ψ.
        own: shape (f, f), Σ ζᵀ W ζ, the covariance of the right side.
        right: shape (f,), Σ ζᵀ W e.
        samples: N.
    """

    model: Innovations
    covariance: Floats
    directions: Floats
    cross: Floats
    own: Floats
    right: Floats
    samples: int

    @property
    def whitened(self) -> tuple[Floats, Floats]:
        """The left and the right side, of which the latter has the covariance one."""
        root = np.linalg.cholesky(self.own)
        return np.linalg.solve(root, self.cross), np.linalg.solve(root, self.right)

    @property
    def distance(self) -> float:
        """How far from being met they are, as χ² of as many numbers as there are equations."""
        return float(np.sum(self.whitened[1] ** 2))


def instrumented(start: Innovations, record: Record, driven: Floats) -> Refined | None:
    """Return the model whose errors know nothing of the reference, by damped Newton steps from near it.

    Args:
        start: with a stable plant and a disturbance of its own.
        record: u (N, m) and y (N, p), of size one.
        driven: shape (N, m), that part of u which the reference makes.

    Returns:
        The model with the inverse of its covariance as information; None where the equations have no solution near, or
        the reference leaves a direction open.
    """
    entries, damping = start.free(), _FIRST
    try:
        now = _equations(start.held().balanced(), record, driven, entries)
        for steps in range(_MOST_NEWTON + 1):
            if now.distance < _MET:
                left = now.whitened[0]
                return Refined(
                    now.model, now.covariance, cost(errors_of(now.model, record)), left.T @ left, now.directions,
                    entries, now.samples, steps, settled=True,
                )  # fmt: skip
            nearer = _newton_step(now, record, driven, entries, damping)
            if nearer is None:
                return None
            now, damping = nearer
    except np.linalg.LinAlgError:
        return None
    return None


def _newton_step(
    now: _Equations, record: Record, driven: Floats, entries: Entries, damping: float
) -> tuple[_Equations, float] | None:
    """Return the equations where they are nearer to being met, and the next damping; None: no step leads there."""
    left, right = now.whitened
    size = np.maximum(np.linalg.norm(left, axis=0), 1e-300)
    turned, values, other = np.linalg.svd(left / size, full_matrices=False)
    for _ in range(_NEWTON_TRIES):
        step = other.T @ (values / (values**2 + damping) * (turned.T @ right)) / size
        tried = now.model.moved(entries, now.directions @ step)
        n = tried.plant
        if tried.holds and radius(tried.predictor) < STEADY and radius(tried.A[:n, :n]) < 1.0:
            result = _equations(tried.balanced(), record, driven, entries)
            if result.distance < now.distance:
                return result, max(0.1 * damping, _LEAST)
        damping *= 4.0
    return None


def _equations(model: Innovations, record: Record, driven: Floats, entries: Entries) -> _Equations:
    u, y = record
    n, Q = model.plant, model.coordinates(entries)
    plant = replace(
        model, A=model.A[:n, :n], B=model.B[:n], C=model.C[:, :n], K=np.zeros((n, len(model.C))),
        offset=np.zeros(len(model.C)), x0=np.zeros(n),
    )  # fmt: skip
    # Beside the instrument stands an output with the same errors, so that the disturbance's derivatives are the same.
    beside = driven, y - errors_of(plant, (driven - u, np.zeros_like(y)))
    errors = errors_of(model, record)
    if not np.isfinite(cost(errors)):
        raise np.linalg.LinAlgError("the model has no finite prediction")
    covariance = errors.T @ errors / len(errors)
    weight = np.linalg.inv(covariance)
    count = Q.shape[1]
    cross, own, right = np.zeros((count, count)), np.zeros((count, count)), np.zeros(count)
    both = zip(jacobian(model, record, entries, Q), jacobian(model, beside, entries, Q), strict=True)
    for (slopes, e), (known, _) in both:
        weighted = np.matmul(weight, known).reshape(-1, count)
        cross += weighted.T @ slopes.reshape(-1, count)
        own += weighted.T @ known.reshape(-1, count)
        right += weighted.T @ e.ravel()
    return _Equations(model, covariance, Q, cross, own, right, len(errors))

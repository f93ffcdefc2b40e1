"""A plant in a closed loop by an instrument: that part of its inputs which a recorded reference makes.

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

from dataclasses import dataclass, replace

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.identification.prediction.gradient import Record, errors_of, jacobian
from workbench.identification.prediction.innovations import Entries, Innovations
from workbench.identification.prediction.refine import Refined
from workbench.identification.subspace.final_model import cost
from workbench.identification.subspace.matrices import radius

__all__ = ["instrumented"]

_MOST = 100  # steps
_TRIES = 12  # dampings tried for a step
_FIRST, _LEAST = 1e-3, 1e-9  # of the damping
_NEAR = 1e-4  # χ² of the equations: from here on a step changes nothing
_STEADY = 0.99999  # largest pole of the predictor


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


def instrumented(start: Innovations, record: Record, driven: Floats, *, most: int = _MOST) -> Refined | None:
    """Return the model whose errors know nothing of the reference, by damped Newton steps from near it.

    Args:
        start: with a stable plant and a disturbance of its own.
        record: u (N, m) and y (N, p), of size one.
        driven: shape (N, m), that part of u which the reference makes.
        most: steps.

    Returns:
        The model with the inverse of its covariance as information; None where the equations have no solution near, or
        the reference leaves a direction open.
    """
    entries, damping = start.free(), _FIRST
    try:
        now = _equations(start.held().balanced(), record, driven, entries)
        for steps in range(most + 1):
            if now.distance < _NEAR:
                left = now.whitened[0]
                return Refined(
                    now.model, now.covariance, cost(errors_of(now.model, record)), left.T @ left, now.directions,
                    entries, now.samples, steps, settled=True,
                )  # fmt: skip
            nearer = _stepped(now, record, driven, entries, damping)
            if nearer is None:
                return None
            now, damping = nearer
    except np.linalg.LinAlgError:
        return None
    return None


def _stepped(
    now: _Equations, record: Record, driven: Floats, entries: Entries, damping: float
) -> tuple[_Equations, float] | None:
    """Return the equations where they are nearer to being met, and the next damping; None: no step leads there."""
    left, right = now.whitened
    size = np.maximum(np.linalg.norm(left, axis=0), 1e-300)
    turned, values, other = np.linalg.svd(left / size, full_matrices=False)
    for _ in range(_TRIES):
        step = other.T @ (values / (values**2 + damping) * (turned.T @ right)) / size
        tried = now.model.moved(entries, now.directions @ step)
        n = tried.plant
        if tried.holds and radius(tried.predictor) < _STEADY and radius(tried.A[:n, :n]) < 1.0:
            found = _equations(tried.balanced(), record, driven, entries)
            if found.distance < now.distance:
                return found, max(0.1 * damping, _LEAST)
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

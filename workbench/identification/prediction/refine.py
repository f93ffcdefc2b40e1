"""Gauss–Newton steps, damped after Levenberg and Marquardt, to the model of the smallest prediction error."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from workbench.core.values.arrays import Floats
from workbench.identification.prediction.gradient import Record, errors_of, normal_equations
from workbench.identification.prediction.innovations import Entries, Innovations
from workbench.identification.subspace.final_model import cost
from workbench.identification.subspace.matrices import radius

__all__ = ["Refined", "refine"]

_MOST = 60  # steps
_TRIES = 20  # dampings tried for a step
_FIRST, _LEAST, _MUCH = 1e-3, 1e-9, 1e9  # of the damping
_GOOD = 0.75  # of the gain expected
_MORE = 3.0  # times the damping where a step fails
_NEAR = 1e-3  # of a standard deviation (its square: in χ²): from here on a step changes nothing
_STEADY = 0.99999  # largest pole of the predictor


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
        normal = normal_equations(model, record, weight, entries, Q)
        H, g = normal.matrix, normal.right
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
        if tried.holds and radius(tried.predictor) < _STEADY and not (stable and _unstable(tried)):
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

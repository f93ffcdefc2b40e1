"""Poles that zeros nearly cancel: states that a model could do without."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from workbench.core.records.record import RecordPart
from workbench.core.values.arrays import Complex
from workbench.identification.identified.model import IdentifiedModel
from workbench.identification.validate.spread import model_spread

__all__ = ["NearCancellation", "in_words", "near_cancellations"]


NEAR = 0.25


@dataclass(frozen=True)
class NearCancellation(RecordPart):
    """A pole and the zero beside it.

    Attributes:
        pole, zero: of a complex pair the one in the upper half plane.
        distance: |pole − zero|.
        effect: distance over the pole's distance from the stability limit: by so much, at most, the pair changes the
            gain at any frequency (0.25: by a quarter).
        within_confidence: the zero lies in the pole's 95 % region; None where the model knows no covariance.
    """

    pole: complex
    zero: complex
    distance: float
    effect: float
    within_confidence: bool | None = None

    @property
    def words(self) -> str:
        """The finding in one line."""
        inside = "; the zero lies inside the pole's 95 % region" if self.within_confidence else ""
        return (
            f"pole {in_words(self.pole)} and zero {in_words(self.zero)} nearly cancel: "
            f"they change the gain by {100.0 * self.effect:.2g} % at most{inside}"
        )


def near_cancellations(model: IdentifiedModel, *, near: float = NEAR) -> tuple[NearCancellation, ...]:
    """Return the poles that a zero nearly cancels in every channel, the nearest first.

    A factor (q − z)/(q − p) differs from 1 by |p − z|/|q − p|, on the unit circle (the imaginary axis of a continuous
    model) by |p − z| over the pole's distance from it at most. With several inputs and outputs a pole counts if it
    nearly cancels from each input to each output; the zero named is that of the channel where it does least.

    Args:
        model: discrete or continuous; the poles of known delays are left out.
        near: pairs whose effect is larger are not listed.
    """
    core = model.undelayed()
    poles, dt = core.poles, core.dt
    if not len(poles):
        return ()
    margin = np.maximum(np.abs(np.abs(poles) - 1.0) if dt > 0.0 else np.abs(poles.real), 1e-12)
    nearest = [_nearest(poles, zeros) for zeros in _channels(core)]
    if not nearest:
        return ()
    distance = np.array([np.abs(z - poles) for z in nearest])
    worst = np.argmax(distance, axis=0)
    close = []
    for k in np.flatnonzero(poles.imag >= 0.0):
        zero, far = complex(nearest[worst[k]][k]), float(distance[worst[k], k])
        effect = far / float(margin[k])
        if effect <= near:
            close.append(NearCancellation(complex(poles[k]), zero, far, effect))
    if close and model.spread is not None:
        known = model_spread(model)
        close = [replace(c, within_confidence=known.holds(c.pole, c.zero)) for c in close]
    return tuple(sorted(close, key=lambda c: c.effect))


def _channels(model: IdentifiedModel) -> Sequence[Complex]:
    """Return the zeros from each input to each output; channels without any gain do not count."""
    B, C, D = model.B, model.C, model.D
    pairs = [(i, j) for i in range(len(C)) for j in range(B.shape[1])]
    alive = [(i, j) for i, j in pairs if D[i, j] != 0.0 or (np.any(B[:, j]) and np.any(C[i]))]
    return [model.part(j, i).invariant_zeros for i, j in alive]


def _nearest(poles: Complex, zeros: Complex) -> Complex:
    """Return for each pole the zero that is paired with it; infinity where there is none left."""
    from scipy.optimize import linear_sum_assignment  # noqa: PLC0415 - slow to import

    paired = np.full(len(poles), np.inf + 0j)
    if len(zeros):
        rows, columns = linear_sum_assignment(np.abs(poles[:, None] - zeros[None, :]))
        paired[rows] = zeros[columns]
    return paired


def in_words(z: complex) -> str:
    """Return a pole or zero, and its conjugate, in words."""
    return f"{z.real:.4g}" if abs(z.imag) < 1e-9 else f"{z.real:.4g} ± {abs(z.imag):.4g}i"

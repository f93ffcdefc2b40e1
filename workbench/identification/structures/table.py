"""A static block as a table: linear between its knots, and beyond them as between the last two."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from workbench.core.records.record import RecordPart, entry
from workbench.core.values.arrays import Floats

__all__ = ["StaticTable", "free_directions", "knots_for", "places", "weights"]

Places = tuple[NDArray[np.intp], Floats]


@dataclass(frozen=True, eq=False, kw_only=True)
class StaticTable(RecordPart):
    """A static block.

    Attributes:
        x: shape (k,), rising.
        y: shape (k,), its values there.
        spread: shape (k,), standard deviation of each value by noise.
    """

    x: Floats = field(metadata=entry(dims=("knot",)))
    y: Floats = field(metadata=entry(dims=("knot",)))
    spread: Floats = field(metadata=entry(dims=("knot",)))

    @property
    def bend(self) -> Floats:
        """What straight pieces leave of a block that bends, shape (k,).

        Of a parabola the best straight pieces miss at their knots by h²/12 times the second derivative, which the
        change of slope from piece to piece tells: (s₂ − s₁) h/12 with h the mean of both pieces. Where the block has a
        corner at a knot itself, this is more than there is.
        """
        if len(self.x) < 3:
            return np.zeros(len(self.x))
        h = np.diff(self.x)
        inner = np.abs(np.diff(np.diff(self.y) / h)) * 0.5 * (h[1:] + h[:-1]) / 12.0
        return np.concatenate([inner[:1], inner, inner[-1:]])

    @property
    def error(self) -> Floats:
        """95 % error of each value, by noise and by straight pieces, shape (k,)."""
        return np.asarray(1.96 * self.spread + self.bend)

    def derived(self) -> dict[str, Any]:
        """Return the errors."""
        return {"error": self.error}

    def __call__(self, at: Floats) -> Floats:
        """Return values, of any shape.

        Args:
            at: where.
        """
        k, t = places(at.ravel(), self.x)
        return np.asarray((1.0 - t) * self.y[k] + t * self.y[k + 1]).reshape(at.shape)


def places(at: Floats, knots: Floats) -> Places:
    """Return the interval of each value, and where in it: 0 at its beginning, 1 at its end, more or less beyond.

    Args:
        at: shape (N,).
        knots: shape (k,).
    """
    k = np.clip(np.searchsorted(knots, at, side="right") - 1, 0, len(knots) - 2)
    return k, (at - knots[k]) / (knots[k + 1] - knots[k])


def weights(at: Floats, knots: Floats) -> Floats:
    """Return what each knot's value contributes to the values at some places, shape (N, k).

    Args:
        at: shape (N,).
        knots: shape (k,).
    """
    k, t = places(at, knots)
    result = np.zeros((len(at), len(knots)))
    every = np.arange(len(at))
    result[every, k], result[every, k + 1] = 1.0 - t, t
    return result


def knots_for(signal: Floats, count: int) -> Floats:
    """Return knots over the range of a signal, halfway between even spacing and equal numbers of samples in each part.

    A signal with no more than `count` different values has these for knots.

    Args:
        signal: shape (N,).
        count: how many.
    """
    levels = np.unique(signal)
    size = levels[-1] - levels[0]
    apart = levels[np.append(True, np.diff(levels) > 1e-6 * size)]
    if len(apart) <= count:
        return np.asarray(apart)
    share = np.linspace(0.0, 1.0, count)
    even = levels[0] + size * share
    return np.asarray(0.5 * (even + np.quantile(signal, share)))


def free_directions(*fixed: Floats) -> Floats:
    """Return orthonormal directions of the values that leave some sums of them as they are, shape (k, k − fixed).

    Args:
        fixed: shape (k,) each, factors of a sum.
    """
    return np.asarray(scipy.linalg.null_space(np.array(fixed)))

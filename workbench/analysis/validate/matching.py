"""Which pole of one model is which of another."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from workbench.session.base import Floats

__all__ = ["match", "match_clouds"]

Complex = NDArray[np.complex128]

_FAR = 20.0  # robust deviations beyond which a pole is just elsewhere
_PASSES = 2


def match(reference: Complex, poles: Complex) -> Complex:
    """Return `poles` in the order of `reference`, the sum of all distances smallest.

    Args:
        reference: shape (n,).
        poles: shape (n,).
    """
    return _assigned(np.abs(poles[None, :] - reference[:, None]), poles)


def match_clouds(reference: Complex, replicates: Complex) -> Complex:
    """Return replicates of a set of poles in the order of `reference`, shape (R, n).

    First by distance; then again by distance in units of each cloud's own (robust) spread from its median, so that a
    pole that is found anywhere does not take a well known one's place.

    Args:
        reference: shape (n,).
        replicates: shape (R, n).
    """
    ordered = np.array([match(reference, row) for row in replicates])
    for _ in range(_PASSES):
        middle = np.median(ordered.real, axis=0) + 1j * np.median(ordered.imag, axis=0)
        spread = np.maximum(np.median(np.abs(ordered - middle), axis=0), 1e-9)
        ordered = np.array([_assigned(_cost(row, middle, spread), row) for row in ordered])
    return ordered


def _cost(poles: Complex, middle: Complex, spread: Floats) -> Floats:
    cost: Floats = np.minimum(np.abs(poles[None, :] - middle[:, None]) / spread[:, None], _FAR)
    return cost


def _assigned(cost: Floats, poles: Complex) -> Complex:
    chosen: Complex = poles[linear_sum_assignment(cost)[1]]
    return chosen

"""Two control inputs that share one filter: the weights by which they come nearest to the block's own effect."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.core.records.record import RecordPart
from workbench.core.values.arrays import Complex, Floats, as_reals
from workbench.errors import InputError

__all__ = ["WEIGHTINGS", "Weighting", "weighted"]

WEIGHTINGS = ("absolute", "relative")


@dataclass(frozen=True, kw_only=True)
class Weighting(RecordPart):
    """How two control inputs share the filter's output.

    Attributes:
        method: "absolute" or "relative", which error is least.
        weights: of the first and of the second input; their magnitudes add up to 1, the first is positive.
        left: what a constant gain in both inputs leaves of H, root mean square over that of H.
        left_alone: the same with the first input alone.
    """

    method: str
    weights: tuple[float, float]
    left: float
    left_alone: float


def weighted(first: Complex, second: Complex, h: Complex, *, method: str = "absolute") -> Weighting:
    """Return the weights x, y of two inputs for which c (x G₁ + y G₂) comes nearest to H, with any real c.

    The least sum of |c (x G₁ + y G₂) − H|² over the frequencies, or of its ratio to |H|², which counts the frequencies
    at which H is small as much as its peaks. The scale c is the filter's affair; |x| + |y| = 1. The answer depends on
    the error that is made least and on the grid, more than on the band.

    Args:
        first: shape (n,), response G₁ from the first input.
        second: shape (n,), G₂ from the second.
        h: shape (n,), H of the block's output.
        method: one of `WEIGHTINGS`.

    Raises:
        InputError: an unknown method; the responses do not tell the inputs apart; an input has no use.

    Source: the source report, chapter 8.6, C₁ x − C₂ (1 − x) − C₃.
    """
    if method not in WEIGHTINGS:
        raise InputError(f"weighting '{method}' is unknown; known: {', '.join(WEIGHTINGS)}")
    size = np.ones_like(np.abs(h)) if method == "absolute" else 1.0 / np.abs(h)
    columns = np.stack([as_reals(first * size), as_reals(second * size)], axis=1)
    wanted = as_reals(h * size)
    result, _, rank, _ = np.linalg.lstsq(columns / np.linalg.norm(columns, axis=0), wanted, rcond=1e-9)
    if rank < 2:
        raise InputError("the two control inputs act alike in the band: any weights do; leave the second out")
    gains = result / np.linalg.norm(columns, axis=0)
    if gains[0] == 0.0:
        raise InputError("the first control input has no use beside the second; exchange them")
    alone = columns[:, :1] @ np.linalg.lstsq(columns[:, :1], wanted, rcond=None)[0]
    shares = gains * np.sign(gains[0]) / np.sum(np.abs(gains))
    return Weighting(
        method=method,
        weights=(float(shares[0]), float(shares[1])),
        left=_relative(columns @ gains - wanted, wanted),
        left_alone=_relative(alone - wanted, wanted),
    )


def _relative(error: Floats, wanted: Floats) -> float:
    return float(np.linalg.norm(error) / np.linalg.norm(wanted))

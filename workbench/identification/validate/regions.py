"""Confidence regions of poles from a cloud of replicates."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from workbench.core.records.record import RecordPart, entry
from workbench.core.values.arrays import Complex, Floats

__all__ = ["PoleRegion", "pole_regions"]


SCATTER = 0.15  # a pole whose replicates scatter more (root mean square) over the unit disc is not determined
WIDER = 2.0  # how much wider the other regions become where one is not
REAL = 0.975  # part of the replicates that must be real for a region on the real axis
ON_AXIS = 1e-12  # imaginary parts below are none
TINY = 1e-12  # least variance: of poles that never move, as those of noise-free data


@dataclass(frozen=True, eq=False, kw_only=True)
class PoleRegion(RecordPart):
    """Where a pole may be.

    Attributes:
        pole: the estimate.
        spread: root mean square distance of the replicates from their mean; of a normal scatter with this region, where
            nothing was drawn.
        bias: mean of the replicates less the estimate; 0 where nothing was drawn.
        shape: (2, 2), the region is all z with dᵀ shape⁻¹ d ≤ 1, d = (real, imaginary part of z − pole).
        on_axis: the region is an interval of the real axis.
        determined: False: the pole may be almost anywhere; the region then is the unit disc besides.
    """

    pole: complex
    spread: float
    bias: complex
    shape: Floats = field(metadata=entry(dims=(2, 2)))
    on_axis: bool
    determined: bool

    def contains(self, z: complex) -> bool:
        """Return whether a number lies in the region.

        Args:
            z: on the plane of discrete poles.
        """
        return self.excess(z) <= 1.0

    def excess(self, z: complex) -> float:
        """Return how far out a number lies: 0 at the pole, 1 on the region's edge.

        Args:
            z: on the plane of discrete poles.
        """
        if not self.determined and abs(z) <= 1.0:
            return 0.0
        d = np.array([z.real - self.pole.real, z.imag - self.pole.imag])
        return float(np.sqrt(d @ np.linalg.solve(self.shape, d)))

    @property
    def half_axes(self) -> tuple[float, float]:
        """Lengths of the ellipse's half axes, the longer one first; without the disc of an undetermined pole."""
        sizes = np.sqrt(np.linalg.eigvalsh(self.shape))
        return float(sizes[1]), 0.0 if self.on_axis else float(sizes[0])

    def outline(self) -> Complex:
        """Return the edge of the ellipse as a closed curve, shape (181,)."""
        angle = np.linspace(0.0, 2.0 * np.pi, 181)
        edge = np.linalg.cholesky(self.shape) @ np.vstack([np.cos(angle), np.sin(angle)])
        return np.asarray(self.pole + edge[0] + 1j * edge[1], dtype=np.complex128)

    def derived(self) -> dict[str, Any]:
        """Return the size of the region."""
        return {"half_axes": self.half_axes}


def pole_regions(poles: Complex, replicates: Complex, *, confidence: float, joint: bool) -> tuple[PoleRegion, ...]:
    """Return an elliptic region around each pole.

    The ellipse has the shape of the replicates' scatter about the estimate (their second moment, so that their bias
    widens it) and a size that holds the wanted part of them; a pole and nearly all of its replicates on the real
    axis make an interval of it. Jointly, all ellipses hold a larger part of their replicates, each the same, so that
    the wanted part of the replicates has all its poles inside at once (balanced: Beran, J. Am. Stat. Assoc. 83, 1988).

    A pole that the data do not determine, as of an order too high, is found anywhere by the replicates. Around such a
    point the distribution of the estimates says nothing about where the true pole is, and the other estimates depend
    on where it was found by chance (Andrews & Cheng, Econometrica 80, 2012, whose example are common roots). It is
    therefore sorted out first: its region is the unit disc, and the others are widened.

    Args:
        poles: shape (n,), the estimates.
        replicates: shape (R, n), in their order.
        confidence: between 0 and 1.
        joint: all regions together hold their poles with this confidence, not each for itself.
    """
    away = _with_mirror_images(poles, replicates) - poles
    spread = np.sqrt(np.mean(np.abs(replicates - replicates.mean(axis=0)) ** 2, axis=0))
    known = spread <= SCATTER
    axis = (np.abs(poles.imag) < ON_AXIS) & (np.mean(np.abs(replicates.imag) < ON_AXIS, axis=0) >= REAL)
    moments = [_moment(column, bool(real)) for column, real in zip(away.T, axis, strict=True)]
    squares = np.array([_squares(column, M) for column, M in zip(away.T, moments, strict=True)])
    level = _level(squares[known], confidence) if joint else confidence
    size = _quantile(squares, level)
    if not known.all():
        size = size * WIDER**2
    return tuple(
        PoleRegion(
            pole=complex(poles[k]),
            spread=float(spread[k]),
            bias=complex(away[:, k].mean()),
            shape=moments[k] * size[k],
            on_axis=bool(axis[k]),
            determined=bool(known[k]),
        )
        for k in range(len(poles))
    )


def _with_mirror_images(poles: Complex, replicates: Complex) -> Complex:
    """Return the replicates and their mirror images at the real axis, shape (2 R, n).

    The poles of a real system are their own mirror image. Which of two poles is called the upper one is chance where
    replicates are real; so the regions of real poles lie level, and those of a pair mirror each other.
    """
    partner = [int(np.argmin(np.abs(poles - p.conjugate()))) for p in poles]
    return np.vstack([replicates, replicates[:, partner].conj()])


def _moment(away: Complex, real: bool) -> Floats:  # noqa: FBT001 - a helper of two arguments
    """Return the second moment of real and imaginary parts, shape (2, 2), never singular."""
    parts = np.vstack([away.real, np.zeros_like(away.real) if real else away.imag])
    moment: Floats = parts @ parts.T / away.size
    return moment + (1e-9 * float(np.trace(moment)) + TINY) * np.eye(2)


def _squares(away: Complex, moment: Floats) -> Floats:
    parts = np.vstack([away.real, away.imag])
    squares: Floats = np.einsum("ik,ik->k", parts, np.linalg.solve(moment, parts))
    return squares


def _level(squares: Floats, confidence: float) -> float:
    """Return the level at which regions of all rows together hold the wanted part of the columns."""
    if len(squares) < 2:
        return confidence
    ranks = 1.0 + np.argsort(np.argsort(squares, axis=1), axis=1).max(axis=0).astype(np.float64)
    together: float = float(_quantile(ranks[None, :], confidence)[0]) / squares.shape[1]
    return max(confidence, together)


def _quantile(squares: Floats, confidence: float) -> Floats:
    """Return the quantile of each row that a further number stays below with the wanted probability."""
    count = squares.shape[1]
    rank = min(int(np.ceil(confidence * (count + 1))), count)
    found: Floats = np.sort(squares, axis=1)[:, rank - 1]
    return found

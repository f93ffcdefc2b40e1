"""Stretches in which a signal stands still at its highest or lowest value."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.core.values.arrays import Floats

__all__ = ["ClippingLevel", "flat_extremes"]

_STILL = 1e-6  # of the range
_LONG = 3  # samples in a row
_SHARE = 0.002  # of the record
_FEW = 6  # samples in all


@dataclass(frozen=True)
class ClippingLevel:
    """A level at which a signal rests, its highest or its lowest.

    Attributes:
        value: the level, [unit of the signal].
        upper: it is the highest value.
        runs: first sample and the one after the last of each stretch.
        share: of all samples, 0 … 1.
    """

    value: float
    upper: bool
    runs: tuple[tuple[int, int], ...]
    share: float

    @property
    def stretches(self) -> int:
        """How many."""
        return len(self.runs)

    @property
    def samples(self) -> tuple[int, ...]:
        """All samples at rest."""
        return tuple(k for first, last in self.runs for k in range(first, last))


def flat_extremes(x: Floats, *, still: float = _STILL) -> list[ClippingLevel]:
    """Return the highest and the lowest level if the signal rests there.

    Noise behind a limit hides it from this test: `still` must then be larger than the noise. A signal with few levels,
    as a PRBS, rests there by its nature, and so does a response that has settled; `advise` tells these from limits as
    far as data can.

    Args:
        x: shape (n,).
        still: how much it may move while it rests, of its range.
    """
    span = float(np.ptp(x))
    if span == 0.0:
        return []
    found = [_at(x, float(level), still * span, upper) for level, upper in ((x.max(), True), (x.min(), False))]
    return [f for f in found if len(f.samples) >= _FEW and f.share >= _SHARE]


def _at(x: Floats, level: float, tolerance: float, upper: bool) -> ClippingLevel:  # noqa: FBT001  one of two sides
    there = np.abs(x - level) <= tolerance
    edges = np.flatnonzero(np.diff(np.concatenate([[False], there, [False]])))
    runs = tuple((int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a >= _LONG)
    return ClippingLevel(level, upper, runs, sum(b - a for a, b in runs) / len(x))

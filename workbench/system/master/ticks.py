"""The instants of a sampled component."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

__all__ = ["Ticks", "repeating"]

_SAME = 1e-9  # relative: instants closer than this are one
_REPEATS = 1e-6  # relative to the period: how far instants may lie off a pattern
_LONGEST_PATTERN = 64


@dataclass(frozen=True)
class Ticks:
    """Instants that repeat: first[i] + k · period.

    Attributes:
        first: those of the first period [s], rising.
        period: [s].
    """

    first: tuple[float, ...]
    period: float

    def after(self, time: float) -> float:
        """Return the first instant after `time` [s]."""
        clear = time + _SAME * max(abs(time), self.period)
        return min(self._after(t, clear) for t in self.first)

    def _after(self, first: float, clear: float) -> float:
        k = max(0, math.floor((clear - first) / self.period))
        while first + k * self.period <= clear:
            k += 1
        return first + k * self.period

    @property
    def longest(self) -> float:
        """The longest time between two instants [s]."""
        times = [*self.first, self.first[0] + self.period]
        return max(b - a for a, b in pairwise(times))


def repeating(times: Sequence[float]) -> Ticks | None:
    """Return the shortest pattern that repeats in these instants [s], seen twice at least; None if there is none."""
    gaps = [b - a for a, b in pairwise(times)]
    for length in range(1, min(_LONGEST_PATTERN, len(gaps) // 2) + 1):
        period = times[length] - times[0]
        if all(abs(gaps[i + length] - gaps[i]) <= _REPEATS * period for i in range(len(gaps) - length)):
            return Ticks(tuple(times[:length]), period)
    return None

"""The instants of a sampled component, out of those that it shows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from itertools import pairwise

from workbench.core.values.calendar import Calendar, Sampler, exact, simplest_between

__all__ = ["repeating"]

_REPEATS = 1e-6  # relative to the period: how far instants may lie off a pattern
_LONGEST_PATTERN = 64


def repeating(times: Sequence[float]) -> Calendar | None:
    """Return the shortest pattern that repeats in these instants [s], seen twice at least; None if there is none."""
    gaps = [b - a for a, b in pairwise(times)]
    for length in range(1, min(_LONGEST_PATTERN, len(gaps) // 2) + 1):
        period = times[length] - times[0]
        if all(abs(gaps[i + length] - gaps[i]) <= _REPEATS * period for i in range(len(gaps) - length)):
            return _meant(times, length)
    return None


def _meant(times: Sequence[float], length: int) -> Calendar:
    """Return the pattern in the simplest numbers within rounding: whoever adds up is off by half an ulp a tick."""
    error = Fraction(0.5 * len(times) * math.ulp(max(map(abs, times))))
    spans = [(Fraction(times[k]) - Fraction(times[k % length]), k // length) for k in range(length, len(times))]
    low = max((span - 2 * error) / n for span, n in spans)
    high = min((span + 2 * error) / n for span, n in spans)
    # Instants that keep their rate less exactly: what the whole stretch says.
    period = simplest_between(low, high) if low <= high else exact(float(spans[-1][0] / spans[-1][1]))
    firsts = [simplest_between(Fraction(t) - error, Fraction(t) + error) for t in times[:length]]
    return Calendar(tuple(Sampler(period, first) for first in firsts))

"""Count how often a fit finds the order of a response that comes without errors.

Responses of orders 1 to 4 with poles of 0.1 to 10 Hz and damping ratios from 0.01, at 12, 20, 40 or 80 frequencies from
0.02 to 50 Hz, without noise, with noise in proportion to the gain, and with noise of one level. Beside what the fit
finds without errors: with the errors given. "Told" are those that say that their order rests on no error, or that
another explains the values about as well. The bounded form is in tests/test_fit.py.
"""

from __future__ import annotations

from collections import Counter

import numpy as np

import workbench as wb
from tests.random_systems import random_response, scattered

NOISES = ((0.0, False), (0.002, False), (0.01, False), (0.05, False), (0.002, True), (0.01, True))
CIRCLE = np.sqrt(-np.log(0.05))  # radius of the 95 % circle over σ


def verdict(found: wb.FitResult, order: int) -> str:
    """Return what a fit found."""
    told = any("rests on no error" in note or "about as well" in note for note in found.notes)
    words = "right" if found.order == order else "above" if found.order > order else "below"
    return f"{words}, told" if told else words


def run(*, cases: int = 20, seed: int = 0) -> int:
    """Print how often the order is right; return 0.

    Args:
        cases: responses of each kind.
        seed: of the first.
    """
    for size, level in NOISES:
        for points in (12, 20, 40, 80):
            without, given = Counter[str](), Counter[str]()
            frequency = np.geomspace(0.02, 50.0, points)
            for number in range(seed, seed + cases):
                random = np.random.default_rng(number)
                order = 1 + number % 4
                true = random_response(random, order, frequency)
                value = scattered(random, true, size, level=level)
                without[verdict(wb.fit(wb.Response(frequency, value)), order)] += 1
                error = CIRCLE * size * (np.abs(true).max() if level else np.abs(true)) / np.abs(value)
                given[verdict(wb.fit(wb.Response(frequency, value, error)), order)] += 1
            kind = "of one level" if level else "in proportion"
            print(f"noise {size:g} {kind}, {points} points: {dict(without)}; with errors {dict(given)}", flush=True)
    return 0

#!/usr/bin/env python3
"""Count how often a fit finds the order of a response that comes without errors.

    python scripts/coverage_fit.py                      480 random responses
    python scripts/coverage_fit.py --responses 4        of each kind

Responses of orders 1 to 4 with poles of 0.1 to 10 Hz and damping ratios from 0.01, at 12, 20, 40 or 80 frequencies from
0.02 to 50 Hz, without noise, with noise in proportion to the gain, and with noise of one level. Beside what the fit
finds without errors: with the errors given. "Told" are those that say that their order rests on no error, or that
another explains the values about as well. Nothing here is a test; the bounded form is in tests/test_fit.py.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

import numpy as np  # noqa: E402

import workbench as wb  # noqa: E402
from tests.random_systems import random_response, scattered  # noqa: E402

NOISES = ((0.0, False), (0.002, False), (0.01, False), (0.05, False), (0.002, True), (0.01, True))
CIRCLE = np.sqrt(-np.log(0.05))  # radius of the 95 % circle over σ


def verdict(found: wb.FitResult, order: int) -> str:
    """Return what a fit found."""
    told = any("rests on no error" in note or "about as well" in note for note in found.notes)
    words = "right" if found.order == order else "above" if found.order > order else "below"
    return f"{words}, told" if told else words


def main() -> None:
    """Run it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--responses", type=int, default=20)
    asked = parser.parse_args()
    for size, level in NOISES:
        for points in (12, 20, 40, 80):
            without, given = Counter[str](), Counter[str]()
            frequency = np.geomspace(0.02, 50.0, points)
            for seed in range(asked.responses):
                random = np.random.default_rng(seed)
                order = 1 + seed % 4
                true = random_response(random, order, frequency)
                value = scattered(random, true, size, level=level)
                without[verdict(wb.fit(wb.Response(frequency, value)), order)] += 1
                error = CIRCLE * size * (np.abs(true).max() if level else np.abs(true)) / np.abs(value)
                given[verdict(wb.fit(wb.Response(frequency, value, error)), order)] += 1
            kind = "of one level" if level else "in proportion"
            print(f"noise {size:g} {kind}, {points} points: {dict(without)}; with errors {dict(given)}", flush=True)


if __name__ == "__main__":
    main()

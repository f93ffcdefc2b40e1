"""The basic time period of a sampled model: after it, all its samples are taken in the same order again."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from workbench.session.base import Floats

__all__ = ["basic_period", "distinct", "listen"]

TOLERANCE = 1e-6  # of the shortest distance of samples
MAX_EVENTS = 20_000


def basic_period(times: Sequence[float] | Floats, *, tolerance: float = TOLERANCE) -> float | None:
    """Return the shortest T after which a series of sample times repeats itself; None: it does not, as far as it goes.

    At least two whole periods must be there. Samples that are closer than `tolerance` count as one, so that rates
    which meet up to rounding have a common period.

    Args:
        times: shape (n,) [s], rising.
        tolerance: relative to the shortest distance of two samples.

    Source: the basic time period of the source report, chapter 3.1.3; found from the samples in place of the rates.
    """
    t = distinct(times)
    if len(t) < 3:
        return None
    slack = tolerance * float(np.diff(t).min())
    for shift in range(1, (len(t) - 1) // 2 + 1):
        period = t[shift : len(t)] - t[: len(t) - shift]
        if abs(period[0] - period[-1]) <= slack and float(np.ptp(period)) <= slack:
            return float(period.mean())
    return None


def distinct(times: Sequence[float] | Floats) -> Floats:
    """Return times without those that differ from the one before by rounding only."""
    t = np.asarray(times, dtype=np.float64)
    if len(t) < 2:
        return t
    gaps = np.diff(t)
    keep = gaps > 1e-9 * float(np.median(gaps[gaps > 0.0])) if (gaps > 0.0).any() else gaps > 0.0
    kept: Floats = t[np.concatenate([[True], keep])]
    return kept


def listen(next_event: Callable[[], float | None], *, most: int = MAX_EVENTS) -> float | None:
    """Collect sample times until their basic period shows; return it, None if none shows.

    Args:
        next_event: goes on to the next time event and returns its time [s]; None: there is none.
        most: events to wait for.
    """
    times: list[float] = []
    look = 8
    while len(times) < most:
        time = next_event()
        if time is None:
            return None
        times.append(time)
        if len(times) == look:
            found = basic_period(times)
            if found is not None:
                return found
            look *= 2
    return None

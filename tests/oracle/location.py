"""Locate the first change of an event indicator's domain inside a step."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from workbench.core.values.arrays import Floats

__all__ = ["changed", "locate"]

RELATIVE = 1e-13
MAX_ITERATIONS = 200


def changed(before: Floats, after: Floats) -> bool:
    """Whether an indicator moved between the domains > 0 and ≤ 0 (FMI 2.0, section 3.1.1)."""
    return bool(((before > 0.0) != (after > 0.0)).any())


def locate(indicators: Callable[[float], Floats], t0: float, t1: float, z0: Floats, z1: Floats) -> float:
    """Return a time just after the first domain change in (t0, t1].

    Regula falsi with the Illinois modification on the indicator that changes, with a bisection
    every third round; the bracket, not the residual, decides when to end.

    Args:
        indicators: time [s] → indicators there, shape (nz,).
        t0: begin of the bracket [s].
        t1: its end [s].
        z0: indicators at t0.
        z1: indicators at t1; at least one has changed its domain.
    """
    low, high, z_low, z_high = t0, t1, z0.copy(), z1.copy()
    for rounds in range(MAX_ITERATIONS):
        width = max(RELATIVE * max(abs(low), abs(high), high - low), 4.0 * np.spacing(high))
        if high - low <= width:
            break
        t = _guess(low, high, z_low, z_high, bisect=rounds % 3 == 2)
        t = min(max(t, low + 0.4 * width), high - 0.4 * width)
        z = indicators(t).copy()
        if changed(z0, z):
            high, z_high = t, z
            z_low = 0.5 * z_low  # Illinois: pull the next guess to the end that stands still
        else:
            low, z_low = t, z
            z_high = 0.5 * z_high
    return high


def _guess(low: float, high: float, z_low: Floats, z_high: Floats, *, bisect: bool) -> float:
    middle = 0.5 * (low + high)
    if bisect:
        return middle
    which = np.flatnonzero((z_low > 0.0) != (z_high > 0.0))
    drop = z_low[which] - z_high[which]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        guesses = low + (high - low) * z_low[which] / drop
    first = float(np.min(guesses)) if which.size else middle
    return first if low < first < high else middle

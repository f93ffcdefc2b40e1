"""Peak and root mean square of a record in a window of time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.core.records.record import RecordPart
from workbench.core.values.arrays import Floats
from workbench.response.simulate.zero_crossings import highest

__all__ = ["Measure", "measure"]


@dataclass(frozen=True, kw_only=True)
class Measure(RecordPart):
    """What a signal does in a window.

    Attributes:
        peak: largest size, between the rows by a parabola through three of them.
        peak_time: when [s].
        rms: root mean square about zero.
        mean: mean value.
        half_range: half the distance between largest and smallest value: the amplitude of an oscillation.
    """

    peak: float
    peak_time: float
    rms: float
    mean: float
    half_range: float


def measure(time: Floats, value: Floats, window: tuple[float, float]) -> Measure | None:
    """Return the measures of a record between two times; None: it has no two rows there.

    Args:
        time: shape (n,), not falling; a time given twice is a jump [s].
        value: shape (n,).
        window: begin and end [s].
    """
    inside = np.flatnonzero((time >= window[0]) & (time <= window[1]))
    if len(inside) < 2 or not time[inside[-1]] > time[inside[0]]:
        return None
    t, x = time[inside], value[inside]
    largest, smallest = highest(t, x), highest(t, -x)
    peak = max(largest, smallest)
    return Measure(
        peak=peak[0],
        peak_time=peak[1],
        rms=float(np.sqrt(_mean(t, x * x))),
        mean=_mean(t, x),
        half_range=0.5 * (largest[0] + smallest[0]),
    )


def _mean(t: Floats, x: Floats) -> float:
    """Return the mean over time, rows at any distance (trapezoidal rule)."""
    return float(np.sum(0.5 * (x[1:] + x[:-1]) * np.diff(t)) / (t[-1] - t[0]))

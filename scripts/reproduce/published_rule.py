"""Frequency response by the source report's settling rule and nothing else: what its figures show.

`workbench.nfr` departs from it (see there): it removes the transient that this rule sometimes takes for settled.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import trapezoid

from workbench.core.values.arrays import Complex
from workbench.model import Model
from workbench.session import Session
from workbench.signals.kinds import Signal, Sine

__all__ = ["largest_jump", "published_response"]

SAMPLES = 30  # of a period
PERIODS = 20  # at most; the last ten are averaged then


def published_response(
    model: Model, input: str, output: str, frequencies: Sequence[float] | NDArray[np.float64], *, errcrit: float
) -> Complex:
    """Return output over input, shape (n,), each point from a fresh start, one period after the other.

    A point is settled where the phase of two successive periods differs by errcrit [rad] at most and the gain by a
    tenth of it. Not for measuring: a slow transient looks settled to it.

    Args:
        model: it stays open.
        input: what is forced, by a sine of amplitude 1.
        output: what is measured.
        frequencies: [Hz].
        errcrit: the error criterion [rad].

    Raises:
        InputError, FmuError, SimulationError: as from the model's session.

    Source: the source report, chapter 4 and appendix 11.2.
    """
    found = []
    for frequency in frequencies:
        with model.open_session() as session:
            found.append(_settled(_periods(session, input, output, float(frequency)), errcrit))
    return np.array(found, dtype=np.complex128)


def _periods(session: Session, input: str, output: str, frequency: float) -> Iterator[complex]:
    """Yield P + jQ, times twice the frequency, of one period after the other."""
    signals: dict[str, Signal] = {input: Sine(amplitude=1.0, frequency=frequency)}
    period = 1.0 / frequency
    for number in range(PERIODS):
        points = period * (number + np.arange(1.0, SAMPLES + 1.0) / SAMPLES)
        record = session.advance(float(points[-1]), signals=signals, record=[output], points=points)
        turning = np.exp(1j * (0.5 * np.pi - 2.0 * np.pi * frequency * record.time))
        # sin + j cos = exp(j(π/2 − ωt)): P and Q in one integral
        yield complex(2.0 * frequency * trapezoid(record.values[output] * turning, record.time))


def _settled(periods: Iterator[complex], errcrit: float) -> complex:
    seen = [next(periods)]
    for value in periods:
        turned = abs(math.remainder(cmath.phase(value) - cmath.phase(seen[-1]), math.tau))
        grown = abs(abs(value) - abs(seen[-1]))
        seen.append(value)
        if turned <= errcrit and grown <= errcrit / 10.0:
            return value
    return complex(np.mean(seen[PERIODS // 2 :]))


def largest_jump(frequencies: NDArray[np.float64], error_deg: NDArray[np.float64]) -> tuple[float, float]:
    """Return between which frequencies the error of the phase changes most (their mean) [Hz], and by how much [deg].

    Args:
        frequencies: rising, shape (n,) [Hz].
        error_deg: shape (n,).
    """
    steps = np.diff(error_deg)
    at = int(np.argmax(np.abs(steps)))
    return float(np.sqrt(frequencies[at] * frequencies[at + 1])), float(steps[at])

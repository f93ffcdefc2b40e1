"""Fourier coefficients of one period, from the rows that a session recorded."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from workbench.session import Record
from workbench.session.base import Floats

__all__ = ["COMPARED", "NOTHING", "ORDERS", "Period", "distortion", "fundamental", "measure_period"]

# Harmonics measured of each period: how far the output is from a sine.
ORDERS = 10

# Harmonics by which periods are compared. One would do for the response itself; with the others not all numbers
# agree by accident. Higher ones are small, and noisy where the output has jumps.
COMPARED = 5

# What is below this part of the terms that it is the sum of is rounding, not a response.
NOTHING = 1e-12


@dataclass(frozen=True, eq=False)
class Period:
    """One period of a forced model.

    Attributes:
        harmonics: shape (1 + 2·orders,): mean, then in-phase and quadrature part of each harmonic
            of the output, [unit of the output]: y ≈ h0 + Σ h(2n−1)·sin(nωt) + h(2n)·cos(nωt).
        drive: fundamental of the input that the model really saw, as a complex amplitude
            (in-phase + j·quadrature), [unit of the input].
        size: largest magnitude of the output, [unit of the output].
    """

    harmonics: Floats
    drive: complex
    size: float

    @property
    def compared(self) -> Floats:
        """The harmonics by which periods are compared: the first five."""
        return self.harmonics[: 1 + 2 * COMPARED]

    def responds(self, floor: float) -> bool:
        """Whether the output has a fundamental above `floor`, below which it is rounding [unit of the output]."""
        return abs(fundamental(self.harmonics)) > floor


def fundamental(harmonics: Floats) -> complex:
    """Return the first harmonic as in-phase + j·quadrature, [unit of the signal]."""
    return complex(harmonics[1], harmonics[2])


def distortion(harmonics: Floats) -> tuple[float | None, ...]:
    """Return the amplitudes of the harmonics 2 … 10 relative to the fundamental.

    Args:
        harmonics: laid out as in `Period`; orders that it does not hold are None, and so are all
            where there is no fundamental.
    """
    amplitudes = np.hypot(harmonics[1::2], harmonics[2::2]).tolist()
    rest: list[float | None] = [a / amplitudes[0] for a in amplitudes[1:ORDERS]] if amplitudes[0] > 0.0 else []
    return (*rest, *[None] * (ORDERS - 1 - len(rest)))


def measure_period(
    record: Record, *, input: str, output: str, begin: float, frequency: float, orders: int = ORDERS
) -> Period:
    """Return the Fourier coefficients of one period.

    The integrals P = ∫ y sin(ωt) dt and Q = ∫ y cos(ωt) dt of the source report (chapter 4.2) are
    taken by the trapezoidal rule over the record's rows. Events are two rows with one time, so
    jumps are integrated exactly; between them the rule converges faster than any power of the
    sampling interval for a smooth periodic response, and with its square otherwise
    (8e-5 of the amplitude at 200 rows). The mean is removed first, so that a large constant part
    (a pressure of 1e7 Pa) leaves no rounding in the coefficients.

    Args:
        record: rows over exactly one period.
        input: name of the forced input in `record.inputs`.
        output: name of the output in `record.values`.
        begin: session time at which the sine's phase is zero [s].
        frequency: of the forcing sine [Hz].
        orders: number of harmonics.
    """
    weights = _trapezoid_weights(record.time)
    angle = 2.0 * math.pi * frequency * (record.time - begin)
    y = record.values[output]
    return Period(
        harmonics=_coefficients(y, angle, weights, orders),
        drive=fundamental(_coefficients(record.inputs[input], angle, weights, 1)),
        size=float(np.max(np.abs(y))),
    )


def _trapezoid_weights(time: Floats) -> Floats:
    """Weights w with w @ y = mean of y over the rows' span."""
    steps = np.diff(time)
    weights = np.zeros_like(time)
    weights[:-1] += 0.5 * steps
    weights[1:] += 0.5 * steps
    mean: Floats = weights / (time[-1] - time[0])
    return mean


def _coefficients(y: Floats, angle: Floats, weights: Floats, orders: int) -> Floats:
    mean = float(weights @ y)
    swing = 2.0 * weights * (y - mean)
    angles = np.outer(np.arange(1, orders + 1), angle)
    coefficients = np.empty(1 + 2 * orders)
    coefficients[0] = mean
    coefficients[1::2] = np.sin(angles) @ swing
    coefficients[2::2] = np.cos(angles) @ swing
    return coefficients

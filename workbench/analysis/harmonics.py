"""Fourier coefficients of one period, from the rows that a session recorded."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from workbench.session import Recorded
from workbench.session.base import Floats

__all__ = ["COMPARED", "NOTHING", "ORDERS", "Period", "distortion", "fundamental", "measure_period"]

Indices = NDArray[np.intp]

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
    record: Recorded,
    *,
    input: str,
    output: str,
    begin: float,
    frequency: float,
    orders: int = ORDERS,
    points: Floats | None = None,
) -> Period:
    """Return the Fourier coefficients of one period.

    The integrals P = ∫ y sin(ωt) dt and Q = ∫ y cos(ωt) dt of the source report (chapter 4.2) are
    taken by the trapezoidal rule over an even grid, which converges faster than any power of its step h for a
    smooth periodic response: rows at events between the points would cost that, h³·y″ each. Where the output
    jumps by J at τ, two rows with one time, the Euler-Maclaurin formula has the sum too small by
    J·(h·(½ − θ)·b + ½h²·B₂(θ)·b′), with b the sine or cosine at τ, θ the part of the interval before τ and
    B₂(θ) = (θ − ½)² − 1/12. What is left is ½h²·B₂(θ)·K·b for a step of the slope by K, at most h²·K/12, and
    0.008·h³·J·b″. The mean is removed first, so that a large constant part (a pressure of 1e7 Pa) leaves no
    rounding in the coefficients.

    Args:
        record: rows over exactly one period.
        input: name of the forced input in `record.inputs`.
        output: name of the output in `record.values`.
        begin: session time at which the sine's phase is zero [s].
        frequency: of the forcing sine [Hz].
        orders: number of harmonics.
        points: evenly spaced times of rows, from one step behind the first row to the last; None: the trapezoidal
            rule over all rows, as for the communication points of a co-simulation, which all are steps of the input.

    Source: J. Stoer, R. Bulirsch, Introduction to Numerical Analysis, 3.3 (Euler-Maclaurin).
    """
    rule = _Rule.of(record.time, 2.0 * math.pi * frequency, points)
    angle = 2.0 * math.pi * frequency * (record.time - begin)
    y = record.values[output]
    return Period(
        harmonics=rule.coefficients(y, angle, orders),
        drive=fundamental(rule.coefficients(record.inputs[input], angle, 1)),
        size=float(np.max(np.abs(y))),
    )


@dataclass(frozen=True, eq=False)
class _Rule:
    """Integration over the rows of one period.

    Attributes:
        weights: of the rows, shape (n,); they sum up to 1.
        before, after: rows on both sides of jumps, shape (m,).
        value, slope: what a jump of 1 adds, relative to the span, times the basis where it is and times its
            derivative by the phase, shape (m,).
    """

    weights: Floats
    before: Indices
    after: Indices
    value: Floats
    slope: Floats

    @classmethod
    def of(cls, time: Floats, omega: float, points: Floats | None) -> Self:
        """Return the rule for rows at `time`, see `measure_period`."""
        if points is None:
            none: Indices = np.empty(0, dtype=np.intp)
            return cls(_trapezoid_weights(time), none, none, np.empty(0), np.empty(0))
        nodes = np.isin(time, points) | (time == time[0])
        weights = np.zeros_like(time)
        weights[nodes] = _trapezoid_weights(time[nodes])
        span = time[-1] - time[0]
        h = span / len(points)
        double = np.flatnonzero(np.diff(time) == 0.0)
        before, after = np.append(double, len(time) - 1), np.append(double + 1, 0)
        # From a jump to the middle of its interval; at a node both halves are in the sum.
        last = time[nodes][np.searchsorted(time[nodes], time[before], side="right") - 1]
        ahead = np.where(nodes[before], 0.0, last + 0.5 * h - time[before])
        slope = np.where(nodes[before], h * h / 12.0, 0.5 * (ahead**2 - h * h / 12.0))
        return cls(weights, before, after, ahead / span, slope * omega / span)

    def coefficients(self, y: Floats, angle: Floats, orders: int) -> Floats:
        """Return mean, then in-phase and quadrature part of each harmonic, shape (1 + 2·orders,)."""
        jump = y[self.after] - y[self.before]
        mean = float(self.weights @ y + self.value @ jump)
        swing = 2.0 * self.weights * (y - mean)
        k = np.arange(1, orders + 1)
        angles = np.outer(k, angle)
        sines, cosines = np.sin(angles), np.cos(angles)
        value, slope = 2.0 * self.value * jump, 2.0 * self.slope * jump
        coefficients = np.empty(1 + 2 * orders)
        coefficients[0] = mean
        coefficients[1::2] = sines @ swing + sines[:, self.before] @ value + k * (cosines[:, self.before] @ slope)
        coefficients[2::2] = cosines @ swing + cosines[:, self.before] @ value - k * (sines[:, self.before] @ slope)
        return coefficients


def _trapezoid_weights(time: Floats) -> Floats:
    """Weights w with w @ y = mean of y over the rows' span."""
    steps = np.diff(time)
    weights = np.zeros_like(time)
    weights[:-1] += 0.5 * steps
    weights[1:] += 0.5 * steps
    mean: Floats = weights / (time[-1] - time[0])
    return mean

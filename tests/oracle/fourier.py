"""The Fourier coefficients of one period by NumPy, which the kernel's sums are compared with."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from workbench.core.values.arrays import Floats
from workbench.response.periodic.fourier import Period, fundamental
from workbench.session.base import Recorded

__all__ = ["period_by_numpy"]

Indices = NDArray[np.intp]


def period_by_numpy(
    record: Recorded, *, u: str, y: str, begin: float, frequency: float, orders: int, points: Floats | None = None
) -> Period:
    """Return what `workbench.response.periodic.fourier.measure_period` does."""
    rule = _Rule.of(record.time, 2.0 * math.pi * frequency, points)
    angle = 2.0 * math.pi * frequency * (record.time - begin)
    out = record.values[y]
    return Period(
        harmonics=rule.coefficients(out, angle, orders),
        drive=fundamental(rule.coefficients(record.inputs[u], angle, 1)),
        size=float(np.max(np.abs(out))),
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

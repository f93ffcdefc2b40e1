"""Fourier coefficients of one period, from the rows that a session recorded."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.kernel.library import kernel
from workbench.kernel.native_record import NativeFourier
from workbench.session import Recorded

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
        rough: what edges between two rows may put into a coefficient of the output [its unit].
        steps: that the integration took; 0: not known.
    """

    harmonics: Floats
    drive: complex
    size: float
    rough: float = 0.0
    steps: int = 0

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
    sums = NativeFourier(kernel(), [1, 2], begin=begin, frequency=frequency, orders=orders)
    known = None if points is None else (np.ascontiguousarray(points, dtype=np.float64), None)
    sums.aim(begin=begin, frequency=frequency, known=known, grid=points is not None)
    drive, harmonics = sums.of_rows(np.column_stack([record.time, record.inputs[input], record.values[output]]))
    return Period(
        harmonics=harmonics, drive=fundamental(drive), size=float(sums.largest[1]), rough=float(sums.rough[1])
    )

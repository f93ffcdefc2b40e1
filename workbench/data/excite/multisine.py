"""Multisines: chosen frequencies, all with the same power, at a low peak."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from workbench.core.values.arrays import Floats
from workbench.data.excite.design import FilterDesign, Sequences, SignalPart, check_amplitude, check_seed, each
from workbench.errors import InputError, suggest

__all__ = ["MultisineDesign", "low_crest"]

ITERATIONS = 300
_FIRST_CLIP, _LAST_CLIP = 0.75, 0.97  # of the peak
_SPREAD = 1.0  # [rad] by which the phases begin off Schroeder's, so that every seed gives another signal
_SPACING = {"all": 1, "odd": 2}


@dataclass(frozen=True, kw_only=True)
class MultisineDesign(FilterDesign):
    """A periodic sum of sines of equal power within a band, its phases chosen for a low crest factor.

    The response is recorded once it is periodic too: one period is run before. Several inputs share
    out the frequencies in turn and are uncorrelated over whole periods. The validation part is another
    set of phases.

    Not for dynamics that are slower than one period, nor for narrow resonances between two lines: make
    periods fewer or the record longer.

    Attributes:
        amplitude: the largest deviation from the middle; one, or one for each input.
        band: lowest and highest frequency [Hz], below half the sampling rate.
        periods: how often the signal is repeated in the identification part.
        lines: "all" multiples of the fundamental, or the "odd" ones: what then appears at even ones is
            the model's nonlinearity.
        seed: which set of phases.
        offset: middle of the signal; None: the operating point's input.

    Source: R. Pintelon and J. Schoukens, System Identification: A Frequency Domain Approach, 2nd ed., chapter 5.
    """

    amplitude: float | tuple[float, ...] = 1.0
    band: tuple[float, float]
    periods: int = 4
    lines: Literal["all", "odd"] = "all"
    seed: int = 1
    offset: float | tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        check_amplitude("multisine", self.amplitude, self.offset)
        check_seed("multisine", self.seed)
        low, high = self.band
        if not (math.isfinite(high) and 0.0 < low <= high):
            raise InputError(f"multisine: the band must rise from above 0 Hz, not be {low:g}:{high:g}")
        if self.periods < 1:
            raise InputError(f"multisine: periods must be 1 or more, not {self.periods}")
        if self.lines not in _SPACING:
            raise InputError(f"multisine: lines '{self.lines}'; {suggest(self.lines, _SPACING)}")

    def sequences(self, inputs: int, *, dt: float, samples: int, validation: int) -> Sequences:
        length = self._length(samples)
        lines = self._lines(length, dt, inputs)
        amplitude = each("multisine: amplitude", self.amplitude, inputs)
        parts = [
            SignalPart(amplitude * self._played(length, lines, length + count, self.seed + i), skip=length)
            for i, count in enumerate((samples, validation))
            if count
        ]
        fundamental = 1.0 / (length * dt)
        return Sequences(
            identification=parts[0],
            validation=parts[1] if validation else None,
            kind="multisine",
            period=length * dt,
            clock=None,
            order=None,
            band=(float(min(k[0] for k in lines)) * fundamental, float(max(k[-1] for k in lines)) * fundamental),
            lines=min(len(k) for k in lines),
        )

    def _length(self, samples: int) -> int:
        """Return the samples of one period."""
        if samples % self.periods:
            near = self.periods * round(samples / self.periods)
            raise InputError(
                f"multisine: {samples} samples are not {self.periods} whole periods; take {near} samples, "
                "or other periods"
            )
        return samples // self.periods

    def _lines(self, length: int, dt: float, inputs: int) -> list[NDArray[np.intp]]:
        """Return the multiples of the fundamental that each input gets."""
        low, high = self.band
        if high >= 0.5 / dt:
            raise InputError(f"multisine: the band ends at {high:g} Hz, but half the sampling rate is {0.5 / dt:g} Hz")
        spacing = _SPACING[self.lines]
        # Sums of products of line number and interval round; a border that is meant to be a line is one.
        first, last = math.ceil(low * length * dt - 1e-6), math.floor(high * length * dt + 1e-6)
        every = np.arange(1, last + 1, spacing, dtype=np.intp)
        every = every[every >= max(first, 1)]
        if len(every) < inputs:
            raise InputError(
                f"multisine: the band {low:g}:{high:g} Hz holds {len(every)} lines {spacing / (length * dt):.4g} Hz "
                f"apart, too few for {inputs} inputs; widen the band, or use fewer periods or more samples"
            )
        return [every[i::inputs] for i in range(inputs)]

    @staticmethod
    def _played(length: int, lines: list[NDArray[np.intp]], count: int, seed: int) -> Floats:
        """Return `count` samples of the unit signals, shape (count, m)."""
        rng = np.random.default_rng(seed)
        one = np.column_stack([low_crest(length, k, start=rng.uniform(-_SPREAD, _SPREAD, len(k))) for k in lines])
        played: Floats = one[np.arange(count) % length]
        return played


def low_crest(length: int, lines: NDArray[np.intp], *, start: Floats) -> Floats:
    """Return one period of a multisine with equal powers and a low peak, scaled to the peak 1.

    From Schroeder's phases, the signal's peaks are cut off and the phases of what is left are taken, again
    and again, cutting less each time; the best signal on the way is returned.

    Args:
        length: samples of a period.
        lines: which multiples of the fundamental, shape (k,), below length / 2.
        start: by how much the phases begin off Schroeder's, shape (k,) [rad].

    Returns:
        Shape (length,).

    Source: Pintelon and Schoukens, section 5.2; M. R. Schroeder, IEEE Trans. Inf. Theory 16 (1970);
    E. van der Ouderaa, J. Schoukens and J. Renneboog, IEEE Trans. Instrum. Meas. 37 (1988).
    """
    order = np.arange(len(lines))
    phase = start - np.pi * order * (order + 1) / len(lines)
    best, lowest = np.zeros(length), math.inf
    for share in np.linspace(_FIRST_CLIP, _LAST_CLIP, ITERATIONS):
        spectrum = np.zeros(length // 2 + 1, dtype=np.complex128)
        spectrum[lines] = np.exp(1j * phase)
        signal = np.fft.irfft(spectrum, length)
        peak = float(np.max(np.abs(signal)))
        if peak < lowest:  # the power is the same for all phases
            best, lowest = signal / peak, peak
        phase = np.angle(np.fft.rfft(np.clip(signal, -share * peak, share * peak))[lines])
    return best

"""Pseudo-random binary sequences: two levels, as flat a spectrum as there is."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from workbench.core.values.arrays import Floats
from workbench.data.excite.design import FilterDesign, Sequences, SignalPart, check_amplitude, check_seed, each
from workbench.errors import InputError
from workbench.signals.shift_register import TAPS, jump, register_bits

__all__ = ["PrbsDesign"]

_Indices = NDArray[np.intp]

LEAST_ORDER = 5  # that is chosen unasked
_ON_TIME = 1e-9  # of a bit: rounding of a sample time that falls on its border
_HALF_POWER = 0.5


@dataclass(frozen=True, kw_only=True)
class PrbsDesign(FilterDesign):
    """offset ± amplitude by the bits of a maximum-length shift register.

    A new bit comes with the first sample after each 1/rate; the rate need not divide the sampling rate.
    A lower rate puts the power at low frequencies: −3 dB near 0.44·rate. Several inputs get
    parts of one sequence that lie far apart in its period.

    Not for models whose response to positive and negative deflection differs, if that is to be seen:
    two levels cannot show it; take a multisine.

    Attributes:
        amplitude: half the distance of the two levels; one, or one for each input.
        rate: bits per second [Hz]; None: one bit a sample.
        order: length of the register, 2 … 40; the sequence repeats after 2^order − 1 bits. None: the
            shortest one that does not repeat.
        seed: which part of the sequence.
        offset: middle of the two levels; None: the operating point's input.

    Source: L. Ljung, System Identification, 2nd ed., section 13.3.
    """

    amplitude: float | tuple[float, ...] = 1.0
    rate: float | None = None
    order: int | None = None
    seed: int = 1
    offset: float | tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        check_amplitude("prbs", self.amplitude, self.offset)
        check_seed("prbs", self.seed)
        if self.rate is not None and not (math.isfinite(self.rate) and self.rate > 0.0):
            raise InputError(f"prbs: rate must be positive, not {self.rate:g} Hz")
        if self.order is not None and self.order not in TAPS:
            raise InputError(f"prbs: order must be {min(TAPS)} … {max(TAPS)}, not {self.order}")

    def sequences(self, inputs: int, *, dt: float, samples: int, validation: int) -> Sequences:
        rate = 1.0 / dt if self.rate is None else min(self.rate, 1.0 / dt)
        index = _bit_of_sample(samples + validation, dt * rate)
        count = int(index[-1]) + 1
        order = self._order(inputs, count)
        length = (1 << order) - 1
        bits = [register_bits(order, count, state=state) for state in self._states(order, inputs, count)]
        values = (2.0 * np.column_stack(bits)[index] - 1.0) * each("prbs: amplitude", self.amplitude, inputs)
        return Sequences(
            identification=SignalPart(values[:samples]),
            validation=SignalPart(values[samples:]) if validation else None,
            kind="prbs",
            period=length / rate,
            clock=rate,
            order=order,
            band=(max(rate / length, 1.0 / (samples * dt)), _upper_edge(rate, dt)),
            notes=tuple(self._notes(dt, rate, samples + validation, inputs, length, count)),
        )

    def _order(self, inputs: int, bits: int) -> int:
        if self.order is not None:
            return self.order
        fitting = [n for n in TAPS if n >= LEAST_ORDER and (1 << n) - 1 >= inputs * bits]
        if not fitting:
            raise InputError(f"prbs: {bits} bits for {inputs} inputs are too many; take fewer samples or a lower rate")
        return fitting[0]

    def _states(self, order: int, inputs: int, bits: int) -> list[int]:
        """Return where each input's register starts.

        By chance, where the period leaves room: a few ones begin with long runs, and parts that lie a power of two
        apart are sums of few others, which correlates them.
        """
        length = (1 << order) - 1
        rng = np.random.default_rng(self.seed)
        first = 1 + int(rng.integers(length))
        share = length // inputs
        room = max(0, share - bits) // 2
        shifts = [i * share - (int(rng.integers(room + 1)) if i else 0) for i in range(inputs)]
        return [jump(order, first, shift) for shift in shifts]

    def _notes(self, dt: float, rate: float, samples: int, inputs: int, length: int, bits: int) -> list[str]:  # noqa: PLR0917
        notes = []
        if self.rate is not None and self.rate > (1.0 + _ON_TIME) / dt:
            notes.append(f"prbs: the rate {self.rate:g} Hz is above the sampling rate; one bit per sample is used")
        if bits > length:
            notes.append(
                f"prbs: the sequence repeats after {length / rate:.4g} s, within the record of {samples * dt:.4g} s; "
                "the validation part then repeats known input: raise order"
            )
        elif inputs > 1 and bits > length // inputs:
            notes.append(
                f"prbs: the inputs are one sequence, shifted by {length // inputs / rate:.4g} s, which is less than "
                "the record; raise order"
            )
        return notes


def _bit_of_sample(count: int, bits_per_sample: float) -> _Indices:
    """Return which bit each sample plays."""
    index: _Indices = np.floor(np.arange(count) * bits_per_sample + _ON_TIME).astype(np.intp)
    return index


def _upper_edge(rate: float, dt: float) -> float:
    """Return where the spectrum of the sampled sequence has fallen by 3 dB [Hz].

    Two samples τ apart lie in one bit with probability 1 − τ·dt·rate, which is the autocorrelation; its
    Fourier sum is the spectrum.
    """
    share = dt * rate
    lags = np.arange(1, math.ceil(1.0 / share) + 1)
    weights = np.maximum(0.0, 1.0 - lags * share)
    frequency = np.linspace(0.0, 0.5 / dt, 2001)
    spectrum = _spectrum(frequency * dt, lags, weights)
    level = spectrum / spectrum[0] - _HALF_POWER
    below = np.flatnonzero(level < 0.0)
    if not below.size:
        return 0.5 / dt
    last = int(below[0])
    return float(np.interp(0.0, [level[last], level[last - 1]], [frequency[last], frequency[last - 1]]))


def _spectrum(cycles: Floats, lags: _Indices, weights: Floats) -> Floats:
    total = np.ones_like(cycles)
    for lag, weight in zip(lags.tolist(), weights.tolist(), strict=True):
        total += 2.0 * weight * np.cos(2.0 * np.pi * cycles * lag)
    return total

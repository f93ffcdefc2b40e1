"""Pseudo-random binary sequences and multisines, and how they are written."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from workbench.core.values.arrays import Floats
from workbench.data.excite.design import FilterDesign, Sequences, SignalPart, check_amplitude, check_seed, each
from workbench.errors import InputError, suggest
from workbench.signals.shift_register import TAPS, jump, register_bits

__all__ = ["MultisineDesign", "PrbsDesign", "low_crest", "parse_design"]

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


_KEYS: Mapping[str, tuple[str, ...]] = {
    "prbs": ("amplitude", "rate", "order", "seed", "offset"),
    "multisine": ("amplitude", "band", "periods", "lines", "seed", "offset"),
}


def parse_design(kind: str, text: str) -> FilterDesign:
    """Return the design that a text like "amplitude=2,rate=50,order=11" describes.

    Args:
        kind: "prbs" or "multisine".
        text: KEY=VALUE pairs with commas between; several numbers as in band=0.1:20, or amplitude=2:0.5 for two inputs.

    Raises:
        InputError: unknown kind or key, a key twice, not a number, out of range.
    """
    if kind not in _MAKERS:
        raise InputError(f"signal '{kind}' is unknown; {suggest(kind, _MAKERS)}")
    return _MAKERS[kind](_pairs(kind, text))


def _prbs(k: Mapping[str, str]) -> FilterDesign:
    return PrbsDesign(
        amplitude=_one_or_each("prbs", "amplitude", k.get("amplitude", "1")),
        rate=_number("prbs", "rate", k["rate"]) if "rate" in k else None,
        order=_whole("prbs", "order", k["order"]) if "order" in k else None,
        seed=_whole("prbs", "seed", k.get("seed", "1")),
        offset=_one_or_each("prbs", "offset", k["offset"]) if "offset" in k else None,
    )


def _multisine(k: Mapping[str, str]) -> FilterDesign:
    if "band" not in k:
        raise InputError("multisine: band is missing; write band=LOW:HIGH in Hz")
    band = _numbers("multisine", "band", k["band"])
    if len(band) != 2:
        raise InputError(f"multisine: band must be LOW:HIGH in Hz, as in band=0.1:20, not '{k['band']}'")
    return MultisineDesign(
        amplitude=_one_or_each("multisine", "amplitude", k.get("amplitude", "1")),
        band=(band[0], band[1]),
        periods=_whole("multisine", "periods", k.get("periods", "4")),
        lines=_lines(k.get("lines", "all")),
        seed=_whole("multisine", "seed", k.get("seed", "1")),
        offset=_one_or_each("multisine", "offset", k["offset"]) if "offset" in k else None,
    )


_MAKERS: Mapping[str, Callable[[Mapping[str, str]], FilterDesign]] = {"prbs": _prbs, "multisine": _multisine}


def _pairs(kind: str, text: str) -> dict[str, str]:
    result: dict[str, str] = {}
    for part in filter(None, (p.strip() for p in text.split(","))):
        key, equals, value = (p.strip() for p in part.partition("="))
        if key not in _KEYS[kind]:
            raise InputError(f"{kind}: unknown option '{key}'; {suggest(key, _KEYS[kind])}")
        if not (equals and value):
            raise InputError(f"{kind}: {key} needs a value, as in {key}=1")
        if key in result:
            raise InputError(f"{kind}: {key} is given twice; several inputs' values go as in {key}=1:2")
        result[key] = value
    return result


def _number(kind: str, key: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{kind}: {key} needs a number, as in {key}=1.0, not '{text}'") from None


def _numbers(kind: str, key: str, text: str) -> tuple[float, ...]:
    return tuple(_number(kind, key, item) for item in text.split(":"))


def _one_or_each(kind: str, key: str, text: str) -> float | tuple[float, ...]:
    result = _numbers(kind, key, text)
    return result[0] if len(result) == 1 else result


def _whole(kind: str, key: str, text: str) -> int:
    try:
        return int(text)
    except ValueError:
        raise InputError(f"{kind}: {key} must be a whole number, not '{text}'") from None


def _lines(text: str) -> Literal["all", "odd"]:
    if text == "all":
        return "all"
    if text == "odd":
        return "odd"
    raise InputError(f"multisine: lines '{text}'; known: all, odd")

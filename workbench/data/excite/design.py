"""What every design of an identification signal has, and how good a sequence is."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.errors import InputError

__all__ = [
    "FilterDesign",
    "Sequences",
    "SignalPart",
    "check_amplitude",
    "check_seed",
    "crest_factors",
    "cross_correlation",
    "each",
]

LAGS = 0.25  # of the record: so far apart two inputs are compared


@dataclass(frozen=True, eq=False)
class SignalPart:
    """One recorded stretch of the sequences.

    Attributes:
        values: deviations from the middle, shape (skip + n, m).
        skip: so many samples are run before the record begins, until the response is periodic.
    """

    values: Floats
    skip: int = 0

    @property
    def kept(self) -> Floats:
        """The recorded deviations, shape (n, m)."""
        return self.values[self.skip :]


@dataclass(frozen=True, kw_only=True, eq=False)
class Sequences:
    """What is played, and what is known about it.

    Attributes:
        identification, validation: the two parts; None: no validation.
        kind: "prbs" or "multisine".
        period: after which the sequence repeats [s].
        clock: how often the value may change [Hz]; None: at every sample, smoothly.
        order: of the shift register; None: no PRBS.
        band: frequencies between which the spectrum holds −3 dB [Hz].
        lines: number of excited frequencies of each input; None: all of them.
        notes: doubts, e.g. that the sequence repeats within the record.
    """

    identification: SignalPart
    validation: SignalPart | None
    kind: str
    period: float
    clock: float | None
    order: int | None
    band: tuple[float, float]
    lines: int | None = None
    notes: tuple[str, ...] = ()


class FilterDesign(ABC):
    """What kind of signal forces the inputs.

    Obligations of a subclass:
      1. It is a frozen value: the same design gives the same sequences on every machine.
      2. `sequences` returns deviations from `offset`, sampled at dt and held over it.
      3. The sequences of several inputs are nearly uncorrelated; where they are not, a note says so.
    """

    repr_is_code: ClassVar[bool] = True  # as that of signals
    offset: float | tuple[float, ...] | None

    @abstractmethod
    def sequences(self, inputs: int, *, dt: float, samples: int, validation: int) -> Sequences:
        """Return what is played.

        Args:
            inputs: how many.
            dt: sampling interval [s].
            samples: length of the identification part.
            validation: length of the validation part; 0: none.

        Raises:
            InputError: the design does not fit the sampling or the length.
        """


def each(what: str, value: float | tuple[float, ...], count: int) -> Floats:
    """Return one number for each input, shape (count,).

    Raises:
        InputError: several numbers, but not as many as inputs.
    """
    if isinstance(value, int | float):
        return np.full(count, float(value))
    if len(value) != count:
        inputs = f"{count} input{'s' if count > 1 else ''}"
        raise InputError(f"{what}: {len(value)} values, but {inputs}; give one, or one each")
    return np.array(value, dtype=np.float64)


def check_amplitude(kind: str, amplitude: float | tuple[float, ...], offset: float | tuple[float, ...] | None) -> None:
    """Refuse amplitudes and offsets that are none.

    Raises:
        InputError: not positive, or not finite.
    """
    for value in _all(amplitude):
        if not (math.isfinite(value) and value > 0.0):
            raise InputError(f"{kind}: amplitude must be positive, not {value:g}")
    for value in _all(offset):
        if not math.isfinite(value):
            raise InputError(f"{kind}: offset must be a finite number, not {value}")


def check_seed(kind: str, seed: int) -> None:
    """Refuse a seed below 0.

    Raises:
        InputError: it is.
    """
    if seed < 0:
        raise InputError(f"{kind}: seed must be 0 or more, not {seed}")


def _all(value: float | tuple[float, ...] | None) -> Sequence[float]:
    if value is None:
        return ()
    return (value,) if isinstance(value, int | float) else value


def crest_factors(values: Floats) -> tuple[float, ...]:
    """Return peak over root mean square of each column about its mean; 1 is the least there is."""
    moving = values - values.mean(axis=0)
    rms = np.sqrt(np.mean(moving**2, axis=0))
    return tuple((np.max(np.abs(moving), axis=0) / np.where(rms > 0.0, rms, 1.0)).tolist())


def cross_correlation(values: Floats) -> tuple[float, int] | None:
    """Return the largest correlation coefficient of two columns and the lag where it is [samples].

    Lags up to a quarter of the record, which is taken as periodic. None for a single column.
    """
    moving = values - values.mean(axis=0)
    n, m = moving.shape
    if m < 2:
        return None
    spectra = np.fft.rfft(moving, axis=0)
    sizes = np.sqrt(np.sum(moving**2, axis=0))
    lags = np.arange(-int(LAGS * n), int(LAGS * n) + 1)
    worst, where = 0.0, 0
    for i in range(m):
        for j in range(i + 1, m):
            result = np.fft.irfft(spectra[:, i].conj() * spectra[:, j], n)[lags]
            at = int(np.argmax(np.abs(result)))
            value = float(abs(result[at])) / max(float(sizes[i] * sizes[j]), 1e-300)
            if value > worst:
                worst, where = value, int(lags[at])
    return worst, where

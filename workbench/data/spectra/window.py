"""How a record is cut into windowed segments, and the spectra of these."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import special

from workbench.core.records.record import RecordPart
from workbench.core.values.arrays import Complex, Floats
from workbench.errors import InputError, suggest

__all__ = ["WindowSettings", "choose_window", "cross_spectra", "shape_of"]

WINDOWS = ("hann", "hamming", "blackman", "bartlett", "flattop", "boxcar")

_COSINES = {
    "boxcar": (1.0,),
    "hann": (0.5, -0.5),
    "hamming": (0.54, -0.46),
    "blackman": (0.42, -0.5, 0.08),
    "blackmanharris": (0.35875, -0.48829, 0.14128, -0.01168),
    "flattop": (0.21557895, -0.41663158, 0.277263158, -0.083578947, 0.006947368),
}
_DEFAULT_SEGMENTS = 20
_SHORTEST = 8


@dataclass(frozen=True)
class WindowSettings(RecordPart):
    """The segments of an averaged spectrum (Welch's method) and the error they leave.

    Attributes:
        window: name of the window.
        segments: so many segments fit side by side.
        length: of a segment [samples].
        overlap: share of a segment that the next one repeats, 0 … below 1.
        averages: segments averaged, overlapping ones counted.
        effective_averages: independent averages that have the same variance, by Welch's formula.
        dt: sampling interval [s].
        used: samples used; the rest at the end does not fill a segment.

    Source: P. D. Welch, IEEE Trans. Audio Electroacoustics 15 (1967) 70–73; J. S. Bendat and A. G. Piersol,
    Random Data, 4th ed., sections 8.5 and 11.5.
    """

    window: str
    segments: int
    length: int
    overlap: float
    averages: int
    effective_averages: float
    dt: float
    used: int

    @property
    def step(self) -> int:
        """Distance of the segments' beginnings [samples]."""
        return self.length - self.overlapping

    @property
    def overlapping(self) -> int:
        """Samples that two neighbours share."""
        return _overlapping(self.length, self.overlap)

    @property
    def nyquist_hz(self) -> float:
        """Half the sampling rate [Hz]; no spectrum goes beyond."""
        return 0.5 / self.dt

    @property
    def resolution_hz(self) -> float:
        """Equivalent noise bandwidth of the window [Hz]: finer detail is smeared, which is the bias."""
        w = shape_of(self.window, self.length)
        return float(np.sum(w**2) / np.sum(w) ** 2 / self.dt)

    @property
    def random_error(self) -> float:
        """Standard deviation of a density relative to its value, 1/√averages."""
        return 1.0 / math.sqrt(self.effective_averages)

    @property
    def interval_95(self) -> tuple[float, float]:
        """Factors on an estimated density between which the true one lies in 95 % of cases (χ²)."""
        freedom = 2.0 * self.effective_averages
        low, high = special.chdtri(freedom, [0.025, 0.975])
        return float(freedom / low), float(freedom / high)

    def derived(self) -> dict[str, Any]:
        """Return resolution and error."""
        return {n: getattr(self, n) for n in ("nyquist_hz", "resolution_hz", "random_error", "interval_95")}

    def describe(self) -> str:
        """Return one line for a picture."""
        return (
            f"{self.window} window, {self.averages} segments of {self.length} samples, "
            f"{100.0 * self.overlap:.0f} % overlap, resolution {self.resolution_hz:.3g} Hz"
        )


def choose_window(
    n_samples: int, dt: float, *, segments: int | None, length: int | None, overlap: float, window: str
) -> WindowSettings:
    """Return settings for a record.

    Args:
        n_samples: of the record.
        dt: sampling interval [s].
        segments: the record is cut into so many, side by side; None: 20, or by `length`.
        length: of a segment [samples]; instead of `segments`.
        overlap: share that neighbours have in common, 0 … below 1; adds segments in between.
        window: one of `WINDOWS`.

    Raises:
        InputError: unknown window, both segments and length, overlap out of range, segments too short.
    """
    if window not in WINDOWS:
        raise InputError(f"window '{window}' is unknown; {suggest(window, WINDOWS)}")
    if segments is not None and length is not None:
        raise InputError("give either segments or length, not both: one follows from the other")
    if not 0.0 <= overlap <= 0.95:
        raise InputError(f"overlap must be 0 … 0.95 of a segment, not {overlap:g}")
    length = _length(n_samples, segments, length)
    step = length - _overlapping(length, overlap)
    averages = (n_samples - length) // step + 1
    return WindowSettings(
        window=window,
        segments=n_samples // length,
        length=length,
        overlap=overlap,
        averages=averages,
        effective_averages=_effective(shape_of(window, length), step, averages),
        dt=dt,
        used=length + (averages - 1) * step,
    )


def _length(n_samples: int, segments: int | None, length: int | None) -> int:
    if segments is not None and segments < 1:
        raise InputError(f"segments must be at least 1, not {segments}")
    if length is None:
        wanted = n_samples // (segments or _DEFAULT_SEGMENTS)
        length = wanted if segments else max(wanted, min(4 * _SHORTEST, n_samples // 4))
    if not _SHORTEST <= length <= n_samples:
        raise InputError(
            f"segments of {length} samples out of {n_samples}: each needs at least {_SHORTEST} and at most all; "
            "use fewer segments or a longer record"
        )
    return length


def _overlapping(length: int, overlap: float) -> int:
    return min(round(overlap * length), length - 1)


def shape_of(window: str, length: int) -> Floats:
    """Return a window, shape (length,), periodic, as spectra need it.

    Args:
        window: one of `WINDOWS`, or "blackmanharris".
        length: [samples].

    Source: F. J. Harris, Proc. IEEE 66 (1978) 51-83.
    """
    turn = np.arange(length) / length
    if window == "bartlett":
        return np.asarray(1.0 - np.abs(2.0 * turn - 1.0))
    terms = [c * np.cos(2.0 * np.pi * k * turn) for k, c in enumerate(_COSINES[window])]
    return np.asarray(sum(terms))


def _effective(w: Floats, step: int, averages: int) -> float:
    """Return averages/(1 + 2 Σ (1 − j/averages) ρ(j)), ρ(j) the squared correlation of windows j steps apart."""
    total, energy = 1.0, float(np.sum(w**2))
    for j in range(1, min(averages, math.ceil(len(w) / step))):
        shared = float(np.sum(w[j * step :] * w[: len(w) - j * step])) / energy
        total += 2.0 * (1.0 - j / averages) * shared**2
    return averages / total


def cross_spectra(channels: Floats, settings: WindowSettings) -> tuple[Floats, Complex]:
    """Return frequencies [Hz], shape (n_f,), and one-sided densities S, shape (n_f, c, c).

    S[k, i, j] is the mean of conj(X_i)·X_j over the segments, scaled so that the integral of S[:, i, i]
    over 0 … Nyquist is the variance of channel i. Each segment's mean is taken out first.

    Args:
        channels: shape (n, c).
        settings: segments and window.
    """
    segments = np.lib.stride_tricks.sliding_window_view(channels, settings.length, axis=0)[:: settings.step]
    w = shape_of(settings.window, settings.length)
    X = np.fft.rfft((segments - segments.mean(axis=-1, keepdims=True)) * w)
    density = np.einsum("sik,sjk->kij", X.conj(), X) * settings.dt / (len(X) * np.sum(w**2))
    density[1 : (settings.length + 1) // 2] *= 2.0  # both sides; mean and Nyquist frequency stand once
    frequency = np.arange(len(density)) / (settings.length * settings.dt)
    return frequency, np.asarray(density, dtype=np.complex128)

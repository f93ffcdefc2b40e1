"""Coherence between inputs and outputs: how much of an output a linear model can explain at each frequency."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy import special

from workbench.core.records.record import entry
from workbench.core.values.arrays import Complex, Floats
from workbench.data.experiment.experiment import Experiment
from workbench.data.spectra.window import WindowSettings, choose_window, cross_spectra
from workbench.errors import InputError
from workbench.requests.decorator import with_origin
from workbench.show.result import Result

__all__ = ["Coherence", "coherence"]

# Below this part of its peak an input's density is rounding or leakage, no excitation.
_NO_POWER = 1e-12
# Inputs whose normalised spectral matrix is closer to singular than this cannot be told apart.
_DEPENDENT = 1e-9
_NORMAL_95 = float(special.ndtri(0.975))  # of a normal variable, in standard deviations


@dataclass(frozen=True, eq=False)
class Coherence(Result):
    """Squared coherence, 0 … 1, from 0 to the Nyquist frequency; NaN where no input has power.

    Noise, nonlinear distortion, further inputs and a memory longer than a segment all make it smaller.

    Attributes:
        name: name of the experiment.
        frequency_hz: shape (n_f,) [Hz].
        ordinary: between each output and each input alone, shape (n_f, p, m).
        multiple: between each output and all inputs together, shape (n_f, p); with one input the ordinary one.
        response: frequency response from inputs to outputs, Φ_yu Φ_uu⁻¹, shape (n_f, p, m), complex,
            [unit of the output / unit of the input].
        input_density: shape (n_f, m), [unit²/Hz], for judging where there is excitation.
        input_names, output_names: names of the columns.
        settings: window, segments, resolution and random error.

    Source: J. S. Bendat and A. G. Piersol, Random Data, 4th ed., sections 7.3 (multiple), 9.2 (errors).
    """

    _page = "workbench.data.spectra.page:coherence_page"
    _picture = "workbench.data.spectra.picture:plot_coherence"

    name: str
    frequency_hz: Floats = field(metadata=entry(dims=("frequency_hz",), unit="Hz"))
    ordinary: Floats = field(metadata=entry(dims=("frequency_hz", "output_names", "input_names"), named=True))
    multiple: Floats = field(metadata=entry(dims=("frequency_hz", "output_names"), named=True))
    response: Complex = field(metadata=entry(dims=("frequency_hz", "output_names", "input_names")))
    input_density: Floats = field(metadata=entry(dims=("frequency_hz", "input_names")))
    input_names: tuple[str, ...]
    output_names: tuple[str, ...]
    settings: WindowSettings

    @property
    def significance_95(self) -> float:
        """Multiple coherence that unrelated data exceed in 5 % of cases, at one frequency."""
        inputs, averages = len(self.input_names), self.settings.effective_averages
        return float(special.betaincinv(inputs, max(averages - inputs, 1e-3), 0.95))

    @property
    def bias(self) -> Floats:
        """How much too high the multiple coherence is on average, about (1 − γ²)²·m/averages; shape (n_f, p)."""
        return np.asarray((1.0 - self.multiple) ** 2 * len(self.input_names) / self.settings.effective_averages)

    @property
    def standard_deviation(self) -> Floats:
        """Of the multiple coherence, √2·γ·(1 − γ²)/√averages, to first order; shape (n_f, p).

        ±1.96 of it holds the true one in 85 … 95 % of cases with one input, in fewer with more: see `interval_95`.
        """
        return np.asarray(np.sqrt(2.0 * self.multiple) * (1.0 - self.multiple) * self.settings.random_error)

    @property
    def interval_95(self) -> tuple[Floats, Floats]:
        """Bounds between which the true multiple coherence lies in 95 % of cases, each of shape (n_f, p).

        With n averages and m inputs, Fisher's z = artanh γ is nearly normal whatever the coherence, 1/(2(n − m)) too
        large on average, with the variance 1/(2(n − m)). What m inputs explain by chance is taken out of γ² first, as
        1 − (1 − γ²)(n − 1)/(n − m), which adds (m − 1)/max(2nγ², 1) of the variance. The lower bound is 0
        where unrelated data reach the estimate in 2.5 % of cases. Counted, 94 … 98 % for 1 … 4 inputs and 10 … 150
        averages. NaN where no input has power.

        Source: J. S. Bendat and A. G. Piersol, Random Data, 4th ed., section 9.2.3; G. C. Carter, Proc. IEEE 75 (1987)
        236–255.
        """
        m, n = len(self.input_names), self.settings.effective_averages
        freedom = 2.0 * (n - m)
        own = np.maximum(1.0 - (1.0 - self.multiple) * (n - 1.0) / (n - m), 0.0)
        deviation = np.sqrt((1.0 + (m - 1) / np.maximum(2.0 * n * own, 1.0)) / freedom)
        with np.errstate(divide="ignore"):  # a coherence of 1 stays 1
            z = np.arctanh(np.sqrt(own)) - 1.0 / freedom
        low, high = (np.tanh(np.maximum(z + k * deviation, 0.0)) ** 2 for k in (-_NORMAL_95, _NORMAL_95))
        by_chance = self.multiple <= special.betaincinv(m, n - m, 0.975)
        return np.where(by_chance, 0.0, low), high

    def derived(self) -> dict[str, Any]:
        """Return what chance alone would give."""
        sides = zip(("lower", "upper"), self.interval_95, strict=True)
        interval = {side: dict(zip(self.output_names, bound.T, strict=True)) for side, bound in sides}
        by_output = {n: {side: interval[side][n] for side in interval} for n in self.output_names}
        return {"interval_95": by_output, "significance_95": self.significance_95}

    def rows(self) -> Iterator[Sequence[Any]]:
        """Yield one row for each frequency: the multiple coherence of each output, the ordinary ones, 95 % bounds."""
        pairs = [f"{y} from {u}" for y in self.output_names for u in self.input_names]
        bounds = [f"{y} from all inputs, {side} 95 %" for side in ("lower", "upper") for y in self.output_names]
        yield ("frequency [Hz]", *(f"{y} from all inputs" for y in self.output_names), *pairs, *bounds)
        flat = self.ordinary.reshape(len(self.frequency_hz), -1)
        yield from np.column_stack([self.frequency_hz, self.multiple, flat, *self.interval_95]).tolist()


@with_origin()
def coherence(
    experiment: Experiment,
    *,
    segments: int | None = None,
    length: int | None = None,
    overlap: float = 0.5,
    window: str = "hann",
) -> Coherence:
    """Estimate ordinary and multiple coherence by Welch's averaged periodograms.

    A response that lasts longer than a segment lowers the estimate; take fewer, longer segments and see whether
    it rises. Between the lines of a multisine there is leakage only: the coherence there says nothing.

    Args:
        experiment: recorded data.
        segments: the record is cut into so many segments, side by side; None: 20.
        length: length of a segment [samples], instead of `segments`.
        overlap: share that neighbouring segments have in common.
        window: hann, hamming, blackman, bartlett, flattop or boxcar.

    Raises:
        InputError: unknown window, segments too short, not more averages than inputs (the coherence would be
            1 whatever the data).

    Examples:
        Noise of the same power halves the coherence.

        >>> import numpy as np
        >>> u = np.random.default_rng(0).standard_normal(1000)
        >>> noise = np.random.default_rng(1).standard_normal(1000)
        >>> found = wb.coherence(wb.make_experiment(0.1, u, u + noise))
        >>> print(found.multiple.mean().round(1))
        0.5
    """
    settings = choose_window(
        experiment.n_samples, experiment.dt, segments=segments, length=length, overlap=overlap, window=window
    )
    m = experiment.n_inputs
    if settings.effective_averages <= m + 0.5:
        raise InputError(
            f"{experiment.name}: coherence with {m} input{'s' if m > 1 else ''} needs more than "
            f"{settings.averages} segments: it would always be 1; use more, shorter ones"
        )
    frequency, spectra = cross_spectra(np.hstack([experiment.u, experiment.y]), settings)
    ordinary, multiple, response = _of_spectra(spectra, m)
    return Coherence(
        name=experiment.name,
        frequency_hz=frequency,
        ordinary=ordinary,
        multiple=multiple,
        response=response,
        input_density=np.real(np.einsum("kii->ki", spectra[:, :m, :m])).copy(),
        input_names=experiment.input_names,
        output_names=experiment.output_names,
        settings=settings,
    )


def _of_spectra(s: Complex, m: int) -> tuple[Floats, Floats, Complex]:
    """Return ordinary and multiple coherence and the response from cross-spectra, shape (n_f, m + p, m + p)."""
    power = np.real(np.einsum("kii->ki", s))
    dead = power <= _NO_POWER * np.max(power, axis=0, initial=0.0)
    safe = np.where(dead, 1.0, power)
    normal = s / np.sqrt(safe[:, :, None] * safe[:, None, :])
    ordinary = np.abs(normal[:, m:, :m]) ** 2
    ordinary[np.broadcast_to(dead[:, None, :m], ordinary.shape)] = np.nan
    normal[np.broadcast_to(dead[:, :, None] | dead[:, None, :], normal.shape)] = 0.0
    uu, uy = normal[:, :m, :m], normal[:, :m, m:]
    weights = np.linalg.pinv(uu, rcond=_DEPENDENT, hermitian=True) @ uy
    multiple = np.real(np.einsum("kmp,kmp->kp", np.conj(uy), weights))
    multiple[np.all(dead[:, :m], axis=1)] = np.nan
    response = np.swapaxes(weights, 1, 2) * np.sqrt(safe[:, m:, None] / safe[:, None, :m])
    response[np.broadcast_to(dead[:, None, :m], response.shape)] = np.nan
    return np.clip(ordinary, 0.0, 1.0), np.clip(multiple, 0.0, 1.0), response

"""Spectral density of the columns of an experiment."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from workbench.core.records.record import entry
from workbench.core.values.arrays import Complex, Floats
from workbench.data.experiment.experiment import Experiment
from workbench.data.spectra.window import WindowSettings, choose_window, cross_spectra
from workbench.errors import InputError, suggest
from workbench.requests.decorator import with_origin
from workbench.show.result import Result

__all__ = ["SpectralDensity", "sdf"]


@dataclass(frozen=True, eq=False)
class SpectralDensity(Result):
    """One-sided spectral densities, from 0 to the Nyquist frequency.

    Attributes:
        name: name of the experiment.
        frequency_hz: shape (n_f,) [Hz].
        matrix: auto- and cross-densities, shape (n_f, c, c), [unit of row · unit of column / Hz], in the order
            of `columns`; the integral of a diagonal element over frequency is that column's variance.
        columns: names.
        units: units of the columns, None where there is none.
        settings: window, segments, resolution and random error.
    """

    _page = "workbench.data.spectra.page:density_page"
    _picture = "workbench.data.spectra.picture:plot_density"

    name: str
    frequency_hz: Floats = field(metadata=entry(dims=("frequency_hz",), unit="Hz"))
    matrix: Complex = field(metadata=entry(dims=("frequency_hz", "columns", "columns")))
    columns: tuple[str, ...]
    units: tuple[str | None, ...] = field(metadata=entry(kept=False))
    settings: WindowSettings

    @property
    def density(self) -> Floats:
        """Auto-densities, shape (n_f, c), [unit²/Hz]."""
        return np.array(np.real(np.einsum("kii->ki", self.matrix)), dtype=np.float64)

    def band_hz(self, column: str, drop_db: float = 3.0) -> float:
        """Return the frequency up to which a column's density stays within `drop_db` of its peak below it [Hz].

        Args:
            column: name.
            drop_db: [dB], positive.

        Raises:
            InputError: unknown column.
        """
        if column not in self.columns:
            raise InputError(f"'{column}' is not a column of this spectrum; {suggest(column, self.columns)}")
        # The mean is taken out of every segment, so that the first lines say nothing.
        first = min(2, len(self.frequency_hz) - 1)
        values = self.density[first:, self.columns.index(column)]
        low = np.flatnonzero(values < 10.0 ** (-0.1 * drop_db) * np.maximum.accumulate(values))
        return float(self.frequency_hz[first + low[0]] if low.size else self.frequency_hz[-1])

    def derived(self) -> dict[str, Any]:
        """Return auto-densities and units by column."""
        auto = dict(zip(self.columns, self.density.T, strict=True))
        return {"density": auto, "units": dict(zip(self.columns, self.units, strict=True))}

    @classmethod
    def restored(cls, data: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the units in the order of the columns."""
        return {**data, "units": [data["units"][name] for name in data["columns"]]}

    def rows(self) -> Iterator[Sequence[Any]]:
        """Yield one row for each frequency, with the spectral densities of the channels."""
        yield ("frequency [Hz]", *(f"{n} [{u or '1'}^2/Hz]" for n, u in zip(self.columns, self.units, strict=True)))
        yield from np.column_stack([self.frequency_hz, self.density]).tolist()


@with_origin()
def sdf(
    experiment: Experiment,
    *,
    columns: Sequence[str] | None = None,
    segments: int | None = None,
    length: int | None = None,
    overlap: float = 0.5,
    window: str = "hann",
) -> SpectralDensity:
    """Estimate spectral densities by Welch's averaged periodograms.

    Not for single lines (a sine, a multisine): a line has power, not density, and its height depends on the
    resolution.

    Args:
        experiment: recorded data.
        columns: names; None: all inputs, then all outputs.
        segments: the record is cut into so many segments, side by side; None: 20.
        length: length of a segment [samples], instead of `segments`.
        overlap: share that neighbouring segments have in common.
        window: hann, hamming, blackman, bartlett, flattop or boxcar.

    Raises:
        InputError: unknown column or window, segments too short for the record.

    Examples:
        White noise of variance 1, sampled at 10 Hz, has the one-sided density 1/(5 Hz).

        >>> import numpy as np
        >>> u = np.random.default_rng(0).standard_normal(100_000)
        >>> density = wb.sdf(wb.make_experiment(0.1, u, u)).density[:, 0]
        >>> print(np.median(density).round(2))
        0.2
    """
    names = (*experiment.input_names, *experiment.output_names)
    units = (*experiment.input_units, *experiment.output_units)
    chosen = names if columns is None else tuple(columns)
    for column in chosen:
        if column not in names:
            raise InputError(f"{experiment.name}: there is no column '{column}'; {suggest(column, names)}")
    at = [names.index(c) for c in chosen]
    settings = choose_window(
        experiment.n_samples, experiment.dt, segments=segments, length=length, overlap=overlap, window=window
    )
    frequency, matrix = cross_spectra(np.hstack([experiment.u, experiment.y])[:, at], settings)
    return SpectralDensity(experiment.name, frequency, matrix, chosen, tuple(units[i] for i in at), settings)

"""Pictures of spectral densities and coherence."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from workbench.core.values.arrays import Floats
from workbench.show.figure import COLOURS, LEGEND, rows

if TYPE_CHECKING:
    from workbench.data.spectra.coherence import Coherence
    from workbench.data.spectra.density import SpectralDensity

__all__ = ["plot_coherence", "plot_density"]

_DEEPEST_DB = 90.0  # below the peak: rounding


def plot_density(result: SpectralDensity) -> Figure:
    """Draw each column's density [dB] over frequency [Hz] up to Nyquist, with the band of 95 % confidence.

    Args:
        result: what to draw.
    """
    figure, axes = rows(len(result.columns), title=f"{result.name}: spectral density")
    low, high = (10.0 * np.log10(f) for f in result.settings.interval_95)
    # The mean of every segment is taken out, so that the line at 0 Hz says nothing.
    frequency = result.frequency_hz[1:]
    for i, (ax, column, unit) in enumerate(zip(axes, result.columns, result.units, strict=True)):
        level = _decibel(result.density[1:, i])
        colour = COLOURS[i % len(COLOURS)]
        ax.fill_between(frequency, level + low, level + high, color=colour, alpha=0.18, linewidth=0.0)
        ax.plot(frequency, level, color=colour, linewidth=1.3)
        ax.set_ylabel(f"{column} [dB re {_square(unit)}/Hz]")
    _foot(axes[-1], result.settings.nyquist_hz, f"{result.settings.describe()}; shaded: 95 %")
    figure.align_ylabels(axes)
    return figure


def plot_coherence(result: Coherence) -> Figure:
    """Draw coherence over frequency [Hz] up to Nyquist, a picture for each output.

    Args:
        result: what to draw.
    """
    source = result.input_names[0] if len(result.input_names) == 1 else "inputs"
    figure, axes = rows(len(result.output_names), title=f"{result.name}: coherence with {source}")
    for i, ax in enumerate(axes):
        _draw(ax, result, i)
    _foot(axes[-1], result.settings.nyquist_hz, f"{result.settings.describe()}; shaded: 95 %")
    if len(result.input_names) > 1:
        axes[0].legend(**LEGEND)
    return figure


def _draw(ax: Axes, result: Coherence, output: int) -> None:
    """Draw one output's coherence into a picture."""
    frequency = result.frequency_hz[1:]
    several = len(result.input_names) > 1
    low, high = (bound[1:, output] for bound in result.interval_95)
    ax.fill_between(frequency, low, high, color=COLOURS[0], alpha=0.18, linewidth=0.0)
    for j, name in enumerate(result.input_names if several else ()):
        colour = COLOURS[(j + 1) % len(COLOURS)]
        ax.plot(frequency, result.ordinary[1:, output, j], color=colour, linewidth=0.9, label=f"{name} alone")
    ax.plot(frequency, result.multiple[1:, output], color=COLOURS[0], linewidth=1.5, label="all inputs together")
    ax.axhline(result.significance_95, color="#888888", linestyle="--", linewidth=0.9)
    ax.annotate(
        "95 % of chance", (1.0, result.significance_95), xycoords=("axes fraction", "data"), ha="right", va="bottom",
        fontsize=7.5, color="#666666",
    )  # fmt: skip
    ax.set_ylim(0.0, 1.04)
    ax.set_ylabel(f"coherence, {result.output_names[output]}")


def _decibel(density: Floats) -> Floats:
    peak = float(np.max(density, initial=0.0))
    floor = max(peak * 10.0 ** (-0.1 * _DEEPEST_DB), 1e-300)
    return np.asarray(10.0 * np.log10(np.maximum(density, floor)))


def _square(unit: str | None) -> str:
    return f"{unit}²" if unit and unit != "1" else "1"


def _foot(ax: Axes, nyquist: float, note: str) -> None:
    ax.set_xlim(0.0, nyquist)
    ax.set_xlabel("frequency [Hz], up to Nyquist")
    ax.annotate(note, (0.0, -0.3), xycoords="axes fraction", fontsize=8.0, color="#555555")

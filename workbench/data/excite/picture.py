"""Pictures of identification experiments."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy import signal

from workbench.core.values.arrays import Floats
from workbench.data.experiment.experiment import Experiment
from workbench.show.figure import COLOURS, rows
from workbench.show.tables import bracketed

if TYPE_CHECKING:
    from workbench.data.excite.result import ExciteResult, SignalFacts

__all__ = ["plot_excite"]

_SHOWN = 120  # samples of the input: more of them look like a block
_SEGMENT = 256  # samples of one segment of the estimated spectrum, at most
_FLOOR = -60.0  # [dB]: what is less is not drawn as a line
_EDGE = 0.999  # rounding of a line on the border of the band
_EMPTY = 1e-6  # of the largest power: what is less is rounding, no line
_VALIDATION = "#777777"
_STYLES: dict[str, dict[str, Any]] = {
    "prbs": {"linewidth": 1.2},
    "multisine": {"linestyle": "", "marker": "o", "markersize": 2.5},
}


def plot_excite(result: ExciteResult) -> Figure:
    """Draw each input (its beginning and its range), the spectra of the inputs, and each output over time.

    Args:
        result: the recorded experiments.
    """
    data = result.identification
    count = data.n_inputs + 1 + data.n_outputs
    figure, axes = rows(count, title=f"{result.model}: {_title(result.design)}\n", shared=1)
    for i, ax in enumerate(axes[: data.n_inputs]):
        _input(ax, result, i)
    _spectra(axes[data.n_inputs], data, result.design)
    outputs = axes[data.n_inputs + 1 :]
    for i, ax in enumerate(outputs):
        _output(ax, result, i)
    outputs[-1].set_xlabel("time [s]")
    return figure


def _title(design: SignalFacts) -> str:
    if design.kind == "prbs":
        return f"PRBS of order {design.order}, {design.clock:.4g} Hz, sampled every {design.dt:.4g} s"
    return f"multisine of {design.lines} lines, period {design.period:.4g} s, sampled every {design.dt:.4g} s"


def _input(ax: Axes, result: ExciteResult, i: int) -> None:
    data, colour = result.identification, COLOURS[i % len(COLOURS)]
    end = min(_SHOWN, data.n_samples)
    ax.step(data.time[:end], data.u[:end, i], where="post", color=colour, linewidth=1.2)
    low, high = float(data.u[:, i].min()), float(data.u[:, i].max())
    for value, words in ((high, f"{high:.4g}"), (low, f"{low:.4g}")):
        ax.axhline(value, color="#444444", linewidth=0.8, linestyle=":", label=words)
    middle = result.u0[data.input_names[i]]
    ax.axhline(middle, color="#444444", linewidth=0.8, linestyle="--")
    ax.set_ylabel(bracketed(data.input_names[i], data.input_units[i]))
    crest = result.design.crest_factor[i]
    text = f"range {low:.4g} … {high:.4g}, middle {middle:.4g}, crest factor {crest:.3g}; first {end} samples"
    _say(ax, text)
    ax.set_xlim(float(data.time[0]), float(data.time[end - 1]))
    ax.set_xlabel("time [s]")


def _say(ax: Axes, text: str) -> None:
    """Write above the picture, where no curve runs."""
    ax.annotate(
        text.replace("-", "−"),
        (1.0, 1.02),
        xycoords="axes fraction",
        ha="right",
        va="bottom",
        fontsize=8.5,
        color="#444444",
    )


def _spectra(ax: Axes, data: Experiment, design: SignalFacts) -> None:
    """Draw the spectra over their own mean within the band: inputs of different units fall together."""
    low, high = design.band
    for i, name in enumerate(data.input_names):
        frequency, power = _spectrum(data.u[:, i], design)
        inside = (frequency >= low * _EDGE) & (frequency <= high / _EDGE) & (power > _EMPTY * power.max())
        level = 10.0 * np.log10(np.maximum(power / max(float(power[inside].mean()), 1e-300), 1e-30))
        shown = level > _FLOOR if design.kind == "multisine" else np.ones(len(level), dtype=bool)
        ax.plot(frequency[shown], level[shown], color=COLOURS[i % len(COLOURS)], label=name, **_STYLES[design.kind])
    ax.axvspan(low, high, color=COLOURS[4], alpha=0.15, linewidth=0.0)
    what = "above −3 dB" if design.kind == "prbs" else "lines"
    _say(ax, f"shaded: {what}, {low:.3g} … {high:.4g} Hz; 0 dB is the mean there")
    ax.set_xlim(0.0, 0.5 / design.dt)
    ax.set_ylim(-40.0, 5.0)
    ax.set_ylabel("spectral density [dB]")
    ax.set_xlabel("frequency [Hz]")
    if data.n_inputs > 1:
        ax.legend(fontsize=8.5, loc="lower left")


def _spectrum(values: Floats, design: SignalFacts) -> tuple[Floats, Floats]:
    """Return frequencies [Hz] and the one-sided spectral density without the mean."""
    rate = 1.0 / design.dt
    if design.kind == "multisine":
        # Whole periods without a window: every line falls on a frequency of its own.
        length = min(round(design.period * rate), len(values))
        whole = values[: length * max(1, len(values) // length)]
        frequency, power = signal.welch(
            whole - whole.mean(), rate, window="boxcar", nperseg=length, noverlap=0, detrend=False
        )
    else:
        length = min(_SEGMENT, len(values))
        frequency, power = signal.welch(values - values.mean(), rate, nperseg=length, detrend=False)
        frequency, power = frequency[1:], power[1:]
    return frequency, power


def _output(ax: Axes, result: ExciteResult, i: int) -> None:
    data = result.identification
    ax.plot(data.time, data.y[:, i], color=COLOURS[0], linewidth=0.8, label="identification")
    second = result.validation
    if second is not None:
        ax.plot(second.time, second.y[:, i], color=_VALIDATION, linewidth=0.8, label="validation")
        ax.legend(fontsize=8.5, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, frameon=False, borderpad=0.0)
    rest = result.y0[data.output_names[i]]
    ax.axhline(rest, color="#444444", linewidth=0.8, linestyle="--")
    ax.set_ylabel(bracketed(data.output_names[i], data.output_units[i]))
    _say(ax, f"range {data.y[:, i].min():.4g} … {data.y[:, i].max():.4g}, before it began {rest:.4g}")

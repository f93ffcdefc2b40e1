"""Picture of the advice about data: the record and the coherence."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from workbench.errors import InputError
from workbench.show.figure import COLOURS
from workbench.show.figure import panels as panels_of
from workbench.show.tables import bracketed

if TYPE_CHECKING:
    from workbench.data.advice.result import Advice

__all__ = ["plot_advice"]

_MARK = "#D55E00"
_MOST_PANELS = 6  # columns drawn over time


def plot_advice(advice: Advice) -> Figure:
    """Draw inputs and outputs over time, the samples that were found in them marked, and the coherence.

    Args:
        advice: the advice and its data.
    """
    panels = min(advice.experiment.n_inputs + advice.experiment.n_outputs, _MOST_PANELS)
    title = f"{advice.experiment.name}: advice on the data, worst verdict: {advice.worst}"
    figure, grid = panels_of(panels + 1, 1, title=title, width=9.0, height=1.4)
    axes = [row[0] for row in grid]
    _record(axes[:panels], advice)
    _coherence(axes[panels], advice)
    for ax in axes:
        ax.tick_params(labelsize=8.5)
    figure.align_ylabels(axes)
    return figure


def _record(axes: list[Axes], advice: Advice) -> None:
    data = advice.experiment
    names = (*data.input_names, *data.output_names)
    values = np.hstack([data.u, data.y])
    for i, ax in enumerate(axes):
        held = i < data.n_inputs
        ax.plot(
            data.time, values[:, i], color=COLOURS[0 if held else 1], linewidth=0.7,
            drawstyle="steps-post" if held else "default",
        )  # fmt: skip
        ax.set_ylabel(bracketed(names[i], data.units[names[i]]), fontsize=8.5)
        for finding in advice.findings:
            at = list(finding.marks.get(names[i], ()))
            if at:
                ax.plot(data.time[at], values[at, i], ".", color=_MARK, markersize=3.5, label=finding.topic)
                ax.legend(fontsize=8.0, loc="upper right", framealpha=0.9, edgecolor="#cccccc")
        ax.set_xlim(data.time[0], data.time[-1])
        ax.tick_params(labelbottom=ax is axes[-1])
    axes[-1].set_xlabel("time [s]", fontsize=8.5)


def _coherence(ax: Axes, advice: Advice) -> None:
    from workbench.data.spectra.coherence import coherence  # noqa: PLC0415  drawn, not part of the advice

    try:
        result = coherence(advice.experiment)
    except InputError as error:
        ax.text(0.5, 0.5, str(error), ha="center", va="center", fontsize=8.5, transform=ax.transAxes, wrap=True)
        return
    for i, name in enumerate(result.output_names):
        colour = COLOURS[(i + 1) % len(COLOURS)]
        ax.plot(result.frequency_hz[1:], result.multiple[1:, i], color=colour, linewidth=1.3, label=name)
    ax.axhline(result.significance_95, color="#888888", linestyle="--", linewidth=0.9, label="95 % of chance")
    ax.legend(fontsize=8.0, framealpha=0.9, edgecolor="#cccccc")
    ax.set_ylim(0.0, 1.04)
    ax.set_ylabel("coherence", fontsize=8.5)
    ax.set_xlabel(f"frequency [Hz]; {result.settings.describe()}", fontsize=8.5)
    ax.set_xlim(0.0, result.settings.nyquist_hz)

"""Picture of the advice about data: the record, the coherence, and the verdicts in words."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from workbench.errors import InputError
from workbench.show.figure import COLOURS, label
from workbench.show.figure import panels as panels_of

if TYPE_CHECKING:
    from workbench.data.advice.result import Advice, Finding

__all__ = ["plot_advice"]

_SIGNS = {"good": "#009E73", "unknown": "#999999", "watch": "#E69F00", "poor": "#D55E00"}
_MOST_PANELS = 6  # columns drawn over time
_WIDTH = 104  # characters of a line
_LINE = 0.19  # [inch]


def plot_advice(advice: Advice, *, findings: bool = True) -> Figure:
    """Draw inputs and outputs over time with marked samples, the coherence, and every finding with its verdict.

    Args:
        advice: what to draw.
        findings: write them below; a page has a table of them.
    """
    texts = [_wrapped(f) for f in advice.findings]
    lines = sum(len(t) for t in texts) + 0.35 * len(texts)
    panels = min(advice.experiment.n_inputs + advice.experiment.n_outputs, _MOST_PANELS)
    heights = [*(1.35 for _ in range(panels)), 1.6, *([_LINE * lines + 0.3] if findings else [])]
    title = f"{advice.experiment.name}: advice on the data, worst verdict: {advice.worst}"
    figure, grid = panels_of(len(heights), 1, title=title, width=9.0, height=1.0, ratios=heights)
    axes = [row[0] for row in grid]
    _record(axes[:panels], advice)
    _coherence(axes[panels], advice)
    if findings:
        _verdicts(axes[-1], advice.findings, texts)
    for ax in axes[: panels + 1]:
        ax.tick_params(labelsize=8.5)
    figure.align_ylabels(axes[: panels + 1])
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
        ax.set_ylabel(label(names[i], data.units[names[i]]), fontsize=8.5)
        for found in advice.findings:
            at = list(found.marks.get(names[i], ()))
            if at:
                ax.plot(data.time[at], values[at, i], ".", color=_SIGNS["poor"], markersize=3.5, label=found.topic)
                ax.legend(fontsize=8.0, loc="upper right", framealpha=0.9, edgecolor="#cccccc")
        ax.set_xlim(data.time[0], data.time[-1])
        ax.tick_params(labelbottom=ax is axes[-1])
    axes[-1].set_xlabel("time [s]", fontsize=8.5)


def _coherence(ax: Axes, advice: Advice) -> None:
    from workbench.data.spectra.coherence import coherence  # noqa: PLC0415  drawn, not part of the advice

    try:
        found = coherence(advice.experiment)
    except InputError as error:
        ax.text(0.5, 0.5, str(error), ha="center", va="center", fontsize=8.5, transform=ax.transAxes, wrap=True)
        return
    for i, name in enumerate(found.output_names):
        colour = COLOURS[(i + 1) % len(COLOURS)]
        ax.plot(found.frequency_hz[1:], found.multiple[1:, i], color=colour, linewidth=1.3, label=name)
    ax.axhline(found.significance_95, color="#888888", linestyle="--", linewidth=0.9, label="95 % of chance")
    ax.legend(fontsize=8.0, framealpha=0.9, edgecolor="#cccccc")
    ax.set_ylim(0.0, 1.04)
    ax.set_ylabel("coherence", fontsize=8.5)
    ax.set_xlabel(f"frequency [Hz]; {found.settings.describe()}", fontsize=8.5)
    ax.set_xlim(0.0, found.settings.nyquist_hz)


def _wrapped(finding: Finding) -> list[str]:
    text = finding.evidence + (f". Advice: {finding.advice}" if finding.advice else "")
    return textwrap.wrap(text, _WIDTH) or [""]


def _verdicts(ax: Axes, findings: tuple[Finding, ...], texts: list[list[str]]) -> None:
    ax.set_axis_off()
    total = sum(len(t) for t in texts) + 0.35 * len(texts)
    ax.set_xlim(0.0, 1.0)
    ax.set_ylim(total, 0.0)
    y = 0.5
    with mpl.rc_context({"font.size": 8.5}):
        for finding, lines in zip(findings, texts, strict=True):
            ax.text(0.0, y, "■", color=_SIGNS[finding.verdict], fontsize=11.0, va="center")
            ax.text(0.022, y, finding.topic, fontsize=8.5, va="center", fontweight="bold")
            ax.text(0.135, y, finding.verdict, fontsize=8.5, va="center", color="#444444")
            for offset, line in enumerate(lines):
                ax.text(0.2, y + offset, line, fontsize=8.5, va="center")
            y += len(lines) + 0.35

"""Pictures of motions of several models beside each other."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from workbench.core.values.arrays import Floats
from workbench.show.figure import COLOURS, outside, panels
from workbench.show.tables import bracketed

if TYPE_CHECKING:
    from workbench.response.compare.result import MotionComparison

__all__ = ["plot_motions"]

_LINES = 3000  # rows up to which the motion itself is drawn, beyond that its envelope
_BINS = 260
_TALLEST = 12  # panels


def plot_motions(result: MotionComparison) -> Figure:
    """Draw peak and rms of each signal as bars, and its record, the windows shaded.

    Args:
        result: of the comparison.
    """
    signals = result.signals[:_TALLEST]
    figure, grid = panels(len(signals), 2, title="motions under the same signals", width=10.4, height=2.3)
    for (bars, record), signal in zip(grid, signals, strict=True):
        _bars(bars, result, signal)
        _record(record, result, signal)
    grid[-1][1].set_xlabel("time [s]")
    handles = [Patch(color=_colour(n), label=name) for n, name in enumerate(result.systems)]
    rms = Line2D([], [], color="#222222", linewidth=1.6, label="rms (the bar: peak)")
    outside(figure, [*handles, rms], "lower center", ncols=min(len(handles) + 1, 5), fontsize=8.5, frameon=False)
    return figure


def _colour(number: int) -> str:
    return COLOURS[number % len(COLOURS)]


def _bars(ax: Axes, result: MotionComparison, signal: str) -> None:
    """Draw a group of bars for each window, one bar for each system."""
    factor, count = result.shown[signal].factor, len(result.systems)
    width = 0.8 / count
    for number, name in enumerate(result.systems):
        for window in range(len(result.windows)):
            measured = result.measure(name, signal, window)
            x = window + (number - 0.5 * (count - 1)) * width
            if measured is None:
                ax.annotate(
                    "failed", (x, 0.0), rotation=90, fontsize=7.0, ha="center", va="bottom", color=_colour(number)
                )
                continue
            peak, rms = factor * measured.peak, factor * measured.rms
            ax.bar(x, peak, 0.9 * width, color=_colour(number), alpha=0.75)
            ax.plot([x - 0.45 * width, x + 0.45 * width], [rms, rms], color="#222222", linewidth=1.6)
            ax.annotate(
                f"{peak:.2g}", (x, peak), xytext=(0, 1.5), textcoords="offset points", fontsize=7.0, ha="center"
            )
    ax.set_xticks(range(len(result.windows)), [f"{a:g} … {b:g} s" for a, b in result.windows])
    ax.tick_params(axis="x", length=0)
    ax.margins(y=0.12)
    ax.set_ylabel(bracketed("peak", result.shown[signal].unit))
    ax.set_title(signal, loc="left", fontsize=9.0)


def _record(ax: Axes, result: MotionComparison, signal: str) -> None:
    factor = result.shown[signal].factor
    for begin, end in result.windows:
        ax.axvspan(begin, end, color="#eeeeee", zorder=0, linewidth=0.0)
    order = {h.system: h for h in result.histories}
    begin_shown = _begin(result)
    long = any(int(np.sum(h.time >= begin_shown)) > _LINES for h in result.histories)
    for number, name in enumerate(result.systems):
        if name not in order:
            continue
        shown = order[name].time >= begin_shown
        time, value = order[name].time[shown], factor * order[name].values[signal][shown]
        if long:
            at, size = _envelope(time, value)
            ax.plot(at, size, color=_colour(number), linewidth=1.3)
        else:
            ax.plot(time, value, color=_colour(number), linewidth=1.0)
    ax.set_ylabel(bracketed("largest size" if long else "value", result.shown[signal].unit))
    ax.set_xlim(begin_shown, result.stop)
    for failure in result.failed:
        if failure.time is not None:
            ax.axvline(failure.time, color=_colour(result.systems.index(failure.system)), linewidth=0.9, linestyle=":")


def _begin(result: MotionComparison) -> float:
    """Return where the records begin to be shown: as long before the windows as they last together."""
    first, last = min(a for a, _ in result.windows), max(b for _, b in result.windows)
    return max(0.0, first - (last - first))


def _envelope(time: Floats, value: Floats) -> tuple[Floats, Floats]:
    """Return the largest size in each of many short spans."""
    edges = np.linspace(float(time[0]), float(time[-1]), _BINS + 1)
    place = np.clip(np.searchsorted(edges, time, side="right") - 1, 0, _BINS - 1)
    largest = np.zeros(_BINS)
    np.maximum.at(largest, place, np.abs(value))
    return 0.5 * (edges[1:] + edges[:-1]), largest

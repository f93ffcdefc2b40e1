"""Pictures of a run from rest: the signal, its frequency and amplitude over time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from workbench.core.values.arrays import Floats
from workbench.show.figure import COLOURS, panels
from workbench.show.tables import bracketed

if TYPE_CHECKING:
    from workbench.limit_cycles.limit_cycle.free_run import FreeRun

__all__ = ["draw_amplitude", "draw_frequency", "draw_signal", "plot_free_run"]

_SMOOTHED = 9  # periods of the running median
_LEAST = 2.0  # ratio of amplitudes below which the picture is not made to show it
_ROOM = 0.35  # of the range of the medians, around them


def plot_free_run(run: FreeRun) -> Figure:
    """Draw the signal, and frequency and amplitude of its oscillation, over time.

    Args:
        run: with its history.
    """
    figure, grid = panels(3, 1, title=f"{run.signal}: {run.words()}", width=8.4, height=2.1, sharex="all")
    draw_signal(grid[0][0], run)
    draw_frequency(grid[1][0], run, {})
    draw_amplitude(grid[2][0], run, {})
    for row in grid[:2]:
        row[0].set_xlabel("")
    return figure


def draw_signal(ax: Axes, run: FreeRun) -> None:
    """Draw the signal over time.

    Args:
        ax: where.
        run: with its record.
    """
    ax.plot(run.time, run.value, color=COLOURS[0], linewidth=0.5)
    ax.set(xlabel="time [s]", ylabel=bracketed(run.signal, run.unit), xlim=(float(run.time[0]), float(run.time[-1])))


def draw_frequency(ax: Axes, run: FreeRun, marks: Mapping[float, str]) -> None:
    """Draw the frequency of each period, and its running median.

    Args:
        ax: where.
        run: with its history.
        marks: frequency → words, drawn as lines across.
    """
    ax.plot(run.period_time, run.frequency_hz, ".", color="#9bbfd9", markersize=2.5)
    middle = _median(run.frequency_hz)
    ax.plot(run.period_time, middle, color=COLOURS[0], linewidth=1.3)
    if len(middle):
        late = middle[_SMOOTHED:] if len(middle) > _SMOOTHED else middle  # the first periods may be far off
        levels = [*late.tolist(), *marks]
        low, high = min(levels), max(levels)
        room = _ROOM * max(high - low, 0.02 * high)
        ax.set_ylim(low - room, high + room)
    _across(ax, run, marks)
    ax.set(xlabel="time [s]", ylabel="frequency of a period [Hz]")


def draw_amplitude(ax: Axes, run: FreeRun, marks: Mapping[float, str]) -> None:
    """Draw the amplitude of each period, logarithmic: exponential growth is a straight line.

    Args:
        ax: where.
        run: with its history.
        marks: amplitude → words, drawn as lines across.
    """
    shown = run.amplitude > 0.0
    ax.semilogy(run.period_time[shown], run.amplitude[shown], color=COLOURS[1], linewidth=1.3)
    known = [*run.amplitude[shown].tolist(), *marks]
    if known and max(known) < _LEAST * min(known):
        ax.set_ylim(min(known) / _LEAST, max(known) * _LEAST)
    _across(ax, run, marks)
    ax.set(xlabel="time [s]", ylabel=bracketed("amplitude", run.unit))


def _across(ax: Axes, run: FreeRun, marks: Mapping[float, str]) -> None:
    for value, words in marks.items():
        ax.axhline(value, color="#666666", linewidth=0.8, linestyle=":")
        ax.annotate(
            words, (float(run.time[-1]), value), xytext=(-3, 2), textcoords="offset points", fontsize=7.5, ha="right",
            color="#555555",
        )  # fmt: skip
    ax.set_xlim(float(run.time[0]), float(run.time[-1]))


def _median(values: Floats) -> Floats:
    if len(values) < _SMOOTHED:
        return values
    half = _SMOOTHED // 2
    padded = np.pad(values, half, mode="edge")
    return np.asarray(np.median(np.lib.stride_tricks.sliding_window_view(padded, _SMOOTHED), axis=1))

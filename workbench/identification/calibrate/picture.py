"""Pictures of a calibration: data and model, profile likelihoods, correlation."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from workbench.show.figure import COLOURS, LEGEND, panels
from workbench.show.tables import bracketed

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from workbench.identification.calibrate.result import CalibratedParameter, CalibrateResult, DataFit

__all__ = ["plot_calibration"]

_DARK = 0.7  # correlation: from here on its colour is dark
_MOST = 6  # data sets and outputs that are drawn


def plot_calibration(result: CalibrateResult) -> Figure:
    """Draw each measured output with the model before and after, then regions or profiles, and the correlation.

    Args:
        result: what to draw.
    """
    shown = [(one, j) for one in result.data for j in range(len(one.output_names))][:_MOST]
    estimated = [p for p in result.parameters if p.low is not None and p.high is not None][:_MOST]
    count = len(shown) + len(estimated) + (len(result.parameters) > 1)
    figure, grid = panels(-(-count // 2), 2, title=f"{result.model}: parameters from data", width=9.6, height=2.7)
    places = [ax for row in grid for ax in row]
    for ax, (one, j) in zip(places, shown, strict=False):
        _data(ax, one, j, named=len(result.data) > 1)
    for ax, p in zip(places[len(shown) :], estimated, strict=False):
        _region(ax, p)
    if len(result.parameters) > 1:
        _correlation(places[len(shown) + len(estimated)], result)
    for ax in places[count:]:
        ax.set_axis_off()
    return figure


def _data(ax: Axes, one: DataFit, j: int, *, named: bool) -> None:
    t, y = one.time, one.computed[:, j]
    ax.plot(t, one.measured[:, j], ".", color="#888888", markersize=2.5, label="measured")
    ax.plot(t, one.before[:, j], "--", color=COLOURS[1], linewidth=1.1, label="start values")
    if np.any(one.band[:, j] > 0.0):
        ax.fill_between(t, y - one.band[:, j], y + one.band[:, j], color=COLOURS[0], alpha=0.25, linewidth=0.0)
    ax.plot(t, y, color=COLOURS[0], linewidth=1.4, label="estimate")
    ax.set_xlabel("frequency [Hz]" if one.of_response else "time [s]")
    ax.set_xscale("log" if one.of_response else "linear")
    ax.set_ylabel(bracketed(one.output_names[j], one.output_units[j]))
    if named:
        ax.set_title(one.name, loc="left")
    ax.legend(**LEGEND)


def _region(ax: Axes, p: CalibratedParameter) -> None:
    """Draw the parabola of the covariance, the profile where it was followed, and the region."""
    low, high = float(p.low or 0.0), float(p.high or 0.0)
    if p.std_error:
        fine = np.linspace(p.value - 1.3 * (p.value - low), p.value + 1.3 * (high - p.value), 200)
        side = np.where(fine < p.value, p.value - low, high - p.value)
        ax.plot(
            fine, ((fine - p.value) / np.maximum(side, 1e-300)) ** 2, color="#888888", linewidth=1.0, label="region"
        )
    if p.profile is not None:
        ax.plot(p.profile.values, p.profile.cost, "o-", color=COLOURS[2], markersize=3.5, label="profile likelihood")
    ax.axhline(1.0, color="#b3261e", linewidth=1.0, label="95 %")
    ax.axvline(p.value, color=COLOURS[0], linewidth=1.2)
    ax.axvspan(low, high, color=COLOURS[0], alpha=0.12, linewidth=0.0)
    ax.set_ylim(0.0, 2.0)
    ax.xaxis.set_major_locator(MaxNLocator(5))
    ax.set_xlabel(bracketed(p.name, p.unit))
    ax.set_ylabel("cost / that of 95 %")
    ax.legend(**LEGEND)


def _correlation(ax: Axes, result: CalibrateResult) -> None:
    names = [p.name for p in result.parameters]
    ax.imshow(result.correlation, vmin=-1.0, vmax=1.0, cmap="RdBu_r", aspect="auto")
    ax.grid(visible=False)
    for i, row in enumerate(result.correlation):
        for k, x in enumerate(row):
            ax.text(k, i, "–" if np.isnan(x) else f"{x:.2f}", ha="center", va="center", fontsize=8.0,
                    color="white" if abs(x) > _DARK else "black")  # fmt: skip
    ax.set_xticks(range(len(names)), names, rotation=30, ha="right")
    ax.set_yticks(range(len(names)), names)
    ax.set_title("correlation", loc="left")

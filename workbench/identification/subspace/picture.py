"""Bars for the choice of a model's order."""

from __future__ import annotations

from textwrap import wrap
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from workbench.core.values.arrays import Floats
from workbench.show.figure import COLOURS, LEGEND, LINE, panels

if TYPE_CHECKING:
    from workbench.identification.subspace.result import SubspaceEstimate

__all__ = ["plot_order"]

_BARS = 24


_GREY = "#b8c4ce"


def plot_order(result: SubspaceEstimate) -> Figure:
    """Draw singular values and principal angles [deg] as bars, the order taken in colour.

    Args:
        result: of the subspace identification.
    """
    criterion = len(result.order_criterion) > 0
    title = f"{result.model.name}: choice of the order ({result.method}), {result.order} taken"
    figure, grid = panels(3 if criterion else 2, 1, title=title, height=2.1)
    shown = min(_BARS, max(len(result.singular_values), result.order + 1))
    _singular(grid[0][0], result, shown)
    _angles(grid[1][0], result, shown)
    if criterion:
        _criterion(grid[2][0], result, shown)
    for ax in (row[0] for row in grid):
        ax.set_xlim(0.3 if not criterion else -0.7, shown + 0.7)
        ax.xaxis.set_major_locator(MaxNLocator(integer=True, nbins=13))
        ax.grid(visible=False, axis="x")
    grid[-1][0].set_xlabel("order")
    reason = "\n".join(wrap(f"order {result.order}: {result.order_reason}", LINE))
    figure.supxlabel(reason, x=0.01, ha="left", fontsize=8.5)
    return figure


def _bars(ax: Axes, values: Floats, order: int) -> None:
    at = np.arange(1, len(values) + 1)
    for chosen, colour, text in ((at <= order, COLOURS[0], "taken"), (at > order, _GREY, "left out")):
        ax.bar(at[chosen], values[chosen], color=colour, width=0.7, label=text)


def _singular(ax: Axes, result: SubspaceEstimate, shown: int) -> None:
    values = result.singular_values[:shown]
    positive = values[values > 0.0]
    ax.set_yscale("log")
    _bars(ax, values, result.order)
    ax.legend(**LEGEND)
    if result.floor > 0.0 and positive.size and positive.min() < 1e3 * result.floor:
        ax.axhline(result.floor, color="#666666", linestyle="--", linewidth=0.9)
        ax.annotate("rounding", (shown, result.floor), va="bottom", ha="right", fontsize=8.0, color="#555555")
    if positive.size:
        ax.set_ylim(0.3 * float(positive.min()), 4.0 * float(positive.max()))
    ax.set_ylabel("canonical correlation" if result.basis == "combined" else "singular value")


def _angles(ax: Axes, result: SubspaceEstimate, shown: int) -> None:
    _bars(ax, result.principal_angles_deg[:shown], result.order)
    ax.axhline(90.0, color="#666666", linestyle="--", linewidth=0.9)
    ax.set_ylim(0.0, 100.0)
    ax.set_yticks([0.0, 30.0, 60.0, 90.0])
    ax.set_ylabel("principal angle [deg]")


def _criterion(ax: Axes, result: SubspaceEstimate, shown: int) -> None:
    values = result.order_criterion[: shown + 1]
    best = min(result.order, len(values) - 1)
    ax.plot(np.arange(len(values)), values, "o-", color=COLOURS[0], markersize=3.5, linewidth=1.0)
    ax.plot(best, values[best], "o", color=COLOURS[1], markersize=6.5, label="taken")
    ax.set_ylabel("information criterion")
    ax.legend(**LEGEND)

"""Pictures of a tuning: requirements before and after, the search, a trade-off."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from workbench.show.figure import COLOURS, LEGEND, panels

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from workbench.study.tune.result import TradeOff, TunedRequirement, TuneResult

__all__ = ["plot_tuning"]

_MOST = 20  # requirements that are drawn
_WIDE = 3.0  # what is farther from its limit is drawn there


def plot_tuning(result: TuneResult) -> Figure:
    """Draw the distance of each requirement from its limit before and after, the search, and a trade-off.

    Args:
        result: what to draw.
    """
    pair = None if result.conflict is None else result.conflict.trade_off
    count = 2 + (pair is not None)
    figure, grid = panels(1, count, title=f"{result.system}: tuned", width=4.6 * count, height=3.4)
    places = [ax for row in grid for ax in row]
    _requirements(places[0], result.requirements[:_MOST])
    places[1].plot(np.arange(len(result.history)), result.history, ".-", color=COLOURS[0])
    places[1].axhline(0.0, color="#b3261e", linewidth=1.0, label="all are met")
    places[1].set_xlabel("step")
    places[1].set_ylabel("worst requirement / its scale")
    places[1].legend(**LEGEND)
    if pair is not None and result.conflict is not None:
        _trade_off(places[2], pair, result.conflict.requirements)
    return figure


def _requirements(ax: Axes, shown: tuple[TunedRequirement, ...]) -> None:
    """Draw how far each is beyond its limit: those left of the line are met."""
    rows = np.arange(len(shown))
    for values, colour, words in (
        ([r.excess_before for r in shown], "#888888", "before"),
        ([r.excess for r in shown], COLOURS[0], "after"),
    ):
        x = [np.nan if v is None else max(-_WIDE, min(v, _WIDE)) for v in values]
        ax.plot(x, rows, "o", color=colour, label=words)
    ax.axvline(0.0, color="#b3261e", linewidth=1.0, label="limit")
    ax.set_yticks(rows, [f"{r.name} ({r.at})" if r.at else r.name for r in shown])
    ax.set_ylim(len(shown) - 0.5, -0.5)
    ax.set_xlabel("beyond the limit / scale")
    ax.legend(**LEGEND)


def _trade_off(ax: Axes, pair: TradeOff, names: tuple[str, ...]) -> None:
    ax.plot(pair.first, pair.second, "o-", color=COLOURS[2], markersize=4.0)
    ax.axvline(0.0, color="#b3261e", linewidth=1.0)
    ax.axhline(0.0, color="#b3261e", linewidth=1.0)
    ax.set_xlabel(f"{names[0]}, beyond its limit / scale")
    ax.set_ylabel(f"{names[1]}, beyond its limit / scale")
    ax.set_title("what one costs the other", loc="left")

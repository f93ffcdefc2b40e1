"""What pictures with panels of different axes share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

__all__ = ["ABOVE", "LEGEND", "LINE", "panels"]

LEGEND: dict[str, Any] = {"fontsize": 8.5, "framealpha": 0.9, "edgecolor": "#cccccc"}
LINE = 105  # characters of small print that fit below a picture
# A legend over the panel, where it covers no curve.
ABOVE: dict[str, Any] = {
    "loc": "lower left", "bbox_to_anchor": (-0.01, 0.98), "fontsize": 8.5, "frameon": False, "borderaxespad": 0.2,
}  # fmt: skip
_STYLE: dict[Any, Any] = {"font.size": 9.5, "axes.titlesize": 10.0, "axes.edgecolor": "#666666", "axes.linewidth": 0.8}


def panels(
    down: int,
    across: int,
    *,
    title: str,
    width: float = 7.2,
    height: float = 2.3,
    sharex: str = "none",
    ratios: Sequence[float] | None = None,
) -> tuple[Figure, list[list[Axes]]]:
    """Return a figure with a grid of panels under one title; it works without a display.

    Args:
        down: rows.
        across: columns.
        title: of the whole.
        width: of the figure [inch].
        height: of a row [inch].
        sharex: "none", "col" or "all".
        ratios: heights of the rows against each other.
    """
    sizes = None if ratios is None else {"height_ratios": list(ratios)}
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(width, 0.7 + height * (down if ratios is None else sum(ratios))), layout="constrained")
        FigureCanvasAgg(figure)
        figure.suptitle(title, x=0.01, ha="left", fontsize=11.0, fontweight="bold")
        grid: list[list[Axes]] = figure.subplots(down, across, squeeze=False, sharex=sharex, gridspec_kw=sizes).tolist()  # type: ignore[call-overload]
    for ax in (a for row in grid for a in row):
        ax.grid(visible=True, color="#dddddd", linewidth=0.6)
        ax.set_axisbelow(True)
        for side in ("top", "right"):
            ax.spines[side].set_visible(False)
    return figure, grid

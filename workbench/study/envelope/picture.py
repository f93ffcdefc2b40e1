"""Pictures of an envelope: the requirement over one or two parameters, with its borders and the worst case."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import TwoSlopeNorm
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from workbench.core.values.arrays import Floats
from workbench.show.figure import COLOURS, LEGEND, QUIET, caption, panels
from workbench.show.tables import bracketed

__all__ = ["EnvelopePanel", "plot_maps"]

_FINE = 121  # places along each axis of a map
_LEVELS = 12
_MARKS = {"Hopf": "^", "real pole": "v", "fold": "o", "cycle born": "^", "period doubling": "s"}
_ACROSS = 2  # panels beside each other


class EnvelopePanel:
    """What one panel shows.

    Args:
        title: above it.
        x, y: places of the points; y is None where there is one axis.
        margin: at the points; NaN: nothing was measured.
        passed: whether the requirement is met there.
        surface: places in 0 … 1, shape (m, 2) → margin and the error of the interpolation; None: no map can be drawn
            between the points.
        borders: kind, and places along both axes; NaN along the second where there is one axis.
        worst: place of the worst case; None: not in this panel.
    """

    def __init__(
        self,
        *,
        title: str,
        x: Floats,
        y: Floats | None,
        margin: Floats,
        passed: NDArray[np.bool_],
        surface: Callable[[Floats], tuple[Floats, Floats]] | None,
        borders: Sequence[tuple[str, float, float]],
        worst: tuple[float, float] | None,
    ) -> None:
        self.title, self.x, self.y, self.margin, self.passed = title, x, y, margin, passed
        self.surface, self.borders, self.worst = surface, borders, worst


def plot_maps(
    shown: Sequence[EnvelopePanel],
    *,
    title: str,
    axes: Sequence[tuple[str, float, float]],
    quantity: str,
    unit: str | None,
    remark: str,
) -> Figure:
    """Draw a panel for each failure.

    Args:
        shown: the panels.
        title: of the whole.
        axes: name, low and high of one or two parameters.
        quantity: what the margin is of.
        unit: of the margin.
        remark: small print; empty: none.
    """
    across = min(_ACROSS, len(shown))
    down = -(-len(shown) // across)
    figure, grid = panels(down, across, title=title, width=4.2 * across + 3.2, height=3.6)
    cells = [ax for row in grid for ax in row]
    for ax in cells[len(shown) :]:
        ax.axis("off")
    finite = np.concatenate([p.margin[np.isfinite(p.margin)] for p in shown])
    norm = _norm(finite)
    drawn: Any = None
    for ax, panel in zip(cells, shown, strict=False):
        if len(axes) > 1:
            mesh = _map(ax, panel, axes, norm)
            drawn = drawn if mesh is None else mesh
            ax.set(xlabel=axes[0][0], ylabel=axes[1][0], xlim=axes[0][1:], ylim=axes[1][1:])
        else:
            _curve(ax, panel, bracketed(f"margin of {quantity}", unit), axes[0])
        ax.set_title(panel.title, loc="left")
        handles, texts = ax.get_legend_handles_labels()
        once = dict(zip(texts, handles, strict=True))
        if once:
            ax.legend(
                list(once.values()),
                list(once),
                **{**LEGEND, "loc": "upper left", "bbox_to_anchor": (0.0, -0.16)},
                ncols=3,
            )
    if drawn is not None:
        bar = figure.colorbar(drawn, ax=cells[: len(shown)], label=bracketed(f"margin of {quantity}", unit))
        bar.set_ticks(_round_ticks(norm))
    if remark:
        caption(figure, remark)
    return figure


def _norm(finite: Floats) -> TwoSlopeNorm:
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (-1.0, 1.0)
    size = max(abs(low), abs(high)) or 1.0
    return TwoSlopeNorm(0.0, min(low, -0.02 * size), max(high, 0.02 * size))


def _round_ticks(norm: TwoSlopeNorm) -> list[float]:
    """Return round numbers on both sides of 0, whose colours are of different scales."""
    low, high = float(norm.vmin or 0.0), float(norm.vmax or 0.0)
    ticks = [*MaxNLocator(4).tick_values(low, 0.0), *MaxNLocator(4).tick_values(0.0, high)]
    return sorted({float(t) for t in ticks if low <= t <= high})


def _map(ax: Axes, panel: EnvelopePanel, axes: Sequence[tuple[str, float, float]], norm: TwoSlopeNorm) -> Any:  # noqa: ANN401
    """Draw margins as colours, the limit as a line with the band in which it may lie, and the points."""
    drawn: Any = None
    if panel.surface is not None:
        side = np.linspace(0.0, 1.0, _FINE)
        across, up = np.meshgrid(side, side)
        value, error = (a.reshape(across.shape) for a in panel.surface(np.column_stack([across.ravel(), up.ravel()])))
        x, y = (low + s * (high - low) for s, (_, low, high) in zip((across, up), axes, strict=True))
        levels = np.unique(
            np.concatenate([np.linspace(norm.vmin or 0.0, 0.0, _LEVELS), np.linspace(0.0, norm.vmax or 0.0, _LEVELS)])
        )
        drawn = ax.contourf(x, y, value, levels=levels, cmap="RdBu", norm=norm, extend="both", alpha=0.75)
        ax.contour(x, y, value, levels=levels[levels != 0.0][::3], colors=QUIET, linewidths=0.5, linestyles="solid")
        unsure = np.where(np.isnan(value), np.nan, np.abs(value) - error)
        if np.nanmin(unsure) < 0.0:
            ax.contourf(x, y, unsure, levels=[-np.inf, 0.0], colors="none", hatches=["////"])
            ax.fill([], [], facecolor="none", hatch="////", edgecolor="#333333", label="limit may lie here")
        if np.nanmin(value) < 0.0 < np.nanmax(value):
            ax.contour(x, y, value, levels=[0.0], colors="black", linewidths=1.6)
            ax.plot([], [], color="black", linewidth=1.6, label="limit, interpolated")
    _points(ax, panel)
    for kind in dict.fromkeys(kind for kind, _, _ in panel.borders):
        there = [(at, line) for k, at, line in panel.borders if k == kind]
        mark: dict[str, Any] = {
            "marker": _MARKS.get(kind, "P"),
            "markersize": 5.0,
            "linestyle": "",
            "color": COLOURS[2],
            "clip_on": False,
        }
        ax.plot(*zip(*there, strict=True), **mark, markeredgecolor="black", markeredgewidth=0.5, label=kind)
    if panel.worst is not None:
        ax.plot(
            *panel.worst,
            "*",
            color="#ffdd00",
            markeredgecolor="black",
            markersize=14.0,
            label="worst case",
            clip_on=False,
            zorder=5,
        )
    return drawn


def _points(ax: Axes, panel: EnvelopePanel) -> None:
    """Mark the points: met, not met, nothing measured."""
    x, y = panel.x, panel.margin if panel.y is None else panel.y
    unknown = ~np.isfinite(y) if panel.y is None else ~np.isfinite(panel.margin) & ~panel.passed
    small: dict[str, Any] = {
        "linestyle": "",
        "markersize": 3.5 if len(x) <= 300 else 1.8,
        "clip_on": False,
        "zorder": 3,
    }
    for chosen, mark, colour, words in (
        (panel.passed, "o", COLOURS[0], "met"),
        (~panel.passed & ~unknown, "s", COLOURS[1], "not met"),
    ):
        if chosen.any():
            ax.plot(
                x[chosen],
                y[chosen],
                mark,
                color=colour,
                markeredgecolor="white",
                markeredgewidth=0.3,
                label=words,
                **small,
            )
    if panel.y is not None and unknown.any():
        ax.plot(x[unknown], y[unknown], "x", color="black", label="not measured", **{**small, "markersize": 5.0})


def _curve(ax: Axes, panel: EnvelopePanel, words: str, axis: tuple[str, float, float]) -> None:
    """Draw margins over one parameter."""
    order = np.argsort(panel.x)
    ax.plot(panel.x[order], panel.margin[order], color=QUIET, linewidth=0.8)
    _points(ax, panel)
    ax.axhline(0.0, color="black", linewidth=1.2, label="limit")
    for kind, at, _ in panel.borders:
        ax.axvline(at, color=COLOURS[2], linestyle="--", linewidth=0.9, label=kind)
    for at in panel.x[~np.isfinite(panel.margin) & ~panel.passed]:
        ax.axvline(at, color="#bbbbbb", linewidth=0.6, label="not measured")
    if panel.worst is not None:
        ax.plot(
            *panel.worst, "*", color="#ffdd00", markeredgecolor="black", markersize=14.0, label="worst case",
            clip_on=False, zorder=5,
        )  # fmt: skip
    ax.set(xlabel=axis[0], ylabel=words, xlim=axis[1:])

"""Pictures of Nyquist curves with their crossings."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from workbench.plotting.figure import COLOURS, save
from workbench.plotting.panels import LEGEND, panels

if TYPE_CHECKING:
    from workbench.analysis.nyquist.result import Crossing, NyquistResult

__all__ = ["draw_plane", "plot_nyquist"]

_ROWS = 10  # of the table
_COLUMNS = ("", "f [Hz]", "real part", "gain", "amplitude", "poles below/above", "stable")


def plot_nyquist(result: NyquistResult, path: str | Path | None = None) -> Figure:
    """Draw L(jω) with −1/N(A), whole and around the crossings, and the table of crossings.

    Args:
        result: curve and crossings.
        path: also write the picture here; png, svg or pdf by suffix.

    Raises:
        InputError: unknown suffix, file cannot be written.
    """
    figure, grid = panels(2, 2, title=f"{result.name}: Nyquist curve", width=9.6, height=2.6, ratios=(1.5, 0.8))
    whole, near = grid[0]
    below = figure.add_gridspec(2, 1, height_ratios=(1.5, 0.8))[1]
    for ax in grid[1]:
        ax.remove()
    draw_plane(whole, result, reach=None)
    draw_plane(near, result, reach=_reach(result))
    whole.legend(**{**LEGEND, "loc": "best"})
    table = figure.add_subplot(below)
    table.axis("off")
    _table(table, result.crossings)
    if path is not None:
        save(figure, path)
    return figure


def _reach(result: NyquistResult) -> float:
    """Return how far the close view goes: over all crossings, or over those ten times nearer than the farthest."""
    sizes = sorted(abs(complex(c.real, c.imag)) for c in result.crossings if np.isfinite(c.real))
    return sizes[-1] if sizes else 1.0


def draw_plane(ax: Axes, result: NyquistResult, *, reach: float | None) -> None:
    """Draw the curve in the complex plane.

    Args:
        ax: where.
        result: curve and crossings.
        reach: largest size shown; None: the whole curve, as far as 98 % of it go.
    """
    value = np.asarray(result.response)
    value = np.where(np.isfinite(value), value, np.nan)
    ax.plot(value.real, value.imag, color=COLOURS[0], linewidth=1.2, label="L(jω)")
    if result.block:
        inverse = np.asarray(result.minus_inverse)
        ax.plot(inverse.real, inverse.imag, color=COLOURS[1], linewidth=1.6, label="−1/N(A)", zorder=3)
    for number, c in enumerate(result.crossings, 1):
        _mark(ax, number, c, label=reach is not None)
    ax.axhline(0.0, color="#888888", linewidth=0.7)
    ax.axvline(0.0, color="#888888", linewidth=0.7)
    ax.set(xlabel="real part", ylabel="imaginary part")
    ax.xaxis.set_major_locator(MaxNLocator(6))
    size = reach if reach is not None else float(np.nanquantile(np.abs(value), 0.98)) / 1.2
    if size > 0.0:
        ax.set_xlim(-1.25 * size, (0.35 if reach is not None else 1.25) * size)
        ax.set_ylim(-0.8 * size, 0.8 * size)


def _mark(ax: Axes, number: int, c: Crossing, *, label: bool) -> None:
    if not np.isfinite(c.real):
        return
    filled = COLOURS[2] if c.stable else "white"
    style: dict[str, Any] = {"color": COLOURS[2] if c.stable else "#444444", "markerfacecolor": filled}
    ax.plot(c.real, c.imag, "o", markersize=5.5, zorder=5, **style)
    if label:
        up = 7 if number % 2 else -14
        ax.annotate(
            str(number), (c.real, c.imag), xytext=(0, up), textcoords="offset points", fontsize=8.5, ha="center"
        )


def _table(ax: Axes, crossings: tuple[Crossing, ...]) -> None:
    """Write the crossings; filled circles in the plane are the stable ones."""
    rows = [_row(number, c) for number, c in enumerate(crossings[:_ROWS], 1)]
    if not rows:
        ax.text(0.0, 0.9, "no crossing of the negative real axis", fontsize=9.0)
        return
    table = ax.table(cellText=rows, colLabels=_COLUMNS, loc="upper left", cellLoc="right", edges="horizontal")
    table.auto_set_font_size(value=False)
    table.set_fontsize(8.5)
    table.auto_set_column_width(list(range(len(_COLUMNS))))
    table.scale(1.0, 1.15)
    if len(crossings) > _ROWS:
        ax.text(0.0, 0.0, f"… and {len(crossings) - _ROWS} more", fontsize=8.5)


def _row(number: int, c: Crossing) -> list[str]:
    stable = "" if c.stable is None else "yes" if c.stable else "no"
    amplitude = "" if c.amplitude is None else f"{c.amplitude:.4g}"
    place = f"{c.real:.4g}" if not c.imag else f"{c.real:.4g} {c.imag:+.4g}j"
    return [
        str(number), f"{c.frequency_hz:.5g}", place, f"{c.gain:.4g}", amplitude,
        f"{c.unstable_below} / {c.unstable_above}", stable,
    ]  # fmt: skip

"""Pictures that no result draws by itself."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from workbench.core.values.arrays import Floats
from workbench.show.figure import COLOURS, LEGEND, rows

__all__ = ["draw_loop", "draw_secants", "draw_steps", "titled"]


def titled(figure: Figure, title: str) -> Figure:
    """Return the figure under another title.

    Args:
        figure: any of the workbench's pictures.
        title: in place of its own.
    """
    if figure.get_suptitle():
        figure.suptitle(title, x=0.01, ha="left", fontsize=11.0, fontweight="bold")
    else:
        figure.axes[0].set_title("")
        figure.axes[0].set_title(title, loc="left", fontweight="bold", fontsize=11.0)
    return figure


def draw_secants(
    v: Floats,
    y: Floats,
    *,
    at: tuple[float, float],
    pieces: Sequence[tuple[str, float, float]],
    title: str,
    line: float | None = None,
) -> Figure:
    """Draw a static block with the slopes that were taken across pieces of it.

    Args:
        v: its input, shape (n,).
        y: its output, shape (n,).
        at: working point.
        pieces: name, total width and slope of each.
        title: of the picture.
        line: slope of a straight line through the origin to draw as well.
    """
    figure, (ax,) = rows(1, title=title)
    figure.set_size_inches(7.2, 4.4)
    order = np.argsort(v, kind="stable")
    ax.plot(v[order], y[order], color="#444444", linewidth=1.8, label="block")
    for number, (name, width, slope) in enumerate(pieces):
        ends = np.array([-0.5, 0.5]) * width
        # Central differences: the secant passes near the working point, not through it.
        middle = float(np.mean(np.interp(at[0] + ends, v[order], y[order])))
        text = f"{name}: {width:.4g} wide, slope {slope:.6g}"
        ax.plot(
            at[0] + ends, middle + slope * ends, "o-", color=COLOURS[number], linewidth=1.6, markersize=5, label=text
        )
    if line is not None:
        ax.plot(v[order], line * v[order], "--", color="#888888", linewidth=1.4, label=f"{line:.6g} × input")
    ax.plot(*at, "k*", markersize=10, label=f"working point {at[0]:.6g}")
    ax.set(xlabel="input of the block", ylabel="output of the block")
    ax.legend(**{**LEGEND, "loc": "best"})
    return figure


def draw_loop(u: Floats, y: Floats, *, gain: float, title: str) -> Figure:
    """Draw output over input, with a line through the origin.

    Args:
        u: input, shape (n,).
        y: output, shape (n,).
        gain: slope of the line.
        title: of the picture.
    """
    figure, (ax,) = rows(1, title=title)
    figure.set_size_inches(7.2, 4.4)
    ax.plot(u, y, color="#444444", linewidth=1.8, label="block")
    ends = np.array([u.min(), u.max()])
    ax.plot(ends, gain * ends, "--", color=COLOURS[0], linewidth=1.6, label=f"slope {gain:.6g}")
    ax.set(xlabel="input", ylabel="output")
    ax.legend(**{**LEGEND, "loc": "best"})
    return figure


def draw_steps(time: Floats, curves: Sequence[tuple[str, Floats]], *, title: str, ylabel: str) -> Figure:
    """Draw responses over time; the first is the reference.

    Args:
        time: shape (n,) [s].
        curves: name and values, shape (n,).
        title: of the picture.
        ylabel: of the values, with its unit.
    """
    figure, (ax,) = rows(1, title=title)
    figure.set_size_inches(7.2, 4.0)
    ax.plot(time, curves[0][1], color="#222222", linewidth=2.0, label=curves[0][0])
    for number, (name, values) in enumerate(curves[1:]):
        ax.plot(time, values, "--", color=COLOURS[number], linewidth=1.6, label=name)
    ax.set(xlabel="time [s]", ylabel=ylabel)
    ax.legend(**{**LEGEND, "loc": "best"})
    return figure

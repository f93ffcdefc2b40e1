"""Pictures of requirements: a response between masks, a step with its limits, a record over its baseline."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from workbench.core.values.arrays import Floats
from workbench.core.values.response import Response
from workbench.show.bode import Degrees, draw_response, plain_decades
from workbench.show.figure import COLOURS, rows
from workbench.show.tables import bracketed
from workbench.study.requirements.deviation import Deviation

__all__ = ["LIMIT", "plot_baseline", "plot_between_masks", "plot_step"]

LIMIT = "limit"

_FORBIDDEN = "#b3261e"
_MARKED: dict[str, Any] = {
    "marker": "s", "linestyle": "", "color": _FORBIDDEN, "markerfacecolor": "none", "markersize": 9,
    "markeredgewidth": 1.6,
}  # fmt: skip
_Line = tuple[Sequence[float], Sequence[float]]


def plot_between_masks(
    curves: Mapping[str, _Line],
    *,
    title: str,
    quantity: str,
    unit: str | None,
    upper: Sequence[Sequence[float]] = (),
    lower: Sequence[Sequence[float]] = (),
    worst: tuple[float, float] | None = None,
) -> Figure:
    """Draw frequency responses and the masks they must keep; what is forbidden is shaded.

    Args:
        curves: label → (frequencies [Hz], values).
        title: above the picture.
        quantity: what the values are.
        unit: of the values.
        upper: corners (frequency [Hz], value) of the mask.
        lower: likewise.
        worst: (frequency [Hz], value) with the least margin.
    """
    figure, (ax,) = rows(1, title=title)
    figure.set_size_inches(7.2, 4.0)
    for i, (name, (frequency, values)) in enumerate(curves.items()):
        ax.plot(
            frequency, values, "-", marker=_marker(frequency), color=COLOURS[i % len(COLOURS)], linewidth=1.4,
            markersize=3.5, markerfacecolor="white", label=name or "response",
        )  # fmt: skip
    plain_decades(ax)
    _masks(ax, upper, lower)
    if worst is not None:
        ax.plot(*worst, label="least margin", **_MARKED)
    ax.set_xlabel("frequency [Hz]")
    ax.set_ylabel(bracketed(quantity, unit))
    if unit == "deg":
        ax.yaxis.set_major_locator(Degrees())
    ax.xaxis.set_minor_formatter(FuncFormatter(_minor))
    ax.tick_params(axis="x", which="minor", labelsize=7.5, colors="#777777")
    _legend(figure, ax)
    return figure


_FEW = 80  # measured points are marked; a computed curve has more


def _minor(x: float, _position: int) -> str:
    """Label 2 and 5 of each decade."""
    return f"{x:g}" if f"{x:e}"[0] in "25" else ""


def _masks(ax: Axes, upper: Sequence[Sequence[float]], lower: Sequence[Sequence[float]]) -> None:
    """Draw masks and shade what lies beyond; the picture keeps some space there."""
    drawn = [float(y) for line in ax.lines for y in np.asarray(line.get_ydata(), dtype=np.float64)]
    every = [c[1] for c in (*upper, *lower)] + drawn
    room = 0.12 * (max(every) - min(every) or 1.0)
    top, bottom = max(every) + room, min(every) - room
    for name, corners, edge in (("upper mask", upper, top), ("lower mask", lower, bottom)):
        if not corners:
            continue
        x, y = [c[0] for c in corners], [c[1] for c in corners]
        ax.plot(
            x, y, "-", color=_FORBIDDEN, linewidth=1.6, label="limits" if name == "upper mask" or not upper else "_"
        )
        text = "not allowed" if name == "upper mask" or not upper else "_"
        ax.fill_between(x, y, edge, color="#b3261e14", linewidth=0.0, label=text)
    ax.set_ylim(bottom, top)


def plot_step(
    time: Sequence[float],
    values: Sequence[float],
    *,
    title: str,
    name: str,
    unit: str | None,
    final: float,
    band: tuple[str, float] | None = None,
    highest: float | None = None,
    times: Mapping[str, float] | None = None,
    violated: tuple[float, float] | None = None,
) -> Figure:
    """Draw a time history with its final value and its limit; where it breaks the limit is marked.

    Args:
        time: [s].
        values: of the signal.
        title: above the picture.
        name: of the signal.
        unit: of the signal.
        final: value to which it tends.
        band: label and half width of the band around it in which it is settled.
        highest: level of the limit.
        times: label → instant [s]; `LIMIT` is drawn as one.
        violated: instant [s] and value that break the limit.
    """
    figure, (ax,) = rows(1, title=title)
    figure.set_size_inches(7.2, 3.6)
    ax.plot(time, values, "-", color=COLOURS[0], linewidth=1.5, label=name)
    ax.axhline(final, color="#444444", linewidth=1.0, linestyle="-.", label="final value")
    if band is not None:
        ax.axhspan(final - band[1], final + band[1], color="#44444422", linewidth=0.0, label=band[0])
    if highest is not None:
        ax.axhline(highest, color=_FORBIDDEN, linewidth=1.2, linestyle="--", label=LIMIT)
    for text, instant in (times or {}).items():
        limit = text == LIMIT
        style = "--" if limit else ":"
        ax.axvline(instant, color=_FORBIDDEN if limit else "#444444", linewidth=1.2, linestyle=style, label=text)
    if violated is not None:
        ax.plot(*violated, label="limit violated", **_MARKED)
    ax.set_xlabel("time [s]")
    ax.set_ylabel(bracketed(name, unit))
    _legend(figure, ax)
    return figure


def plot_baseline(deviation: Deviation, *, title: str) -> Figure:
    """Draw what was measured over its baseline, and below how far they are apart; the worst place is marked.

    Args:
        deviation: curves over time or frequency.
        title: above the picture.
    """
    response = deviation.theirs.along == "Hz"
    figure, axes = rows(3 if response else 2, title=title, height=1.8)
    styles = ((deviation.theirs, "baseline", COLOURS[6], "-", 2.6), (deviation.mine, "now", COLOURS[1], "--", 1.3))
    for curve, label, colour, line, width in styles:
        style: dict[str, Any] = {"color": colour, "linestyle": line, "linewidth": width, "label": label}
        if response:
            style |= {"marker": _marker(curve.at), "markersize": 3.0}
            draw_response(axes[0], axes[1], Response(curve.at, curve.value.astype(np.complex128)), **style)
        else:
            axes[0].plot(curve.at, curve.value, **style)
    _error_bars(axes[-1], deviation)
    worst = float(deviation.at[deviation.worst])
    for ax in axes:
        ax.axvline(worst, color=_FORBIDDEN, linewidth=1.2, linestyle=":", label="worst place")
    _name_axes(deviation, axes)
    shown = dict(zip(*reversed(axes[0].get_legend_handles_labels()), strict=True))
    shown |= dict(zip(*reversed(axes[-1].get_legend_handles_labels()), strict=True))
    figure.legend(shown.values(), shown, loc="outside lower center", ncols=len(shown), frameon=False, fontsize=8.5)
    return figure


def _marker(places: Sequence[float] | Floats) -> str:
    return "o" if len(places) < _FEW else ""


def _error_bars(ax: Axes, deviation: Deviation) -> None:
    ratio = np.where(np.isfinite(deviation.ratio), deviation.ratio, np.nan)
    ax.plot(deviation.at, ratio, "-", color=COLOURS[0], linewidth=1.2, marker=_marker(deviation.at), markersize=3.0)
    ax.axhline(1.0, color=_FORBIDDEN, linewidth=1.1, linestyle="--", label="allowed")
    ax.set_ylim(bottom=0.0)
    ax.set_ylabel("error bars apart")


def _name_axes(deviation: Deviation, axes: Sequence[Axes]) -> None:
    unit = deviation.theirs.unit
    if deviation.theirs.along == "s":
        axes[0].set_ylabel(bracketed(deviation.theirs.name, unit))
        axes[-1].set_xlabel("time [s]")
        return
    axes[0].set_ylabel(f"gain [dB{f' re 1 {unit}' if unit not in (None, '1') else ''}]")
    axes[1].set_ylabel("phase [deg]")
    axes[1].yaxis.set_major_locator(Degrees())
    plain_decades(axes[-1])
    axes[-1].set_xlabel("frequency [Hz]")


def _legend(figure: Figure, ax: Axes) -> None:
    """Below the picture, where it hides nothing."""
    handles, texts = ax.get_legend_handles_labels()
    figure.legend(handles, texts, loc="outside lower center", ncols=min(4, len(texts)), frameon=False, fontsize=8.5)

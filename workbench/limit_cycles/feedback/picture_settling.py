"""Pictures of settling times over the gain."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.polynomial import Polynomial

from workbench.show.figure import COLOURS, LEGEND, panels

if TYPE_CHECKING:
    from workbench.limit_cycles.feedback.result import Optimum, SettlingStudy

__all__ = ["draw_settling", "plot_settling"]


def plot_settling(study: SettlingStudy) -> Figure:
    """Draw settling times with their polynomials, the optimum over the threshold, and the motions as they decay.

    Args:
        study: what was measured.
    """
    title = f"settling of {study.variable} after the feedback closes"
    figure, ((times, optima), (decay, efforts)) = panels(2, 2, title=title, width=11.0, height=3.5)
    draw_settling(times, study)
    _optima(optima, study)
    _decay(decay, study)
    _efforts(efforts, study)
    return figure


def draw_settling(ax: Axes, study: SettlingStudy) -> None:
    """Draw the settling times of the chosen threshold, and those of the smallest, with their polynomials.

    Args:
        ax: where.
        study: what was measured.
    """
    chosen = [study.best]
    fitted = [o for o in study.optima if o.gain is not None]
    if fitted and fitted[-1] is not study.best:
        chosen.append(fitted[-1])
    for optimum, colour in zip(chosen, COLOURS, strict=False):
        _times(ax, study, optimum, colour)
    ax.set_ylim(bottom=0.0)
    ax.set(xlabel="gain g", ylabel="settling time [s]")
    ax.legend(**{**LEGEND, "loc": "best"})


def _times(ax: Axes, study: SettlingStudy, optimum: Optimum, colour: str) -> None:
    found = [(r.gain, t) for r in study.runs if (t := r.settled[optimum.threshold]) is not None]
    if not found:
        return
    g, t = np.array(found).T
    ax.plot(g, t, "o", color=colour, markersize=5.0, label=f"to {_percent(optimum.threshold)}")
    if optimum.gain is None or optimum.seconds is None:
        return
    x = np.linspace(g[0], g[-1], 300)
    ax.plot(x, Polynomial(optimum.coefficients)(x), color=colour, linewidth=1.2)
    ax.plot(optimum.gain, optimum.seconds, "*", color=colour, markersize=12.0, markeredgecolor="black", zorder=5)
    where = f"{optimum.gain:.3f}" + (" (end)" if optimum.at_end else "")
    side = "left" if optimum.gain < 0.5 * (study.gains[0] + study.gains[-1]) else "right"
    ax.annotate(
        where, (optimum.gain, optimum.seconds), xytext=(4 if side == "left" else -4, -14), textcoords="offset points",
        fontsize=8.5, ha=side,
    )  # fmt: skip


def _percent(part: float) -> str:
    return f"{100.0 * part:.3g} %"


def _optima(ax: Axes, study: SettlingStudy) -> None:
    """Draw how the best gain moves with the threshold."""
    found = [o for o in study.optima if o.gain is not None]
    best = [o.gain for o in found if o.gain is not None]
    for o, gain in zip(found, best, strict=True):
        fill = "white" if o.at_end else COLOURS[0]
        ax.plot(100.0 * o.threshold, gain, "o", color=COLOURS[0], markerfacecolor=fill, markersize=6.5)
    ax.plot([100.0 * o.threshold for o in found], best, color=COLOURS[0], linewidth=1.0, zorder=1)
    quick = [(100.0 * o.threshold, o.fastest_gain) for o in study.optima if o.fastest_gain is not None]
    ax.plot([x for x, _ in quick], [g for _, g in quick], "x", color=COLOURS[1], markersize=6.0)
    handles = [
        Line2D([], [], marker="o", color=COLOURS[0], label="minimum of the polynomial"),
        Line2D(
            [], [], marker="o", color=COLOURS[0], markerfacecolor="white", linestyle="", label="… at the end measured"
        ),
        Line2D([], [], marker="x", color=COLOURS[1], linestyle="", label="fastest measured"),
    ]
    ax.set_xscale("log")
    ax.margins(y=0.25)
    ax.set(xlabel="threshold [% of the motion before]", ylabel="best gain g")
    ax.legend(handles=handles, **{**LEGEND, "loc": "best"})


def _decay(ax: Axes, study: SettlingStudy) -> None:
    """Draw the mean magnitude over a cycle of every run."""
    limits = Normalize(study.gains[0], study.gains[-1] if len(study.gains) > 1 else study.gains[0] + 1.0)
    shades = colormaps["viridis"]
    for number, r in enumerate(study.runs):
        name = f"g = {r.gain:.3g}" if number in {0, len(study.runs) // 2, len(study.runs) - 1} else None
        ax.plot(r.time, 100.0 * r.magnitude, color=shades(limits(r.gain)), linewidth=1.2, label=name)
    ax.axhline(100.0 * study.settings.threshold, color="#444444", linewidth=0.9, linestyle="--")
    ax.set_yscale("log")
    ax.set_ylim(50.0 * study.settings.every[-1], 300.0)
    ax.set(xlabel="time after closing [s]", ylabel="mean magnitude [% of before]")
    ax.legend(**{**LEGEND, "loc": "upper right"})


def _efforts(ax: Axes, study: SettlingStudy) -> None:
    """Draw the largest deflection and rate over the gain, with the limits."""
    scale, unit = (180.0 / np.pi, "deg") if study.target_unit == "rad" else (1.0, study.target_unit or "")
    runs = [r for r in study.runs if r.left < 1.0]
    g = [r.gain for r in runs]
    ax.plot(g, [scale * r.peak_deflection for r in runs], "o-", color=COLOURS[0], markersize=4.0, label="deflection")
    ax.set_xlabel("gain g")
    ax.set_ylabel(f"peak deflection [{unit}]" if unit else "peak deflection", color=COLOURS[0])
    ax.set_ylim(bottom=0.0)
    other = ax.twinx()
    other.plot(g, [scale * r.peak_rate for r in runs], "s-", color=COLOURS[1], markersize=4.0, label="rate")
    other.set_ylabel(f"peak rate [{unit}/s]" if unit else "peak rate [1/s]", color=COLOURS[1])
    other.set_ylim(bottom=0.0)
    actuator = study.actuator
    words = []
    if actuator is not None and actuator.limit is not None:
        words.append(f"limit {scale * actuator.limit:.4g} {unit}")
    if actuator is not None and actuator.rate_limit is not None:
        other.axhline(scale * actuator.rate_limit, color=COLOURS[1], linewidth=0.9, linestyle="--")
        words.append(f"rate limit {scale * actuator.rate_limit:.4g} {unit}/s")
    if len(runs) < len(study.runs):
        words.append(f"{len(study.runs) - len(runs)} gains with growing motion left out")
    ax.set_title(f"handed to {study.target}" + (f"; {', '.join(words)}" if words else ""), loc="left", fontsize=9.0)

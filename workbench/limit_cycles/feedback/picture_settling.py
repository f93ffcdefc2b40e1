"""Pictures of settling times over the gain."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.polynomial import Polynomial

from workbench.show.figure import COLOURS, LEGEND, panels

if TYPE_CHECKING:
    from workbench.limit_cycles.feedback.result import SettlingStudy

__all__ = ["draw_settling", "plot_settling"]


def plot_settling(study: SettlingStudy) -> Figure:
    """Draw settling times with their polynomial, and the motions as they decay.

    Args:
        study: what was measured.
    """
    title = f"settling of {study.variable} after the feedback closes"
    figure, ((times, decay, efforts),) = panels(1, 3, title=title, width=13.0, height=3.5)
    draw_settling(times, study)
    _decay(decay, study)
    _efforts(efforts, study)
    return figure


def draw_settling(ax: Axes, study: SettlingStudy) -> None:
    """Draw the settling times with their polynomial.

    Args:
        ax: where.
        study: what was measured.
    """
    g = np.array([r.gain for r in study.settled])
    t = np.array([r.settling_seconds for r in study.settled])
    ax.plot(g, t, "o", color=COLOURS[0], markersize=5.0, label=f"to {100.0 * study.threshold:.3g} %")
    if study.optimum is not None and study.optimum_seconds is not None:
        x = np.linspace(g[0], g[-1], 300)
        ax.plot(x, Polynomial(study.coefficients)(x), color=COLOURS[0], linewidth=1.2)
        at = (study.optimum, study.optimum_seconds)
        ax.plot(*at, "*", color=COLOURS[0], markersize=12.0, markeredgecolor="black", zorder=5)
        side, shift = ("left", 4) if study.optimum < 0.5 * (study.gains[0] + study.gains[-1]) else ("right", -4)
        words = f"{study.optimum:.3f}" + (" (end)" if study.optimum_at_end else "")
        ax.annotate(words, at, xytext=(shift, -14), textcoords="offset points", fontsize=8.5, ha=side)
    ax.set_ylim(bottom=0.0)
    ax.set(xlabel="gain g", ylabel="settling time [s]")
    ax.legend(**{**LEGEND, "loc": "best"})


def _decay(ax: Axes, study: SettlingStudy) -> None:
    """Draw the mean magnitude over a cycle of every run."""
    limits = Normalize(study.gains[0], study.gains[-1] if len(study.gains) > 1 else study.gains[0] + 1.0)
    shades = colormaps["viridis"]
    for number, r in enumerate(study.runs):
        name = f"g = {r.gain:.3g}" if number in {0, len(study.runs) // 2, len(study.runs) - 1} else None
        ax.plot(r.time, 100.0 * r.magnitude, color=shades(limits(r.gain)), linewidth=1.2, label=name)
    ax.axhline(100.0 * study.threshold, color="#444444", linewidth=0.9, linestyle="--")
    ax.set_yscale("log")
    ax.set_ylim(50.0 * study.threshold, 300.0)
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

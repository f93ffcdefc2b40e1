"""Pictures of simulations in which a feedback closes: one, and settling times over the gain."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.polynomial import Polynomial

from workbench.limit_cycles.feedback.closing_run import HANDED
from workbench.show.figure import COLOURS, LEGEND, panels

if TYPE_CHECKING:
    from workbench.core.values.arrays import Floats
    from workbench.limit_cycles.feedback.closing_run import FeedbackRun
    from workbench.limit_cycles.feedback.settling import SettlingStudy

__all__ = ["draw_settling", "plot_feedback_run", "plot_settling"]


def plot_feedback_run(run: FeedbackRun) -> Figure:
    """Draw the motion, what the feedback does and its rate with their limits, and the moment of closing.

    Left: all of the time; right: from two cycles before to twelve cycles after closing.

    Args:
        run: what was simulated.
    """
    rows = _rows(run)
    title = f"{run.model}: {run.source} fed back to {run.target} with gain {run.gain:g} from {run.closes_at:.4g} s on"
    figure, grid = panels(len(rows), 2, title=title, width=12.0, height=1.9, sharex="col")
    period = 1.0 / run.frequency_hz
    for (whole, near), (unit, curves, limit) in zip(grid, rows, strict=True):
        for ax in (whole, near):
            _draw(ax, run, unit, curves, limit)
        near.set_ylabel("")
        _close_up(near, run, unit, curves, limit)
        near.set_xlim(run.closes_at - 2.0 * period, run.closes_at + 12.0 * period)
        whole.set_xlim(run.time[0], run.time[-1])
        if limit is not None:
            whole.set_ylim(-1.15 * _degrees(unit)[0] * limit, 2.3 * _degrees(unit)[0] * limit)  # room for the legend
        whole.legend(**{**LEGEND, "loc": "upper right"}, ncols=2)
    for ax in grid[-1]:
        ax.set_xlabel("time [s]")
    return figure


_Curves = list[tuple[str, "Floats"]]


def _rows(run: FeedbackRun) -> list[tuple[str | None, _Curves, float | None]]:
    """Return unit, curves and limit of each row of panels."""
    motion = list(dict.fromkeys([run.source, run.watch]))
    unit = run.units.get(HANDED)
    rate_unit = f"{unit}/s" if unit else None
    rest = [n for n in run.signals if n not in motion and n != HANDED]
    like = [n for n in rest if unit and run.units.get(n) == unit]
    fast = [n for n in rest if rate_unit and run.units.get(n) == rate_unit]
    rows: list[tuple[str | None, _Curves, float | None]] = [
        (run.units.get(n), [(n, run.signals[n])], None) for n in motion
    ]
    handed: _Curves = [(f"feedback to {run.target}", run.signals[HANDED])]
    rows.append((unit, handed + [(n, run.signals[n]) for n in like], run.limit))
    speed: _Curves = [("its rate", np.gradient(run.signals[HANDED], run.time))]
    rows.append((rate_unit, speed + [(n, run.signals[n]) for n in fast], run.rate_limit))
    rows += [(run.units.get(n), [(n, run.signals[n])], None) for n in rest if n not in (*like, *fast)]
    return rows


def _draw(
    ax: Axes, run: FeedbackRun, unit: str | None, curves: Sequence[tuple[str, Floats]], limit: float | None
) -> None:
    scale, shown = _degrees(unit)
    for (name, values), colour in zip(curves, COLOURS, strict=False):
        ax.plot(run.time, scale * values, color=colour, linewidth=0.9, label=name)
    ax.axvline(run.closes_at, color="#444444", linewidth=0.8, linestyle=(0, (4, 3)))
    if limit is not None:
        for sign in (-1.0, 1.0):
            ax.axhline(sign * scale * limit, color=COLOURS[3], linewidth=1.2, linestyle="--",
                       label=f"limit ±{scale * limit:.4g} {shown}" if sign > 0.0 else None)  # fmt: skip
    ax.set_ylabel(f"[{shown}]" if shown else "")


def _close_up(
    ax: Axes, run: FeedbackRun, unit: str | None, curves: Sequence[tuple[str, Floats]], limit: float | None
) -> None:
    """Show the curves in full height; a limit far beyond them is told in words."""
    scale, shown = _degrees(unit)
    seen = np.abs(run.time - run.closes_at) < 12.0 / run.frequency_hz
    size = 1.15 * max(float(np.abs(scale * v[seen]).max()) for _, v in curves)
    if limit is not None and scale * limit > 1.4 * size:
        ax.text(0.99, 0.95, f"limit ±{scale * limit:.4g} {shown} beyond the picture", transform=ax.transAxes,
                fontsize=8.0, ha="right", va="top", color=COLOURS[3])  # fmt: skip
    elif limit is not None:
        size = max(size, 1.1 * scale * limit)
    if size > 0.0:
        ax.set_ylim(-size, size)


def _degrees(unit: str | None) -> tuple[float, str]:
    """Return the factor and the unit in which angles are drawn."""
    if unit in ("rad", "rad/s"):
        return 180.0 / np.pi, unit.replace("rad", "deg")
    return 1.0, unit or ""


def plot_settling(study: SettlingStudy) -> Figure:
    """Draw settling times with their polynomial, and the motions as they decay.

    Args:
        study: what was measured.
    """
    title = f"settling of {study.variable} after the feedback closes"
    figure, ((times, decay),) = panels(1, 2, title=title, width=9.0, height=3.5)
    draw_settling(times, study)
    _decay(decay, study)
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

"""Pictures of a health card: verdicts, convergence over the communication step, memory over the sessions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from workbench.health.check.registry import CHECKS
from workbench.health.check.result import HealthCard, HealthLine
from workbench.show.figure import ABOVE, COLOURS, LEGEND, panels

__all__ = ["plot_check"]

# Colour and sign of each verdict; the sign is for those who see no colours.
_LOOKS = {
    "good": ("#1a7f4b", "o", "good"),
    "watch": ("#E69F00", "^", "watch"),
    "broken": ("#b3261e", "X", "broken"),
    "not applicable": ("#bbbbbb", ".", "not applicable"),
}
_MB = 1e6
_SINGLE = 3  # columns of one FMU: the file and two interfaces


def plot_check(card: HealthCard) -> Figure:
    """Draw a health card: all verdicts; of the co-simulation the change with the step; memory over sessions.

    Args:
        card: what to draw.
    """
    steps = [c for c in card.checks if c.name == "step" and c.numbers.get("changes")]
    memories = [c for c in card.checks if c.name == "memory" and c.numbers.get("resident_bytes")]
    draws = [(_verdicts, list(card.checks)), (_steps, steps), (_memory, memories)]
    used = [(draw, lines) for draw, lines in draws if lines]
    columns = len({(c.component, c.interface) for c in card.checks})
    names = list(dict.fromkeys(c.name for c in card.checks))
    height = max(3.4, 0.9 + 0.24 * len(names))
    shape = (1, len(used)) if columns <= _SINGLE else (len(used), 1)  # a system has a column for each interface
    width = 4.0 * len(used) if columns <= _SINGLE else max(8.0, 0.6 * columns)
    figure, grid = panels(*shape, title=f"Health card of {card.model}", width=width, height=height)
    axes = [ax for row in grid for ax in row]
    for ax, (draw, lines) in zip(axes, used, strict=True):
        draw(ax, lines)
    return figure


def _verdicts(ax: Axes, lines: Sequence[HealthLine]) -> None:
    """One sign for each check and interface."""
    names = [n for n in CHECKS if any(c.name == n for c in lines)]
    columns = list(dict.fromkeys(_where(c) for c in lines))
    for verdict, (colour, sign, words) in _LOOKS.items():
        chosen = [c for c in lines if c.verdict == verdict]
        x, y = [columns.index(_where(c)) for c in chosen], [names.index(c.name) for c in chosen]
        if chosen:
            ax.plot(x, y, sign, color=colour, markersize=9, linestyle="", label=f"{words} ({len(chosen)})")
    ax.set_yticks(range(len(names)), names)
    turned: dict[str, Any] = (
        {"rotation": 40, "ha": "right", "rotation_mode": "anchor"} if len(columns) > _SINGLE else {}
    )
    ax.set_xticks(range(len(columns)), columns, **turned)
    ax.set(xlim=(-0.6, len(columns) - 0.4), ylim=(len(names) - 0.4, -0.6))
    ax.legend(**{**ABOVE, "ncols": 4 if len(columns) > _SINGLE else 2})


def _where(line: HealthLine) -> str:
    return " ".join(filter(None, (line.component, line.interface)))


def _steps(ax: Axes, lines: Sequence[HealthLine]) -> None:
    """Change from each step to half of it, with the slopes of first and second order."""
    for k, line in enumerate(lines):
        colour = COLOURS[k % len(COLOURS)]
        steps = np.array(line.numbers["steps"][:-1], dtype=float)
        changes = np.array([np.nan if c is None else c for c in line.numbers["changes"]], dtype=float)
        changes[changes <= 0.0] = np.nan
        order, error = line.numbers["order"], line.numbers["error"]
        words = "fails" if error is None else f"error {100.0 * error:.2g} %"
        words += "" if order is None or line.verdict == "good" else f", order {order:.2f}"
        ax.plot(steps, changes, "o-", color=colour, markersize=5, label=f"{_where(line)}: {words}")
        ax.axvline(line.numbers["step"], color=colour, linestyle=":", linewidth=1.2)
    _slopes(ax)
    ax.set(xscale="log", yscale="log", xlabel="communication step [s]", ylabel="change with half the step / range")
    _widen(ax)
    ax.set_title("dotted: the natural step", loc="left", fontsize=9.5)
    ax.legend(**{**LEGEND, "loc": "best"})


def _widen(ax: Axes) -> None:
    """Show one decade of steps and two of changes at least, so that rounding does not look like a slope."""
    (left, right), (low, high) = ax.get_xlim(), ax.get_ylim()
    ax.set_xlim(min(left, right / 12.0), right)
    if low > 0.0:
        middle = float(np.sqrt(low * high))
        ax.set_ylim(min(low, middle / 12.0), max(high, middle * 12.0))
    else:
        ax.set_ylim(1e-15, 1.0)
        ax.text(0.5, 0.5, "nothing changes", transform=ax.transAxes, ha="center", color="#666666")
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_minor_formatter(NullFormatter())


def _slopes(ax: Axes) -> None:
    """Lines of first and second order through the uppermost point."""
    curves = [np.array(curve.get_data(), dtype=float) for curve in ax.get_lines()]
    points = np.hstack([c for c in curves if c.shape[1] > 2] or [np.empty((2, 0))])
    points = points[:, points[1] > 0.0]
    if not points.size:
        return
    h, change = points[:, points[1].argmax()]
    least = float(points[0].min())
    for order, style in ((1, "--"), (2, "-.")):
        ends = np.array([least, h])
        ax.plot(ends, change * (ends / h) ** order, style, color="#888888", linewidth=1.0, label=f"order {order}")


def _memory(ax: Axes, lines: Sequence[HealthLine]) -> None:
    """Growth of the resident memory since the caches were full."""
    for k, line in enumerate(lines):
        size = np.array(line.numbers["resident_bytes"]) / _MB
        words = f"{_where(line)}: {line.numbers['bytes_per_session'] / 1e3:.3g} kB per session"
        ax.plot(line.numbers["sessions"], size - size[0], ".-", color=COLOURS[k % len(COLOURS)], label=words)
    low, high = ax.get_ylim()
    if high - low < 1.0:  # what is smaller is the allocator's
        ax.set_ylim(min(low, -0.2), max(high, low + 1.0))
    ax.set(xlabel="sessions opened and closed", ylabel="growth of resident memory [MB]")
    ax.legend(**{**LEGEND, "loc": "best"})

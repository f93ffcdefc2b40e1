"""Pictures of limit cycles."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from workbench.plotting.branch import draw_branch
from workbench.plotting.figure import COLOURS, label, save
from workbench.plotting.nyquist import draw_plane
from workbench.plotting.panels import LEGEND, panels

if TYPE_CHECKING:
    from workbench.analysis.limit_cycle.result import LimitCycleResult

__all__ = ["plot_limit_cycle"]

_SHOWN = 6  # periods of the simulation
_CURVES = 4
_MARKS = {"describing function": "o", "harmonic balance": "s", "shooting": "D", "simulation": "x"}


def plot_limit_cycle(result: LimitCycleResult, path: str | Path | None = None) -> Figure:
    """Draw the Nyquist curve around the crossings, frequency and amplitude by every method, and the simulated motion.

    Args:
        result: of the analysis.
        path: also write the picture here; png, svg or pdf by suffix.

    Raises:
        InputError: unknown suffix, file cannot be written.
    """
    title = f"{result.model}: limit cycles of the loop through {result.block}"
    figure, ((plane, methods), (motion, outputs)) = panels(2, 2, title=title, width=10.0, height=3.2)
    draw_plane(plane, result.nyquist, reach=_reach(result))
    plane.legend(**{**LEGEND, "loc": "best"})
    _methods(methods, result)
    _motion(motion, result, [result.input])
    if result.branches:
        _branches(outputs, result)
        if path is not None:
            save(figure, path)
        return figure
    others = [n for n in (result.simulated.amplitude if result.simulated else ()) if n != result.input]
    if others:
        _motion(outputs, result, others[:_CURVES])
    else:
        outputs.axis("off")
    if path is not None:
        save(figure, path)
    return figure


def _branches(ax: Axes, result: LimitCycleResult) -> None:
    """Draw the amplitude over the first parameter."""
    name = result.branches[0].parameter
    for branch in result.branches:
        if branch.parameter == name and branch.points:
            draw_branch(ax, branch, lambda p: p.amplitude)
    ax.set(xlabel=name, ylabel=label(f"amplitude of {result.input}", result.input_unit))
    ax.legend(**{**LEGEND, "loc": "best"})


def _reach(result: LimitCycleResult) -> float | None:
    """Return the size of the farthest crossing that a limit cycle belongs to, else of any."""
    used = [c for c in result.crossings if c.amplitude is not None] or list(result.crossings)
    sizes = [abs(complex(c.real, c.imag)) for c in used if np.isfinite(c.real)]
    return max(sizes) if sizes else None


def _methods(ax: Axes, result: LimitCycleResult) -> None:
    """Mark frequency and amplitude of each cycle by each method; hollow marks are unstable."""
    seen: set[str] = set()
    for c in result.limit_cycles:
        colour = COLOURS[c.crossing % len(COLOURS)]
        fill = colour if c.stable else "none"
        style: dict[str, Any] = {"color": colour, "markerfacecolor": fill, "markersize": 6.5, "linestyle": ""}
        ax.plot(c.frequency_hz, c.fundamental, _MARKS[c.method], **style)
        seen.add(c.method)
    for name in [m for m in _MARKS if m in seen]:
        ax.plot([], [], _MARKS[name], color="#444444", markerfacecolor="none", linestyle="", label=name)
    ax.set(xlabel="frequency [Hz]", ylabel=label(f"fundamental of {result.input}", result.input_unit))
    ax.margins(0.25)
    ax.ticklabel_format(useOffset=False)
    if seen:
        ax.legend(**{**LEGEND, "loc": "best"})
    else:
        ax.text(0.5, 0.5, "no limit cycle", transform=ax.transAxes, ha="center", color="#666666")


def _motion(ax: Axes, result: LimitCycleResult, names: list[str]) -> None:
    """Draw the last periods of the simulation."""
    cycle = result.simulated
    ax.set_xlabel("time [s]")
    if cycle is None:
        ax.text(0.5, 0.5, "nothing simulated", transform=ax.transAxes, ha="center", color="#666666")
        return
    shown = cycle.time >= cycle.time[-1] - _SHOWN / cycle.frequency_hz
    for number, name in enumerate(names):
        ax.plot(
            cycle.time[shown], cycle.values[name][shown], color=COLOURS[number % len(COLOURS)], linewidth=1.3,
            label=label(name, cycle.units.get(name)),
        )  # fmt: skip
    if len(names) > 1:
        ax.legend(**{**LEGEND, "loc": "best"})
    else:
        ax.set_ylabel(label(names[0], cycle.units.get(names[0])))
    ax.set_title(f"simulated: {cycle.frequency_hz:.5g} Hz", loc="left")

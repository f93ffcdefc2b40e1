"""Pictures of time histories."""

from __future__ import annotations

from typing import TYPE_CHECKING

from matplotlib.figure import Figure

from workbench.show.figure import COLOURS, rows
from workbench.show.tables import bracketed

if TYPE_CHECKING:
    from workbench.response.simulate.result import SimulationResult

__all__ = ["time_history"]


def time_history(result: SimulationResult) -> Figure:
    """Return a figure with one panel per signal over time [s]; events show as vertical jumps.

    Args:
        result: what is drawn.
    """
    names = list(result.signals)
    figure, axes = rows(max(1, len(names)), title=f"{result.model} ({result.interface}, {result.solver})", height=1.9)
    for ax, name in zip(axes, names, strict=False):
        ax.plot(result.time, result.signals[name], color=COLOURS[0], linewidth=1.3)
        ax.set_ylabel(bracketed(name, result.units.get(name)))
    axes[-1].set_xlabel("time [s]")
    figure.align_ylabels(axes)
    return figure

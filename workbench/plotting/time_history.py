"""Pictures of time histories."""

from __future__ import annotations

from typing import TYPE_CHECKING

from matplotlib.figure import Figure

if TYPE_CHECKING:
    from workbench.analysis.simulate.result import SimulationResult

__all__ = ["time_history"]


def time_history(result: SimulationResult) -> Figure:
    """Return a figure with one panel per signal over time [s]; events show as vertical jumps.

    Args:
        result: what is drawn.
    """
    names = list(result.signals)
    figure = Figure(figsize=(8.0, 1.2 + 1.9 * max(1, len(names))), layout="constrained")
    grid = figure.subplots(max(1, len(names)), 1, sharex=True, squeeze=False)
    panels = grid[:, 0]
    for axes, name in zip(panels, names, strict=False):
        unit = result.units.get(name)
        axes.plot(result.time, result.signals[name], linewidth=1.2)
        axes.set_ylabel(f"{name} [{unit}]" if unit else name)
        axes.grid(visible=True, alpha=0.3)
    panels[-1].set_xlabel("time [s]")
    panels[0].set_title(f"{result.model} ({result.interface}, {result.solver})")
    return figure

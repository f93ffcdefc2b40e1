"""Picture of a trim: what is left of each equation."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from workbench.plotting.figure import COLOURS

if TYPE_CHECKING:
    from workbench.analysis.trim.result import TrimResult

__all__ = ["plot_residuals"]

_SMALLEST = 1e-18


def plot_residuals(result: TrimResult) -> Figure:
    """Draw the magnitude of each scaled residual as a bar, floating derivatives in another colour.

    Args:
        result: what to draw.
    """
    names = [r.name for r in result.residuals]
    figure = Figure(figsize=(7.0, 1.2 + 0.28 * max(len(names), 3)), layout="constrained")
    ax = figure.add_subplot()
    sizes = [max(abs(r.scaled), _SMALLEST) if np.isfinite(r.scaled) else 1.0 for r in result.residuals]
    colours = [COLOURS[0 if r.required else 1] for r in result.residuals]
    ax.barh(range(len(names)), sizes, color=colours, left=0.1 * _SMALLEST)
    ax.set_yticks(range(len(names)), names)
    ax.invert_yaxis()
    ax.set_xscale("log")
    ax.set_xlim(0.1 * _SMALLEST, max([1.0, *sizes]) * 3.0)
    ax.set_xlabel("residual over the change for one nominal value of each unknown")
    ax.set_title(f"{result.model}: {'in equilibrium' if result.converged else 'no equilibrium found'}", loc="left")
    ax.grid(visible=True, axis="x", alpha=0.3)
    return figure

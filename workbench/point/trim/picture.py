"""Picture of a trim: what is left of each equation."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from workbench.show.figure import COLOURS, LEGEND, rows

if TYPE_CHECKING:
    from workbench.point.trim.result import TrimResult

__all__ = ["plot_residuals"]

_SMALLEST = 1e-18


def plot_residuals(result: TrimResult) -> Figure:
    """Draw the magnitude of each scaled residual as a bar, floating derivatives in another colour.

    Args:
        result: what to draw.
    """
    names = [r.name for r in result.residuals]
    state = "in equilibrium" if result.converged else "no equilibrium found"
    title = f"{result.model}: {state}, what is left of each equation"
    figure, (ax,) = rows(1, title=title, height=0.2 + 0.28 * max(len(names), 3))
    sizes = [max(abs(r.scaled), _SMALLEST) if np.isfinite(r.scaled) else 1.0 for r in result.residuals]
    colours = [COLOURS[0 if r.required else 1] for r in result.residuals]
    ax.barh(range(len(names)), sizes, color=colours, left=0.1 * _SMALLEST)
    ax.set_yticks(range(len(names)), names)
    ax.invert_yaxis()
    ax.set_xscale("log")
    ax.set_xlim(0.1 * _SMALLEST, max([1.0, *sizes]) * 3.0)
    ax.set_xlabel("residual over the change for one nominal value of each unknown")
    ax.grid(visible=False, axis="y")
    if any(not r.required for r in result.residuals):
        kinds = {"required to be 0": COLOURS[0], "free to float": COLOURS[1]}
        ax.legend(handles=[Patch(color=colour, label=text) for text, colour in kinds.items()], **LEGEND)
    return figure

"""Pictures of limit cycles over a parameter."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from workbench.plotting.figure import COLOURS, rows, save

if TYPE_CHECKING:
    from workbench.analysis.limit_cycle.branch import Branch, BranchPoint

__all__ = ["draw_branch", "plot_branch"]


def plot_branch(branch: Branch, path: str | Path | None = None) -> Figure:
    """Draw amplitude and frequency over the parameter; unstable parts dashed, folds marked.

    Args:
        branch: what was followed.
        path: also write the picture here; png, svg or pdf by suffix.

    Raises:
        InputError: unknown suffix, file cannot be written.
    """
    figure, (size, frequency) = rows(2, title=f"limit cycles over {branch.parameter}")
    draw_branch(size, branch, lambda p: p.amplitude)
    draw_branch(frequency, branch, lambda p: p.frequency_hz)
    size.set_ylabel("amplitude")
    frequency.set_ylabel("frequency [Hz]")
    frequency.set_xlabel(branch.parameter)
    size.legend(fontsize=8.5, framealpha=0.9, edgecolor="#cccccc")
    if path is not None:
        save(figure, path)
    return figure


def draw_branch(ax: Axes, branch: Branch, of: Callable[[BranchPoint], float]) -> None:
    """Draw one quantity of a branch over the parameter.

    Args:
        ax: where.
        branch: what was followed.
        of: the quantity.
    """
    x = np.array([p.value for p in branch.points])
    y = np.array([of(p) for p in branch.points])
    solid = np.array([p.stable is not False for p in branch.points], dtype=bool)
    for stable, style, label in ((True, "-", "stable"), (False, "--", "unstable")):
        shown = solid == stable
        # A segment belongs to the point it begins at, so that the parts meet.
        shown = shown | np.append(False, shown[:-1])
        if np.any(solid == stable):
            ax.plot(x, np.where(shown, y, np.nan), style, color=COLOURS[0 if stable else 1], linewidth=1.4, label=label)
    if branch.folds:
        ax.plot([p.value for p in branch.folds], [of(p) for p in branch.folds], "o", color="#444444", label="fold")

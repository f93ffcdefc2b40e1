"""The picture of an identification with static blocks."""

from __future__ import annotations

from typing import TYPE_CHECKING

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from workbench.identification.validate.picture import SHOWN
from workbench.show.figure import ABOVE, COLOURS, panels
from workbench.show.tables import bracketed

if TYPE_CHECKING:
    from workbench.identification.structures.result import StructureResult
    from workbench.identification.structures.table import StaticTable

__all__ = ["plot_structure"]


def plot_structure(result: StructureResult) -> Figure:
    """Draw each static block with its 95 % errors, and below measured and simulated output over time [s].

    Args:
        result: what to draw.
    """
    data = result.data
    blocks = [
        (table, name, unit)
        for table, name, unit in (
            (result.before, data.input_names[0], data.input_units[0]),
            (result.behind, data.output_names[0], data.output_units[0]),
        )
        if table is not None
    ]
    title = f"{data.name}: {result.structure} model of order {result.order}"
    figure, grid = panels(len(blocks) + 1, 1, title=title)
    axes = [row[0] for row in grid]
    for ax, (table, name, unit) in zip(axes, blocks, strict=False):
        _block(ax, table, bracketed(name, unit))
    judged, ax = result.judged, axes[-1]
    part = slice(0, min(SHOWN, judged.n_samples))
    ax.plot(judged.time[part], judged.y[part, 0], ".", color="#333333", markersize=3.0, label="measured")
    ax.plot(judged.time[part], result.simulated[part], color=COLOURS[0], linewidth=1.0, label="simulated")
    ax.set_ylabel(bracketed(data.output_names[0], data.output_units[0]))
    ax.set_xlabel(
        "time [s]" + ("" if part.stop == judged.n_samples else f", {part.stop} of {judged.n_samples} samples")
    )
    ax.legend(**ABOVE, ncols=2)
    return figure


def _block(ax: Axes, table: StaticTable, name: str) -> None:
    """Draw one block."""
    ax.fill_between(table.x, table.y - table.error, table.y + table.error, color=COLOURS[0], alpha=0.25, linewidth=0.0)
    ax.plot(table.x, table.x, color="#333333", linewidth=0.9, linestyle="--", label="linear", zorder=3)
    ax.plot(table.x, table.y, ".-", color=COLOURS[0], linewidth=1.2, markersize=4.0, label="block, shaded: 95 % error")
    ax.set_xlabel(f"into the block: {name}")
    ax.set_ylabel("out of it")
    ax.legend(**ABOVE, ncols=2)

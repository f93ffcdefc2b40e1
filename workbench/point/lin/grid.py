"""Linear models over values of parameters: the result."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from workbench.core.records.record import RecordPart, entry
from workbench.point.lin.result import LinResult
from workbench.show.result import Result, drawn

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["LinGrid", "LinPoint"]


@dataclass(frozen=True, eq=False)
class LinPoint(RecordPart):
    """One member of an array of linear models.

    Attributes:
        values: what was varied → value there.
        result: the linear model; None where it failed.
        reason: why it failed, one line; None where it did not.
        kind: what went wrong, see `WorkbenchError.kind`; None where nothing did, or it was not reached.
    """

    values: dict[str, float]
    result: LinResult | None = field(metadata=entry(inline=True))
    reason: str | None = None
    kind: str | None = None

    def __str__(self) -> str:
        return _label(self.values)


@dataclass(frozen=True, eq=False)
class LinGrid(Result):
    """An array of linear models.

    Attributes:
        model, interface, solver: what was linearised.
        over: what was varied → values; the last one varies fastest in `points`.
        points: one for each combination.
        notes: on how they were found.
    """

    _page = "workbench.point.lin.page:grid_page"

    model: str
    interface: str
    solver: str
    over: dict[str, tuple[float, ...]]
    points: tuple[LinPoint, ...] = field(metadata=entry(key="systems"))
    notes: tuple[str, ...] = ()

    _WHAT, _COMMAND = "a family of linear models", "lin --over"

    @property
    def failed(self) -> tuple[LinPoint, ...]:
        """The points without a model."""
        return tuple(p for p in self.points if p.result is None)

    @property
    def complete(self) -> bool:
        """Whether there is a model at every point."""
        return not self.failed

    def plot(self, path: str | Path | None = None, *, axes: Axes | Sequence[Axes] | None = None) -> Figure:
        """Return a Bode picture of the first input and output, one curve per model.

        Args:
            path: also write it here; png, svg or pdf by suffix.
            axes: to draw on, as many as the picture has panels, row by row; None: a figure of its own.
        """
        curves = [(str(p), p.result) for p in self.points if p.result is not None]
        return drawn("workbench.point.lin.picture:plot_curves", path, curves, axes=axes)

    def derived(self) -> dict[str, Any]:
        """Return the points at which no linear model was found, and why."""
        return {"failed": [{**p.values, "reason": p.reason, "kind": p.kind} for p in self.failed]}

    def rows(self) -> Iterator[list[Any]]:
        """Yield one row for each entry of a matrix, behind what was varied."""
        yield [*self.over, "matrix", "row", "column", "value"]
        for point in self.points:
            if point.result is not None:
                yield from ([*point.values.values(), *row] for row in point.result.entries())


def _label(values: Mapping[str, float]) -> str:
    return ", ".join(f"{name} = {value:g}" for name, value in values.items())

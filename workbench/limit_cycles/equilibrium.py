"""Where an analysis that needs an operating point begins if none is given."""

from __future__ import annotations

from workbench.core.values.operating_point import OperatingPoint
from workbench.errors import WorkbenchError
from workbench.model.described_model import DescribedModel
from workbench.point.trim.request import trim

__all__ = ["rest_of"]

_AT_REST = 1e-9  # derivatives of states below this count as none


def rest_of(model: DescribedModel, *, time: float, what: str) -> tuple[OperatingPoint, list[str]]:
    """Return the start of a model if it is at rest there, else what trim finds, else the start; and notes about it.

    Not for co-simulation, which shows no states and no derivatives.

    Args:
        model: model exchange; it stays open.
        time: session time [s].
        what: is done with the point, such as "the block is taken about"; for the notes.

    Raises:
        FmuError, SimulationError: the model cannot be opened or evaluated at its start.
    """
    start = _start(model, time)
    if all(abs(v) <= _AT_REST for v in start.dx.values()):
        return start, []
    try:
        result = trim(model, time=time)
    except WorkbenchError as error:
        return start, [f"trim failed ({error}); {what} the start values, which are not at rest"]
    if result.converged:
        return result.operating_point, [f"the start is not at rest; {what} the point that trim finds"]
    return start, [f"neither the start nor the point that trim finds is at rest; {what} the start values"]


def _start(model: DescribedModel, time: float) -> OperatingPoint:
    with model.open_point(time=time) as point:
        dx = point.at(point.x0, point.u0).dx
        return OperatingPoint(
            x={v.name: x for v, x in zip(point.states, point.x0.tolist(), strict=True)},
            u={v.name: u for v, u in zip(point.inputs, point.u0.tolist(), strict=True)},
            dx={v.name: d for v, d in zip(point.states, dx.tolist(), strict=True)},
            time=time,
        )

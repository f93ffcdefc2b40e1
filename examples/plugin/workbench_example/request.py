"""The command `drift`: what can be asked; it imports no numerics."""

from __future__ import annotations

from typing import TYPE_CHECKING

from workbench.core.records.option import option
from workbench.core.values.operating_point import AtPoint
from workbench.requests.request import ModelRequest

if TYPE_CHECKING:
    from workbench_example.drift import DriftResult  # noqa: F401 - the record's type, below


class Drift(AtPoint, ModelRequest["DriftResult"]):
    """Measure how far the outputs move by themselves, with every input at rest.

    The drift of an output y is max |y(t) - y(0)| over a run from the operating point. Not for a model that is meant to
    move by itself.

    Returns:
        The drift of each output.

    Raises:
        InputError: the model has no outputs, or starts after `stop`.
        SimulationError: the model failed while running.

    Examples:
        >>> with wb.load("fmu:Rudder") as rudder:
        ...     print(max(wb.drift(rudder, 1.0).drift))
        0.0
    """

    command = "drift"
    algorithm = "workbench_example.drift:run"
    example = "workbench drift fmu:Rudder --stop 1"
    unwritten = ("plot",)  # it has no picture

    stop: float = option("End of the run.", unit="s", metavar="T")

"""Trim: what can be asked."""

from __future__ import annotations

from dataclasses import KW_ONLY
from typing import TYPE_CHECKING

from workbench.core.records.forms import Limits, Names, Values
from workbench.core.records.option import EACH, option
from workbench.core.values.operating_point import AtPoint
from workbench.requests.request import ModelRequest, function

if TYPE_CHECKING:
    from workbench.point.trim.result import TrimResult

__all__ = ["Trim", "trim"]

_HOW = "How it searches"


class Trim(AtPoint, ModelRequest["TrimResult"]):
    """Find an operating point: states, inputs and outputs at which nothing moves.

    By default every state is unknown, every derivative must vanish, every input is held at its start value and outputs
    are free. Unknowns and equations are counted, and what is missing is named.

    The method depends on the model; `method` of the result names it:
      - "equations", continuous model exchange: dx/dt = 0 by bounded least squares, with the FMU's
        directional derivatives where it has them and a probe confirms them, else by differences. Relations
        are evaluated anew at every point; discrete states keep their values.
      - "period map", sampled and hybrid model exchange: the continuous and discrete states are those that return
        after the basic time period. Discrete states must have start values, the only way to set them in FMI.
      - "step map", co-simulation whose states have start values: those that return after a communication step.
      - "running", other co-simulation: run until nothing moves; free inputs are adjusted from run to run.

    If the equations leave directions open, there is a family of equilibria: the directions are reported, and the
    chosen member has the smallest floating derivatives and is nearest to the start values; with family "nearest"
    only the latter counts. Both are measured in nominal values.

    Not for periodic motion (a limit cycle has no point at rest). One equilibrium is found where there are several
    apart from each other; `x0` and `bound` lead to others. An equilibrium need not be stable, except by "running".

    Returns:
        The point, or where the search ended: `converged` tells which.

    Raises:
        InputError: an unknown name, a value out of its range, sets that exclude each other.
        FmuError, SimulationError: the model cannot be started, or no run of the method "running" came to its end.

    Source: the source report, chapter 3.4 (its command lets derivatives float); residual table, counting and null
    directions are the workbench's own.

    Examples:
        The equilibrium of dx/dt = u - x is x = u.

        >>> with wb.load("fmu:FirstOrderLag") as lag:
        ...     result = wb.trim(lag, u0={"u": 2.0})
        >>> print(result.converged, result.operating_point.x)
        True {'x': 2.0}
    """

    command = "trim"
    counts = "steps"
    algorithm = "workbench.point.trim.run:run"
    example = "workbench trim fmu:Rudder --u0 delC=2 --float p1,p2 --json trim.json"

    _: KW_ONLY
    free: Names = option("Inputs to find.", metavar="U,..", default=(), first=True)
    fix: Values | None = option("Value that a state, input or output must have.", of=EACH, default=None, first=True)
    bound: Limits | None = option(
        "Lowest and highest value of a state, input or output; an input with bounds is free.",
        of=EACH,
        default=None,
        first=True,
    )
    floating: Names = option(
        "States whose derivative need not vanish.", flag="--float", metavar="X,..", default=(), first=True
    )
    x0: Values | None = option(
        "Value of a state at which the search begins, instead of that of the operating point.", of=EACH, default=None
    )
    u0: Values | None = option(
        "Value at which an input is held, or at which the search begins if the input is free.",
        of=EACH,
        default=None,
    )
    time: float | None = option(
        "Time of the point; by default that of the operating point, or the model's start time.",
        unit="s",
        metavar="T",
        default=None,
    )
    family: str = option(
        "Choice from a family of equilibria: the one with the smallest floating derivatives, or the one nearest to the "
        "start values.",
        choices=("slowest", "nearest"),
        default="slowest",
        group=_HOW,
    )
    period: float | None = option(
        "Basic time period of a sampled model; by default found from its time events.",
        unit="s",
        metavar="S",
        positive=True,
        default=None,
        group=_HOW,
    )
    step: float | None = option(
        "Communication step of co-simulation; by default the model's own or 1 ms, refined if necessary.",
        unit="s",
        metavar="S",
        positive=True,
        default=None,
        group=_HOW,
    )
    longest: float | None = option(
        "Longest run of a co-simulation FMU whose states cannot be set; by default 200 000 steps.",
        unit="s",
        metavar="S",
        positive=True,
        default=None,
        group=_HOW,
    )
    tolerance: float = option(
        "Largest residual, relative to the change in it when an unknown moves by its nominal value (or by its own "
        "value, if that is larger).",
        positive=True,
        python=True,
        default=1e-8,
    )

    def went_well(self, record: TrimResult) -> bool:
        """Return whether the point is an equilibrium.

        Args:
            record: of this request.
        """
        return record.converged


trim = function(Trim)

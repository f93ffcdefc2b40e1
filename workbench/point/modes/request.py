"""Modes over a parameter: what can be asked."""

from __future__ import annotations

from dataclasses import KW_ONLY
from typing import TYPE_CHECKING

from workbench.core.records.forms import VARIED, Band, Configurations, Numbers, Settings
from workbench.core.records.option import option
from workbench.jobs.options import InParts
from workbench.point.lin.request import METHOD_NAMES, PointOptions
from workbench.requests.request import ModelRequest, function

if TYPE_CHECKING:
    from workbench.point.modes.result import ModesResult

__all__ = ["Modes", "modes"]


class Modes(PointOptions, InParts, ModelRequest["ModesResult"]):
    """Follow every mode over a parameter, through crossings, and find where modes become unstable: a flutter diagram.

    The model is linearised at each value. Modes are matched from value to value by the biorthogonality of their left
    and right eigenvectors, with models in between where that leaves a doubt, so that a mode keeps its number through
    a crossing; where even the smallest step leaves one, a meeting says so. Critical values are refined by root finding
    on the mode's real part.

    Of a large model follow a few modes: those nearest to a frequency are found by the Arnoldi method on its sparse
    matrix, the others are never computed, and whether one of them is unstable is not known.

    The operating point stays where it is unless `trimmed`. Not for models whose linear model means nothing (a
    quantiser, a block with jumps at the point); of a sampled model the poles are those its samples show.

    Raises:
        InputError: unknown name, values that do not rise, no linear model at two of them.
        FmuError, SimulationError: the model cannot be opened or evaluated.

    Source: biorthogonal matching: Seyranian & Mailybaev, Multiparameter Stability Theory with Mechanical
    Applications, chapter 2; flutter diagrams: Bisplinghoff, Ashley & Halfman, Aeroelasticity, chapter 9.

    Examples:
        The pole of 1/(tau s + 1) is -1/tau.

        >>> with wb.load("fmu:FirstOrderLag") as lag:
        ...     diagram = wb.modes(lag, vary="tau", values=[0.5, 1.0, 2.0])
        >>> print(diagram.sets[0].modes[0].pole.real)
        [-2.  -1.  -0.5]
    """

    command = "modes"
    algorithm = "workbench.point.modes.run:run"
    example = "workbench modes fmu:Aircraft --vary airspeed=150:350 --against outer_aileron_failed=true --plot out.png"
    counts = "models"

    _: KW_ONLY
    vary: str = option(
        "Parameter, input or state to vary, with its range LO:HI or its values A,B,..; in a system component.name or "
        "component.parameter of a block or gain.",
        form=VARIED,
    )
    values: Numbers | None = option("Values of what is varied, rising.", python=True, default=None)
    band: Band | None = option("Lowest and highest value of what is varied.", python=True, default=None)
    points: int = option("Number of equidistant values in the range.", metavar="N", least=2, default=41, first=True)
    set: Settings | None = option("Parameters that all configurations have in common.", python=True, default=None)
    against: Configurations = option("Parameters of another configuration to compare with.", default=(), first=True)
    trimmed: bool = option(
        "Trim at each value with the inputs held; by default the operating point stays the same.",
        flag="--trim",
        default=False,
        first=True,
    )
    method: str = option("Method of linearisation; auto chooses.", choices=METHOD_NAMES, default="auto")
    count: int | None = option(
        "Follow so many modes only, at the first value those nearest to a given frequency; by default all.",
        metavar="N",
        least=1,
        default=None,
    )
    about: float = option(
        "Frequency near which the modes lie that are followed, where not all are.",
        unit="Hz",
        metavar="HZ",
        least=0.0,
        default=0.0,
    )
    tolerance: float | None = option(
        "Precision of critical values; by default 1e-6 of the range.",
        flag="--precision",
        metavar="D",
        positive=True,
        default=None,
    )

    def went_well(self, record: ModesResult) -> bool:
        """Return whether there is a linear model at every value.

        Args:
            record: of this request.
        """
        return not any(s.failed for s in record.sets)


modes = function(Modes)

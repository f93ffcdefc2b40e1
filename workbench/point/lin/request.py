"""Linear models: what can be asked."""

from __future__ import annotations

from dataclasses import KW_ONLY
from typing import TYPE_CHECKING

from workbench.core.records.forms import File, Grid, Names, Numbers, Ranges, Values, Widths
from workbench.core.records.option import EACH, Options, option, with_options
from workbench.core.values.calendar import TOGETHER
from workbench.core.values.operating_point import AtPoint
from workbench.errors import InputError
from workbench.jobs.options import InParts
from workbench.requests.decorator import with_origin
from workbench.requests.request import ModelRequest, answered, function
from workbench.signals.text import Signals

if TYPE_CHECKING:
    from workbench.model import Model
    from workbench.point.lin.grid import LinGrid  # noqa: F401 - the answer's type
    from workbench.point.lin.result import LinResult  # noqa: F401 - as above
    from workbench.point.lin.state_space import LinearModel
    from workbench.point.lin.varying_result import VaryingModel  # noqa: F401 - as above

__all__ = [
    "METHOD_NAMES", "Lin", "LinAlong", "LinOver", "LinVarying", "PointOptions", "VaryingOptions", "lin", "lin_along",
    "lin_over", "lin_result", "lin_varying",
]  # fmt: skip

METHOD_NAMES = ("auto", "exact", "difference", "kalman-bertram", "response")

HOW, SEVERAL, MEASURED = "Method", "Several linear models", "Comparison"


# -- options that several of the requests have -------------------------------------------------


class PointOptions(AtPoint):
    """Where a model is linearised."""

    group = "Operating point"

    _: KW_ONLY
    x0: Values | None = option(
        "Value of a state or discrete state, instead of that of the operating point.", of=EACH, default=None
    )
    u0: Values | None = option("Value of an input, instead of that of the operating point.", of=EACH, default=None)
    time: float | None = option(
        "Time of the point; by default that of the operating point, or the model's start time.",
        unit="s",
        metavar="T",
        default=None,
    )


class Perturbed(Options):
    group = HOW

    _: KW_ONLY
    dx: Widths | None = option(
        "Total width of the perturbation of the states: one value for all, values by name, or a list in their order; "
        "by default chosen and verified.",
        default=None,
    )
    du: Widths | None = option(
        "Total width of the perturbation of the inputs, given in the same way as dx.", default=None
    )
    period: float | None = option(
        "Period over which the method response holds its inputs; by default the communication step.",
        unit="s",
        metavar="S",
        default=None,
    )


class SampledOptions(Options):
    group = HOW

    _: KW_ONLY
    btptol: float = option("Relative tolerance within which sample periods have a common multiple.", default=TOGETHER)


class _ChosenVariables(Options):
    _: KW_ONLY
    inputs: Names | None = option(
        "Inputs of the linear model, in this order; by default all real inputs.",
        metavar="U,..",
        default=None,
        first=True,
    )
    outputs: Names | None = option(
        "Outputs or states to use as outputs of the linear model; by default all real outputs.",
        metavar="Y,..",
        default=None,
        first=True,
    )
    method: str = option(
        "Method of linearisation; auto chooses and gives the reason.", choices=METHOD_NAMES, default="auto"
    )


class OnePoint(PointOptions, Perturbed, SampledOptions, _ChosenVariables):
    group = HOW

    _: KW_ONLY
    points: int = option("Number of periods that the method response records.", default=400)
    order: int | None = option(
        "Number of states that the method response identifies; by default chosen from the data.", default=None
    )
    continuous: bool = option(
        "Convert a discrete linear model to the continuous model of which it is the hold equivalent.", default=False
    )
    about: float = option(
        "Frequency near which poles are shown of a sparse model of more than 1,000 states, whose poles are not all "
        "found; by default the slowest are shown.",
        unit="Hz",
        metavar="HZ",
        least=0.0,
        default=0.0,
    )


# -- requests ----------------------------------------------------------------------------------


class Lin(OnePoint, ModelRequest["LinResult"]):
    """Linearise a model at an operating point.

    A linear model says nothing about large motions: see `workbench.nfr` for gain and phase over the amplitude. The
    docstring of each method gives its limits (`workbench.point.lin.linearise.METHODS`).

    Returns:
        A `control.StateSpace` with names (see `LinearModel`); its `result` tells how it was made, what is
        doubtful and which rows and columns are zero and why.

    Raises:
        InputError: unknown name or method, bad width, a method that does not apply.
        FmuError, SimulationError: the model cannot be opened, initialised or evaluated.

    Source: the source report, chapter 3.

    Examples:
        Example 2-1b of the source report: within its limits the saturation has the slope 1.

        >>> with wb.load("fmu:Saturation") as model:
        ...     linear = wb.lin(model, method="difference", dx=1, du=1)
        >>> print(linear.C, linear.D)
        [[0.6407 0.6794]] [[0.43]]
    """

    command = "lin"
    algorithm = "workbench.point.lin.linearise:linearise"
    example = "workbench lin fmu:Rudder --at trim.json --inputs delC --plot bode.png --json lin.json"


class LinOver(PointOptions, Perturbed, _ChosenVariables, InParts, ModelRequest["LinGrid"]):
    """Linearise at every combination of parameters, inputs or states.

    The point is not trimmed again: if the equilibrium moves with what is varied, trim first and
    linearise each point with `lin`.

    Raises:
        InputError: nothing to vary, unknown name, or a store for a model that is not a file.
        FmuError: the model cannot be opened.

    Examples:
        The pole of 1/(tau s + 1) is -1/tau.

        >>> with wb.load("fmu:FirstOrderLag") as lag:
        ...     grid = wb.lin_over(lag, {"tau": [0.5, 2.0]})
        >>> print(*(point.result.A.item() for point in grid.points))
        -2.0 -0.5
    """

    command = "lin_over"
    algorithm = "workbench.point.lin.sweep:over"
    in_shell = False
    example = "workbench lin fmu:Rudder --over mH=0,100 --inputs delC"

    over: Grid = option("Parameters, inputs or states to vary, with their values.", of=EACH)
    _: KW_ONLY
    store: File | None = option(
        "Folder in which finished models are kept; the same call continues from there.", default=None
    )


class VaryingOptions(Options):
    """How near a parameter-varying model has to be."""

    group = SEVERAL

    _: KW_ONLY
    error: float = option(
        "Largest relative error of poles, responses and operating points of a parameter-varying model.",
        metavar="E",
        positive=True,
        default=1e-3,
    )


class LinVarying(VaryingOptions, PointOptions, Perturbed, _ChosenVariables, InParts, ModelRequest["VaryingModel"]):
    """Find a parameter-varying (LPV) linear model over ranges of scheduling parameters, and tell its largest errors.

    dx/dt = A(p) (x - x0(p)) + B(p) (u - u0(p)), y = y0(p) + C(p) (x - x0(p)) + D(p) (u - u0(p)). The model is
    linearised over a grid: where the given point is not at rest everywhere, at an equilibrium that is found anew at
    each place, from that point and with its inputs. The states are those of the model, which match by name, without a
    transformation. Each entry is a polynomial in Chebyshev's form, or a cubic spline, of all parameters: whichever is
    nearer to linear models at points beside the grid. The grid is refined, where every second point of it foretells
    the others worst, until poles, frequency responses, step responses and operating points beside it are as near as
    asked for. `errors` are promises: the largest errors found between all neighbours of the grid, and from the worst of
    these points on by ever smaller steps, and a quarter more.

    What is promised holds for parameters that stand still. A parameter that moves, moves the equilibrium; and one that
    is itself moved by states or inputs, is part of the dynamics, which a frozen model does not see (hidden
    coupling). Not where the model switches within the ranges, or the search finds another equilibrium at
    neighbouring points: the grid is then refined in vain. At most three parameters.

    Raises:
        InputError: unknown name, a range that does not rise, a sampled model, other states at another point.
        SimulationError: no linear model, or no equilibrium, at a point of the ranges.

    Source: J. S. Shamma and M. Athans, Guaranteed properties of gain scheduled control for linear parameter-varying
    plants, Automatica 27 (1991); D. J. Leith and W. E. Leithead, Survey of gain-scheduling analysis and design, Int. J.
    Control 73 (2000); R. Toth, Modeling and Identification of Linear Parameter-Varying Systems (2010).

    Examples:
        The pole of 1/(tau s + 1) is -1/tau.

        >>> with wb.load("fmu:FirstOrderLag") as lag:
        ...     varying = wb.lin_varying(lag, {"tau": (0.5, 2.0)}, error=1e-6)
        >>> print(varying.interpolation, varying.complete, varying.at({"tau": 0.8}).poles.real.round(5))
        chebyshev True [-1.25]
    """

    command = "lin_varying"
    algorithm = "workbench.point.lin.varying:run"
    in_shell = False
    example = "workbench lin fmu:Aircraft --over airspeed=150:340 --inputs elevator --outputs theta_center_of_gravity"

    over: Ranges = option("Scheduling parameters: parameters, inputs or states, with their ranges.", of=EACH)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 1 <= len(self.over) <= 3:
            raise InputError("over: one to three scheduling parameters, NAME=LO:HI each")


class LinAlong(Perturbed, _ChosenVariables, ModelRequest["LinGrid"]):
    """Linearise along a simulation: at each time about the states and inputs the model has then.

    The models describe small deviations from the path, not from an equilibrium. Integer and Boolean modes of
    the model are carried over as far as the FMU lets them be started elsewhere.

    Raises:
        InputError: times that do not rise, unknown input.
        FmuError, SimulationError: the model cannot be run or evaluated.

    Examples:
        The model is linear: A is the same at any time.

        >>> with wb.load("fmu:FirstOrderLag") as lag:
        ...     grid = wb.lin_along(lag, [0.5, 1.0], signals={"u": 1})
        >>> print(*(point.result.A.item() for point in grid.points))
        -1.0 -1.0
    """

    command = "lin_along"
    algorithm = "workbench.point.lin.sweep:along"
    in_shell = False
    example = "workbench lin fmu:Rudder --snapshot 0.1,0.2 --input delC=2 --inputs delC"

    times: Numbers = option("Times at which to linearise, rising.", unit="s")
    _: KW_ONLY
    signals: Signals | None = option(
        "Signals of the forced inputs; other inputs keep their start values.", default=None
    )


# -- functions ---------------------------------------------------------------------------------


def _state_space(model: Model, request: Lin) -> LinearModel:
    from workbench.point.lin.state_space import LinearModel  # noqa: PLC0415 - python-control is slow to import

    return LinearModel(answered(model, request))


# What analyses call that need no model of python-control, which takes a second to load.
lin_result = with_origin()(with_options(Lin, answered, name="lin", first=Lin.subject.first))
lin = with_origin("result")(with_options(Lin, _state_space, name="lin", first=Lin.subject.first))
lin_over = function(LinOver)
lin_varying = function(LinVarying)
lin_along = function(LinAlong)

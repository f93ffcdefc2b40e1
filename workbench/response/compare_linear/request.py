"""Linear models beside a measured response, and the command `lin`: what can be asked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import KW_ONLY
from typing import TYPE_CHECKING, Any

from workbench.core.records.forms import OVER, Amount, File, Grid, Numbers
from workbench.core.records.option import EACH, option, recast
from workbench.errors import InputError
from workbench.jobs.job import Job
from workbench.jobs.options import InParts
from workbench.point.lin.request import (
    MEASURED,
    SEVERAL,
    Lin,
    LinAlong,
    LinOver,
    LinVarying,
    OnePoint,
    Perturbed,
    PointOptions,
    SampledOptions,
    VaryingOptions,
)
from workbench.requests.request import ModelRequest, function
from workbench.signals.text import Signals

if TYPE_CHECKING:
    from workbench.model import Model
    from workbench.point.lin.grid import LinGrid
    from workbench.point.lin.result import LinResult
    from workbench.point.lin.varying_result import VaryingModel
    from workbench.response.compare_linear.result import LinComparison

__all__ = ["Compare", "LinCommand", "compare"]


class Compare(PointOptions, Perturbed, SampledOptions, ModelRequest["LinComparison"]):
    """Linearise by every method that applies, on each interface of the FMU, and compare with a measured response.

    The measurement drives the input with a small sine around the point (`workbench.nfr`). Discrete models are compared
    by what a sine would show between their samples (`LinResult.fundamental`). A difference between a linear model and
    the measurement is not always an error of the linear model: the amplitude may be too large, or the model has no
    periodic response at all (undamped, unstable, or not at rest); the words say what was seen. Widths of the states
    are for the method difference alone.

    Raises:
        InputError: unknown name, or no method applies.
        FmuError: the model cannot be opened.

    Examples:
        The pole of 1/(s + 1) by the FMU's directional derivatives; the other methods are beside it.

        >>> with wb.load("fmu:FirstOrderLag", interface="me") as lag:
        ...     comparison = wb.compare(lag, "u", "y", frequencies=[0.1], measure=False)
        >>> print(comparison.results["exact (me)"].A)
        [[-1.]]
    """

    command = "compare"
    algorithm = "workbench.response.compare_linear.run:run_all"
    in_shell = False
    example = "workbench lin fmu:Rudder --compare --inputs delC --outputs del"

    input: str = option("Input to force.")
    output: str = option("Output to compare.")
    _: KW_ONLY
    frequencies: Numbers | None = option(
        "Frequencies of the comparison; by default nine around the poles, up to 0.4 of the Nyquist frequency.",
        unit="Hz",
        positive=True,
        default=None,
    )
    amplitude: Amount | None = option(
        "Amplitude of the sine; by default 0.001 of the input's value or nominal value (1 if not declared), whichever "
        "is larger.",
        of="input",
        change=True,
        positive=True,
        default=None,
    )
    measure: bool = option("Measure the response, in addition to comparing the methods.", default=True)


class LinCommand(VaryingOptions, OnePoint, InParts, ModelRequest["LinResult | LinGrid | VaryingModel | LinComparison"]):
    """Linearise at an operating point: A, B, C, D with names, doubtful entries, reasons for zero rows and columns.

    If requested, over a grid of values, along a simulation, or by all methods with a measurement for comparison.
    """

    command = "lin"
    algorithm = ""
    example = Lin.example

    _: KW_ONLY
    over: Grid = option(
        "Values of a parameter, input or state, or LO:HI:N; gives one linear model for each combination. LO:HI without "
        "N: one parameter-varying model over the whole range.",
        of=EACH,
        form=OVER,
        default_factory=dict,
        group=SEVERAL,
        first=True,
    )
    store: File | None = option(
        "Folder in which finished models of --over are kept; the same command continues from there.",
        metavar="DIR",
        default=None,
        group=SEVERAL,
    )
    snapshot: Numbers | None = option(
        "Linearise at these times of a simulation.", unit="s", metavar="T1,T2,..", default=None, group=SEVERAL
    )
    signals: Signals | None = option(
        "Force an input in the simulation for --snapshot: a number, sine:…, step:…, file.csv.",
        flag="--input",
        default=None,
        group=SEVERAL,
    )
    compare: bool = option(
        "Compare all methods on all interfaces with each other and with a measured response.",
        default=False,
        group=MEASURED,
        first=True,
    )
    frequencies: Numbers | None = option(
        "Frequencies for --compare.",
        unit="Hz",
        flag="--freq",
        metavar="F,..",
        positive=True,
        default=None,
        group=MEASURED,
        first=True,
    )
    amplitude: Amount | None = option(
        "Amplitude of the sine for --compare.",
        of="inputs",
        change=True,
        positive=True,
        default=None,
        group=MEASURED,
        first=True,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if sum([bool(self.over), self.snapshot is not None, self.compare]) > 1:
            raise InputError("--over, --snapshot and --compare: only one of them at a time")
        for flag, value in (("--amplitude", self.amplitude), ("--freq", self.frequencies)):
            if value is not None and not self.compare:
                raise InputError(
                    f"{flag} belongs to the measurement that --compare makes; add --compare, or leave it out"
                )
        if self.error != VaryingOptions().error and not self._ranges:
            raise InputError("--error belongs to a parameter-varying model: give --over NAME=LO:HI, or leave it out")
        if self._ranges and (len(self._ranges) < len(self.over) or self.store is not None):
            raise InputError("--over: a parameter-varying model needs LO:HI of each parameter, and has no --store")
        for name in ("at", "x0", "u0", "time"):
            if self.snapshot is not None and getattr(self, name):
                raise InputError(f"--snapshot: the simulation sets the point; leave --{name} out")

    @property
    def _ranges(self) -> dict[str, tuple[float, ...]]:
        """The ranges of a parameter-varying model."""
        given: Mapping[str, object] = self.over
        return {name: tuple(map(float, text.split(":"))) for name, text in given.items() if isinstance(text, str)}

    def run(self, subject: Model, job: Job) -> LinResult | LinGrid | VaryingModel | LinComparison:
        """Run the request that is meant.

        Args:
            subject: the model; it stays open.
            job: is told what is finished.
        """
        request: ModelRequest[Any]
        if self._ranges:
            request = recast(LinVarying, self, over=self._ranges)
        elif self.over:
            request = recast(LinOver, self)
        elif self.snapshot is not None:
            request = recast(LinAlong, self, times=self.snapshot)
        elif self.compare:
            request = recast(Compare, self, input=self._one("input", subject), output=self._one("output", subject))
        else:
            request = recast(Lin, self)
        record: LinResult | LinGrid | VaryingModel | LinComparison = request.run(subject, job)
        return record

    def _one(self, kind: str, model: Model) -> str:
        named = getattr(self, f"{kind}s") or [v.name for v in getattr(model, f"{kind}s")[:1]]
        if len(named) != 1:
            raise InputError("--compare: it takes one input and one output; name them with --inputs and --outputs")
        name: str = named[0]
        return name

    def went_well(self, record: LinResult | LinGrid | VaryingModel | LinComparison) -> bool:
        """Return whether nothing is missing from the record.

        Args:
            record: of this request.
        """
        return record.complete


compare = function(Compare)

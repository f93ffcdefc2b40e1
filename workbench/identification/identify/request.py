"""Linear models from recorded data: what can be asked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, replace
from typing import TYPE_CHECKING, Annotated, Literal

from workbench.core.records.forms import FILE, FILES, LISTED, File, Form, Names, Values, word_or_number
from workbench.core.records.option import option
from workbench.errors import InputError
from workbench.requests.request import Request, Subject, function

if TYPE_CHECKING:
    from workbench.data.experiment.experiment import Experiment
    from workbench.identification.identify.result import IdentifyResult
    from workbench.point.lin.result import LinResult
    from workbench.point.lin.state_space import LinearModel
    from workbench.response.nfr.result import NfrResult

__all__ = ["Identify", "identify"]


def _split_delay(texts: Sequence[str]) -> int | str | list[int]:
    if texts[-1] == "auto":
        return "auto"
    parts = [part.strip() for part in texts[-1].split(",")]
    if not all(part.isdigit() for part in parts):
        raise ValueError(f"'{texts[-1]}' is neither auto nor numbers of samples, one for each input")
    return int(parts[0]) if len(parts) == 1 else [int(part) for part in parts]


_WORD_OR_ORDER = word_or_number("auto", "ask", what="a number of states, 0 (a gain) or more")
_ORDER = replace(
    _WORD_OR_ORDER,
    metavar="auto|N|ask",
    # Whom to ask, the command line knows.
    read=lambda value: "auto" if value == "ask" else _WORD_OR_ORDER.read(value),
)
_DELAY = Form(
    metavar="auto|N,..",
    layout=replace(
        LISTED,
        split=_split_delay,
        join=lambda value: [str(value) if isinstance(value, int | str) else ",".join(map(str, value))],
    ),
    items=("integer", "string"),
)
_NOISE = word_or_number("auto", "shared", what="a number of states, 0 (white) or more")

if TYPE_CHECKING:
    _Noise = int | Literal["auto", "shared"]
    _Order = int | Literal["auto"]
    _Delay = int | Sequence[int] | Literal["auto"]
    _Data = Experiment | File
    _Several = Sequence[Experiment | File]
else:
    _Several = Annotated[object, FILES]
    _Noise = Annotated[object, _NOISE]
    _Order = Annotated[object, _ORDER]
    _Delay = Annotated[object, _DELAY]
    _Data = Annotated[object, FILE]


class Identify(Request["Experiment | File", "IdentifyResult"]):
    """Identify a discrete linear model from recorded data, judge the data, and validate the model.

    The steps of the source report's chapter 5: the data are judged (`advise`), their operating point is subtracted, the
    order is chosen from singular values or principal angles, the model is estimated by a subspace method, refined to
    the least prediction error with a model of the disturbance beside it, and its simulation and one-step prediction are
    compared with other data, or else with the data of the fit, which makes it look too good. The refined model is taken
    where it validates no worse; the covariance of its parameters gives regions of poles and frequency response.

    Not for data from a closed loop without `closed_loop` (the estimate is biased; the advice and the cross-correlation
    at negative lags show it) and not for models whose gain depends on the amplitude, beyond the amplitude of the data.

    Returns:
        The model, how it came about and what it is worth.

    Raises:
        InputError: the data cannot be read or excite too little for the order, unknown name, too few samples.

    Examples:
        The sampled pole of 1/(s + 1) is exp(-dt).

        >>> with wb.load("fmu:FirstOrderLag") as lag:
        ...     experiment = wb.excite(lag, "u", "y", prbs="amplitude=1", dt=0.1, samples=300)
        >>> found = wb.identify(experiment.identification, order=1, validation=experiment.validation)
        >>> print(f"{found.model.A.item():.4f} {math.exp(-0.1):.4f}")
        0.9048 0.9048
    """

    command = "identify"
    written = "workbench.identification.structures.written:IdentifyFiles"
    algorithm = "workbench.identification.identify.run:run"
    example = (
        "workbench identify rudder.csv --input delC --output del --validate rudder_validation.csv --report id.html"
    )
    counts = "steps"
    subject = Subject(
        name="data",
        type="Experiment | str | Path",
        help="An experiment, or a file.",
        metavar="DATA",
        words="CSV file, as workbench excite writes it, or any other; also .mat, .parquet, .feather, .mf4.",
    )

    _: KW_ONLY
    inputs: Names | None = option(
        "Columns with inputs; by default those that the file or the experiment names.",
        flag="--input",
        also="--inputs",
        metavar="U,..",
        default=None,
        first=True,
    )
    outputs: Names | None = option(
        "Columns with outputs; by default those that the file or the experiment names.",
        flag="--output",
        also="--outputs",
        metavar="Y,..",
        default=None,
        first=True,
    )
    also: _Several | None = option(
        "More experiments with the same system, fitted together; each has an operating point and a start of its own.",
        metavar="DATA,..",
        default=None,
        group="Data",
    )
    repair: bool = option(
        "Replace outliers of the outputs, fill short gaps in a file, and divide the data at long ones.",
        default=False,
        group="Data",
    )
    order: _Order = option(
        "Number of states, 0 for a gain; ask shows the singular values and prompts for it.", default="auto", first=True
    )
    validation: _Data | None = option(
        "Other data from the same model; by default the data of the fit, which makes the model look too good.",
        flag="--validate",
        metavar="DATA2",
        default=None,
        first=True,
    )
    method: str = option("Weighting of the subspace method.", choices=("moesp", "n4sid", "cva"), default="moesp")
    basis: str | None = option(
        "Choose the order from principal angles (combined) or singular values (unscaled); by default as the method "
        "does.",
        choices=("combined", "unscaled"),
        default=None,
        group="Estimate",
    )
    biased: bool = option(
        "Estimate by regression on the state sequence, with less variance but a remaining bias.",
        default=False,
        group="Estimate",
    )
    horizon: int | None = option(
        "Number of block rows of the subspace method; by default chosen from the data.",
        unit="samples",
        metavar="N",
        default=None,
        group="Estimate",
    )
    max_order: int = option("Largest order that auto considers.", metavar="N", least=1, default=20, group="Estimate")
    feedthrough: bool = option(
        "Estimate the direct feedthrough D; otherwise D is zero.", default=True, group="Estimate"
    )
    delay: _Delay = option(
        "Known delay of the inputs; auto uses the estimate from the data.",
        unit="samples",
        default=0,
        group="Estimate",
    )
    stable: bool = option("Move unstable poles inside the unit circle.", default=False, group="Estimate")
    gains: Values | None = option(
        "Steady gain that is known and held in the refined model, as output/input=value.",
        flag="--gain",
        metavar="Y/U=VALUE",
        default=None,
        group="Estimate",
    )
    refine: str = option(
        "Refine the model to the least prediction error; auto takes the refined model where it validates no worse.",
        choices=("auto", "always", "never"),
        default="auto",
        group="Estimate",
    )
    closed_loop: str | None = option(
        "For data from a closed loop: direct (a model of the disturbance makes it consistent; needs delay or no "
        "feedthrough in the loop), or the column with a reference that was recorded; by default the data are taken as "
        "from an open loop, with a warning where they are not.",
        metavar="direct|COLUMN",
        default=None,
        group="Estimate",
    )
    noise: _Noise = option(
        "States of the disturbance in the refined model, 0 for a white one; shared: it has the plant's poles.",
        default="auto",
        group="Estimate",
    )
    detrend: str = option(
        "Trend to remove from the data before the fit.",
        choices=("mean", "linear", "none"),
        default="mean",
        group="Data",
    )
    settle: float = option(
        "Time to cut off at the beginning.", unit="s", metavar="T", least=0.0, default=0.0, group="Data"
    )
    dt: float | None = option(
        "Sampling interval of a file without times.", unit="s", metavar="S", positive=True, default=None, group="Data"
    )
    lags: int | None = option(
        "Number of lags in the residual tests; by default 25.",
        unit="samples",
        metavar="N",
        default=None,
        group="Validation",
    )
    lin: LinResult | LinearModel | File | None = option(
        "Linear model to compare the frequency response with.",
        metavar="LIN.JSON",
        form=FILE,
        default=None,
        group="Validation",
    )
    nfr: NfrResult | File | None = option(
        "Nonlinear frequency response to compare the frequency response with.",
        metavar="NFR.JSON",
        form=FILE,
        default=None,
        group="Validation",
    )
    amplitude: float | None = option(
        "Amplitude to use from a nonlinear frequency response with several amplitudes.",
        metavar="A",
        default=None,
        group="Validation",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.amplitude is not None and self.nfr is None:
            raise InputError("amplitude: it selects one of nfr, which is missing")
        if self.noise not in ("auto", "shared") and not (isinstance(self.noise, int) and self.noise >= 0):
            raise InputError(f"noise must be auto, shared or a number of states, 0 (white) or more, not {self.noise!r}")
        if self.gains and self.refine == "never":
            raise InputError("gains: they are held by the refinement, which refine=never rules out")
        if self.closed_loop is not None and self.refine == "never":
            raise InputError("closed_loop: refine=never leaves the subspace model, which is biased in a closed loop")
        if self.noise != "auto" and self.refine == "never":
            raise InputError("noise: it is a model of the disturbance for the refinement, which refine=never rules out")

    def went_well(self, record: IdentifyResult) -> bool:
        """Return whether the model has a simulation on all data.

        Args:
            record: of this request.
        """
        return not record.failed


identify = function(Identify)

"""Parameters of a model from measured data: what can be asked."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

from workbench.core.records.forms import FILES, ONE, SPAN, File, Form, Layout, Limits, Names, Values, table
from workbench.core.records.names_in_text import split_names
from workbench.core.records.option import EACH, option
from workbench.core.records.quantity import alike, amount, shortest
from workbench.core.values.operating_point import AtPoint
from workbench.errors import InputError
from workbench.jobs.options import InWorkers
from workbench.requests.request import ModelRequest, function

if TYPE_CHECKING:
    from workbench.data.bla.result import BlaResult
    from workbench.data.experiment.experiment import Experiment
    from workbench.identification.calibrate.result import CalibrateResult
    from workbench.response.nfr.result import NfrResult

__all__ = ["Calibrate", "Free", "calibrate"]

_OPEN = (-math.inf, math.inf)
_WRITTEN = (".toml", ".ssp")
_NEXT = "Next experiment"


def _named(texts: Sequence[str]) -> dict[str, str]:
    """Return name → what stands behind its equals sign; empty: there is none."""
    result: dict[str, str] = {}
    for name, _, value in (part.partition("=") for text in texts for part in split_names(text)):
        if not name.strip():
            raise ValueError(f"'{value}' has no name before it")
        if name.strip() in result:
            raise ValueError(f"'{name.strip()}' is given twice")
        result[name.strip()] = value.strip()
    return result


def _by_name(value: Any) -> dict[str, Any]:  # noqa: ANN401 - what Python or a TOML file holds
    """Return names, alone or each with a value; None: it has none."""
    if isinstance(value, Mapping):
        return table(value)
    names = [value] if isinstance(value, str) else list(value)
    if (wrong := next((x for x in names if not isinstance(x, str)), None)) is not None:
        raise ValueError(f"{wrong!r} is not a name")
    return dict.fromkeys(names)


def _range(name: str, value: Any) -> tuple[float, float]:  # noqa: ANN401 - as above
    if not value and not isinstance(value, int | float):
        return _OPEN
    parts = value.split(":") if isinstance(value, str) else value
    if isinstance(parts, int | float) or len(parts) != 2:
        form = "of the form LO:HI, as in 1:10" if isinstance(value, str) else "a pair of limits, as in (1, 10)"
        raise ValueError(f"{name}: {value!r} is not {form}")
    low, high = alike(amount(part) if part not in ("", None) else end for part, end in zip(parts, _OPEN, strict=True))
    units = {getattr(x, "unit", "") for x in (low, high) if math.isfinite(x)}
    if len(units) < 2 and not low < high:  # in different units, the model will tell
        raise ValueError(f"{name}: {shortest(low)}:{shortest(high)} is not of the form LO:HI with LO < HI")
    return low, high


def _ends(limits: tuple[float, float]) -> str:
    return ":".join("" if math.isinf(x) else shortest(x) for x in limits)


def _named_values(value: Any, join: Any) -> list[str]:  # noqa: ANN401
    return [f"{name}={text}" if (text := join(x)) not in ("", ":") else name for name, x in value.items()]


_INNER = replace(SPAN, split=lambda texts: texts[-1])
_FREE = Form(
    metavar="NAME[=LO:HI]",
    read=lambda value: {name: _range(name, x) for name, x in _by_name(value).items()},
    layout=Layout(kind="names", split=_named, join=lambda value: _named_values(value, _ends), inner=_INNER),
    items=("number", "string", "null"),
    repeated=True,
    infinite=True,
)
_CHANNELS = Form(
    metavar="NAME[=COLUMN]",
    read=lambda value: {name: str(x or name) for name, x in _by_name(value).items()},
    layout=Layout(kind="names", split=_named, join=lambda value: _named_values(value, str), inner=ONE),
    repeated=True,
)

if TYPE_CHECKING:
    Free = Mapping[str, tuple[float | None, float | None] | str | None] | Sequence[str]
    _Channels = Mapping[str, str] | Sequence[str]
    _Set: TypeAlias = Experiment | NfrResult | BlaResult | str | Path
    _Data: TypeAlias = _Set | Sequence[_Set]
else:
    Free = Annotated[object, _FREE]
    _Channels = Annotated[object, _CHANNELS]
    _Data = Annotated[object, FILES]


class Calibrate(AtPoint, InWorkers, ModelRequest["CalibrateResult"]):
    """Estimate parameters of an FMU or a system from measured data, and say what the data can and cannot tell of them.

    The model is run with the measured inputs; its parameters θ are those with the least Σ ρ(e²), where e is the
    difference of measured and computed output over the standard deviation σ of the noise, freed of its colour: an
    autoregressive model of the noise is estimated from the residuals (output error with a noise model). Search: a
    trust region within the limits, with gradients by differences of runs that share the solver's steps; parameters are
    set before a run is initialised. A positive parameter with limits over a decade is searched for by its
    logarithm. A run that fails counts as infinitely bad.

    With the whitened sensitivities J the covariance of the parameters is (JᵀJ)⁻¹. What JᵀJ does not see is named: a
    parameter that does not act, or several that trade off. The 95 % region of each parameter follows from the
    covariance; two runs at its ends tell whether the region is an ellipse, and `profile` follows the likelihood.

    Not for a model whose errors are larger than the noise: then the regions hold what fits best, not the truth, and
    the tests of the residuals say so. Not for the structure of a model (`identify` makes one), nor for parameters that
    are whole numbers or switches.

    Returns:
        The parameters with their regions, what is not in the data, fits, tests of the residuals.

    Raises:
        InputError: unknown name, data that cannot be read or do not fit the model, nothing measured, no input that
            moves.
        FmuError, SimulationError: the model cannot be run at any of the start values.

    Source: L. Ljung, System Identification, 2nd ed. (1999), sections 7.2 and 9.4; E. Walter & L. Pronzato,
    Identification of Parametric Models from Experimental Data (1997), chapters 3 to 5; A. Raue et al., Bioinformatics
    25 (2009), for profile likelihoods.

    Examples:
        The time constant of a lag from its response to steps.

        >>> with wb.load("fmu:FirstOrderLag", start_values={"tau": 2.0}) as lag:
        ...     data = wb.excite(lag, "u", "y", dt=0.1, samples=200).identification
        >>> with wb.load("fmu:FirstOrderLag") as lag:
        ...     found = wb.calibrate(lag, data, free={"tau": (0.1, 10.0)})
        >>> print(f"{found.parameters[0].value:.3f}")
        2.000
    """

    command = "calibrate"
    algorithm = "workbench.identification.calibrate.run:run"
    example = (
        "workbench calibrate fmu:Rudder rig.csv --free viscous=200:20000 --free tauSpool=1ms:50ms --input delC "
        "--output del --report rudder.html"
    )
    counts = "runs"
    usual_tolerance = 1e-8
    isolated = False  # its runs are made in worker processes: one that crashes is a value of the search
    subject = replace(ModelRequest.subject, rest="data")

    data: _Data = option(
        "Measured data: records over time (CSV, .mat, .parquet, .feather, .mf4) or frequency responses (JSON of nfr or "
        "bla, tables, .mat).",
        metavar="DATA,..",
        first=True,
    )
    writes = ("out",)

    _: KW_ONLY
    free: Free = option("Parameter to estimate, with its limits where they are known.", of=EACH, first=True)
    inputs: _Channels | None = option(
        "Input that was measured, with its column; by default every input that is the name of a column.",
        flag="--input",
        default=None,
        first=True,
    )
    outputs: _Channels | None = option(
        "Output that was measured, with its column; by default every other variable that is the name of a column.",
        flag="--output",
        default=None,
        first=True,
    )
    initial: str = option(
        "Where each run starts: model (start values, or the operating point), rest (in equilibrium with the first "
        "values of the inputs, found anew for all parameters), or free (states are estimated, for each file).",
        choices=("model", "rest", "free"),
        default="model",
        first=True,
    )
    states: Limits | None = option(
        "State whose initial value is estimated for each file, with its limits.",
        flag="--initial-state",
        of=EACH,
        default=None,
    )
    validation: _Data | None = option(
        "Other data, which the model with the estimated parameters is compared with.",
        flag="--validate",
        metavar="DATA2,..",
        default=None,
        first=True,
    )
    weights: Values | None = option(
        "Standard deviation of an output's noise, where it is known; then χ² tells whether the model explains the "
        "data.",
        flag="--weight",
        of=EACH,
        metavar="Y=SIGMA",
        default=None,
        first=True,
    )
    loss: str = option(
        "Weight of large residuals: gauss (squares), huber or student (few outliers hardly count).",
        choices=("gauss", "huber", "student"),
        default="gauss",
        first=True,
    )
    noise: str = option(
        "Colour of the noise: auto (an autoregressive model of the order that the residuals ask for) or white.",
        choices=("auto", "white"),
        default="auto",
    )
    biases: Names = option(
        "Output whose sensor has an unknown constant bias.", flag="--sensor-bias", metavar="Y", default=()
    )
    scales: Names = option("Output whose sensor has an unknown scale.", flag="--sensor-scale", metavar="Y", default=())
    delays: Values | None = option(
        "Known delay of an output's sensor [s].", flag="--sensor-delay", metavar="Y=S", default=None
    )
    interpolate: str = option(
        "What a measured input does between its samples: hold (of a digital controller), linear (of a signal that was "
        "sampled, or is a Table of `simulate`), or auto: what explains the data better; hold where they do not tell.",
        choices=("auto", "hold", "linear"),
        default="auto",
    )
    dt: float | None = option(
        "Sampling interval of files without times.", unit="s", metavar="S", positive=True, default=None
    )
    starts: int = option(
        "Number of further searches, from a Sobol' sequence within the limits.", metavar="N", least=0, default=0
    )
    profile: bool = option("Follow the likelihood to the ends of each parameter's region.", default=False)
    bootstrap: int = option(
        "Take the regions from so many records of the estimated model with noise drawn anew; 200 or more.",
        metavar="N",
        least=0,
        default=0,
    )
    store: File | None = option(
        "Folder in which runs are kept; the same command continues from there.", metavar="DIR", default=None
    )
    next_inputs: Values | None = option(
        "Input of a further experiment, with its amplitude: the signal is found that narrows the regions most.",
        flag="--next",
        of=EACH,
        change=True,
        metavar="U=AMPLITUDE",
        default=None,
        group=_NEXT,
    )
    next_samples: int | None = option(
        "Length of that experiment; by default that of the first data.",
        metavar="N",
        least=16,
        default=None,
        group=_NEXT,
    )
    next_rate: Values | None = option(
        "Largest rate of such an input, in its unit per second.", metavar="U=RATE", default=None, group=_NEXT
    )
    next_criterion: str = option(
        "What is made small: D (volume of all regions) or A (sum of their squares).",
        choices=("D", "A"),
        default="D",
        group=_NEXT,
    )
    out: File | None = option(
        "Write a system file, .toml or .ssp, of the model with the estimate; build makes an FMU of it.", default=None
    )
    max_runs: int = option("Largest number of runs of the model in the search.", metavar="N", least=1, default=5000)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.free:
            raise InputError("free: name a parameter to estimate")
        if self.out is not None and Path(self.out).suffix.lower() not in _WRITTEN:
            raise InputError(f"out: {self.out} is neither .toml nor .ssp; workbench build makes an FMU of such a file")
        if self.states and self.initial != "model":
            raise InputError(f"states: initial is {self.initial}, which says where all states start; leave one out")

    def went_well(self, record: CalibrateResult) -> bool:
        """Return whether the search came to its end.

        Args:
            record: of this request.
        """
        return record.converged


calibrate = function(Calibrate)

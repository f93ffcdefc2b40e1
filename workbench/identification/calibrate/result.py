"""What data say of a model's parameters."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from workbench.core.records.record import RecordPart, entry
from workbench.core.values.arrays import Floats
from workbench.core.values.operating_point import OperatingPoint
from workbench.identification.validate.residuals import Autocorrelation, CrossCorrelation, OutputFit, fit_of
from workbench.show.result import Result

__all__ = [
    "CalibrateResult",
    "CalibratedParameter",
    "ChiSquared",
    "DataFit",
    "NextExperiment",
    "OutputNoise",
    "ParameterProfile",
    "TriedSignal",
]


@dataclass(frozen=True, eq=False, kw_only=True)
class ParameterProfile(RecordPart):
    """Profile likelihood of a parameter.

    Attributes:
        values: of the parameter, rising, shape (k,).
        cost: least cost over all other parameters, above that of the estimate; 1 at the ends of the 95 % region,
            shape (k,).
    """

    values: Floats
    cost: Floats = field(metadata=entry(dims=("values",)))


@dataclass(frozen=True, kw_only=True)
class CalibratedParameter(RecordPart):
    """One number that was estimated.

    Attributes:
        name: parameter; or what else was estimated, in words.
        kind: "parameter", "state" (initial value), "bias" or "scale" (of a sensor).
        unit: of all values; None: it has none.
        start: value at which the search began.
        value: estimate.
        std_error: standard error, with what the integration of the model leaves; None: held by a limit, or not known.
        low, high: ends of the 95 % region; None: likewise.
        at_bound: whether a limit holds it; the other regions then take it as known.
        identifiable: whether the region is narrower than the value itself (a positive one: than a factor e).
        curved: whether the region is not that of an ellipse, as runs at its ends show; None: not looked at.
        profile: its profile likelihood, which then gives the ends; None: it was not asked for.
    """

    name: str
    kind: str
    unit: str | None
    start: float
    value: float
    std_error: float | None
    low: float | None
    high: float | None
    at_bound: bool
    identifiable: bool
    curved: bool | None = None
    profile: ParameterProfile | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class DataFit(RecordPart):
    """Data beside the model.

    Attributes:
        name: of the data.
        input_names: of the inputs that the data move.
        output_names: names.
        output_units: None where there is none.
        time: shape (n,) [s].
        measured: shape (n, p); NaN where a sample is missing.
        before: computed with the start values, shape (n, p); NaN: that run failed.
        computed: with the estimate, shape (n, p).
        band: ± this holds the true output in 95 % of cases as far as the parameters' errors go, shape (n, p); NaN: not
            known.
        fits: one for each output.
        autocorrelation: of the residuals freed of the noise's colour, with its verdict; None: not tested.
        cross: of these residuals and the inputs, likewise.
        remark: why nothing was tested; empty otherwise.
        of_response: whether the data are a frequency response: its outputs are real and imaginary parts, and `time`
            is the frequency [Hz].
    """

    name: str
    input_names: tuple[str, ...] = ()
    output_names: tuple[str, ...]
    output_units: tuple[str | None, ...]
    time: Floats = field(metadata=entry(dims=("time",), unit="s"))
    measured: Floats = field(metadata=entry(dims=("time", "output_names")))
    before: Floats = field(metadata=entry(dims=("time", "output_names")))
    computed: Floats = field(metadata=entry(dims=("time", "output_names")))
    band: Floats = field(metadata=entry(dims=("time", "output_names")))
    fits: tuple[OutputFit, ...]
    autocorrelation: Autocorrelation | None = None
    cross: CrossCorrelation | None = field(default=None, metadata=entry(key="cross_correlation"))
    remark: str = ""
    of_response: bool = False

    @property
    def words(self) -> tuple[str, ...]:
        """Fits and verdicts, one line each."""
        tests = [] if self.autocorrelation is None else [self.autocorrelation.words]
        tests += [] if self.cross is None else [self.cross.words[0]]
        return (*(fit.words for fit in self.fits), *tests, *filter(None, [self.remark]))


@dataclass(frozen=True, kw_only=True)
class OutputNoise(RecordPart):
    """Noise v of an output, v(k) = Σ aᵢ v(k − i) + e(k).

    Attributes:
        output: its name.
        sigma: standard deviation of the white e [unit of the output].
        colour: a; empty: v is white.
        given: whether σ was given, else it was estimated.
    """

    output: str
    sigma: float
    colour: tuple[float, ...]
    given: bool


@dataclass(frozen=True, kw_only=True)
class ChiSquared(RecordPart):
    """Whether residuals are as large as the noise that was given.

    Attributes:
        value: sum of the squares of the residuals over σ².
        degrees: of freedom.
        p_value: probability of so large a sum, or a larger one, if the model is true and so is σ.
    """

    value: float
    degrees: int
    p_value: float


@dataclass(frozen=True, kw_only=True)
class TriedSignal(RecordPart):
    """A signal that was considered.

    Attributes:
        signal: as `excite` takes it: the kind, and its design.
        criterion: what is to be large; None: the model cannot be run with it.
    """

    signal: str
    criterion: float | None


@dataclass(frozen=True, kw_only=True)
class NextExperiment(RecordPart):
    """The experiment that would narrow the regions most.

    Attributes:
        inputs: that are forced, about their means in the data.
        signal: as `excite` takes it: the kind, and its design.
        dt: sampling interval [s].
        samples: how many.
        criterion: "D" or "A".
        narrower: parameter → standard error with the data and this experiment, over that with the data alone.
        tried: all signals.
    """

    inputs: tuple[str, ...]
    signal: str
    dt: float
    samples: int
    criterion: str
    narrower: dict[str, float]
    tried: tuple[TriedSignal, ...]

    @property
    def words(self) -> tuple[str, ...]:
        """The experiment, and what it would bring."""
        shrink = ", ".join(f"{name} {100.0 * ratio:.0f} %" for name, ratio in self.narrower.items())
        names = ",".join(self.inputs)
        return (
            f"workbench excite … --input {names} --{self.signal} --step {self.dt:g} --samples {self.samples}",
            f"standard errors with it, of those without: {shrink}",
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class CalibrateResult(Result):
    """Parameters of a model from measured data.

    Attributes:
        model, interface, solver: what was run.
        parameters: one for each number that was estimated.
        correlation: of the estimates, shape (q, q); NaN where nothing is known.
        not_identifiable: what the data do not tell, one line each: parameters that do not act, or that trade off.
        data: one for each data set.
        validation: likewise of the other data.
        noise: one for each output.
        chi_squared: None: the noise was not given.
        loss: how residuals counted.
        runs: runs of the model.
        failed_runs: how many of them failed.
        reason: why the search ended.
        converged: whether it came to its end.
        between_samples: what inputs were taken to do there: "hold" or "linear".
        doubt: what it would change if they did the other; empty: nothing, or the data tell that they did not. Where
            nobody said which, and the data do not, regions hold both.
        next_experiment: None: it was not asked for.
        notes: what should be known, one line each.
        operating_point: where the first run began; None: not known.
    """

    _page = "workbench.identification.calibrate.page:calibrate_page"
    _picture = "workbench.identification.calibrate.picture:plot_calibration"

    model: str
    interface: str
    solver: str
    parameters: tuple[CalibratedParameter, ...]
    correlation: Floats = field(metadata=entry(dims=("parameter", "parameter")))
    not_identifiable: tuple[str, ...]
    data: tuple[DataFit, ...]
    validation: tuple[DataFit, ...]
    noise: tuple[OutputNoise, ...]
    chi_squared: ChiSquared | None
    loss: str
    runs: int
    failed_runs: int
    reason: str
    converged: bool
    between_samples: str
    doubt: str = ""
    next_experiment: NextExperiment | None = None
    notes: tuple[str, ...] = ()
    operating_point: OperatingPoint | None = None

    _WHAT, _COMMAND = "a calibration", "calibrate"

    def of(self, name: str) -> CalibratedParameter:
        """Return what was found of one number.

        Args:
            name: of it.
        """
        return next(p for p in self.parameters if p.name == name)

    @property
    def values(self) -> dict[str, float]:
        """Parameter → estimate, as `start_values` takes them."""
        return {p.name: p.value for p in self.parameters if p.kind == "parameter"}

    @property
    def misfit(self) -> str:
        """Which test says that the residuals are not noise alone, so that regions may not hold; empty: none does."""
        for one in self.data:
            if one.cross is not None and one.cross.undermodelled:
                return f"{one.name}: the input is still visible in the residuals"
            if one.autocorrelation is not None and one.autocorrelation.p_value < _NO_CHANCE:
                return f"{one.name}: the residuals are not noise, p = {one.autocorrelation.p_value:.2g}"
        return ""

    @property
    def fit_percent(self) -> dict[str, float]:
        """Output → fit over all data [%]."""
        return _joint(self.data)

    def derived(self) -> dict[str, Any]:
        """Return the fits over all data, and the verdicts.

        Keys:
            fit_percent: output → fit over all data [%].
            validation_fit_percent: output → fit over the other data [%].
            residuals: fits and tests of each data set, in sentences.
            misfit: what says that the model misses something, so that regions may not hold; empty: nothing does.
            set: parameter → estimate, as `--set` takes them.
        """
        return {
            "fit_percent": self.fit_percent, "validation_fit_percent": _joint(self.validation),
            "residuals": {one.name: one.words for one in self.data}, "misfit": self.misfit,
            "set": self.values,
        }  # fmt: skip

    def column_units(self) -> Mapping[str, str | None]:
        """Return the units of the table's columns: those of each row stand in it."""
        return {}

    def rows(self) -> Iterator[Sequence[Any]]:
        """Yield one row for each number that was estimated."""
        yield ("parameter", "unit", "start", "value", "standard error", "low", "high", "at bound", "identifiable")
        for p in self.parameters:
            yield (
                p.name, p.unit or "", p.start, p.value, p.std_error, p.low, p.high, p.at_bound, p.identifiable,
            )  # fmt: skip


def _joint(data: Sequence[DataFit]) -> dict[str, float]:
    result = {}
    for name in dict.fromkeys(n for one in data for n in one.output_names):
        own = [(one, one.output_names.index(name)) for one in data if name in one.output_names]
        measured, computed = (np.concatenate([getattr(o, side)[:, k] for o, k in own]) for side in _SIDES)
        there = np.isfinite(measured)
        result[name] = fit_of(name, measured[there], computed[there]).fit_percent
    return result


_SIDES = ("measured", "computed")
_NO_CHANCE = 1e-3  # of white residuals: in no more than one of a thousand right models an estimate is doubted for it

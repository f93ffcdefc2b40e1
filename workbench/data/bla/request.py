"""Best linear approximation of a model: what can be asked."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import KW_ONLY, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from workbench.core.records.forms import FILES, Amounts, Band, File
from workbench.core.records.option import Options, option, options_of, recast
from workbench.core.values.operating_point import AtPoint
from workbench.errors import InputError
from workbench.model.loading import Loading
from workbench.requests.request import ModelRequest, Request, Subject, function
from workbench.response.nfr.frequency_grid import positive_values

if TYPE_CHECKING:
    from workbench.data.bla.result import BlaResult
    from workbench.data.experiment.experiment import Experiment
    from workbench.jobs.job import Job
    from workbench.model import Model

__all__ = ["BestLinear", "Bla", "best_linear", "bla"]


if TYPE_CHECKING:
    _Files = Sequence[File]
else:
    _Files = Annotated[object, FILES]

_RMS = "Root mean squares of the multisine, each measured; in the unit of the input or in one of their own, as 0.05rad."
_RECORDED = "Recorded data"
_NOT_DATA = (".fmu", ".toml", ".ssp")


def is_data(given: str | Path) -> bool:
    """Return whether a name is that of a file of recorded data, not of a model.

    Args:
        given: as the command line has it.
    """
    path = Path(given)
    return path.suffix.lower() not in _NOT_DATA and path.is_file()


class _InputOutput(Options):
    input: str = option("Input to force. Other inputs keep their value at the operating point.", metavar="U")
    output: str = option("Output to record, or any other variable.", metavar="Y")
    _: KW_ONLY
    transient: int = option(
        "Number of periods before those evaluated, until the response is periodic.", least=0, default=1
    )


class _Multisine(Options):
    _: KW_ONLY
    lines: str = option(
        "Which lines are excited: random-odd (odd ones, one of four left out at random, which show odd distortion), "
        "odd, or all (which tells no odd from even).",
        choices=("random-odd", "odd", "all"),
        default="random-odd",
    )
    realisations: int = option("Number of different random phases.", metavar="M", least=2, default=7)
    measured_periods: int = option("Number of recorded periods of each.", metavar="P", least=2, default=2)
    dt: float | None = option(
        "Sampling interval; by default an eighth of the shortest period, or the period of a sampled model.",
        unit="s",
        flag="--step",
        metavar="DT",
        positive=True,
        default=None,
    )
    seed: int = option("Seed of the phases and of the lines left out.", least=0, default=1)


class BestLinear(Request["Sequence[Experiment]", "BlaResult"]):
    """Return the best linear approximation of recorded data.

    An experiment has one realisation of the phases or several, one after the other, each for some whole periods: where
    the input of a period is not that of the one before, another begins. Excited lines are those where the input has
    power beyond its noise. One realisation alone suffices where odd lines are left out among them.

    Returns:
        As `bla`; the offset is not known, as the output at rest is not.

    Raises:
        InputError: other channels, intervals or lines, an input that does not repeat, too few periods.

    Examples:
        >>> import numpy as np
        >>> rng, t = np.random.default_rng(0), np.arange(64)
        >>> def one():
        ...     u = sum(np.cos(2 * np.pi * k * t / 64 + rng.uniform(0, 6.3)) for k in (1, 3, 5, 7))
        ...     return wb.make_experiment(0.1, np.tile(u, 2), np.tile(2 * u, 2))
        >>> print(wb.best_linear([one(), one(), one()], period=6.4).response[0].round(6).real)
        [2. 2. 2. 2.]
    """

    command = "bla"
    called = "best_linear"
    algorithm = "workbench.data.bla.recorded:run"
    in_shell = False
    example = "workbench bla recorded.csv --input u --output y --period 10.24"
    counts = "steps"
    subject = Subject(
        name="experiments",
        type="Sequence[Experiment]",
        help="One input and one output each, at the same power and the same lines.",
        metavar="DATA",
        words="Files of recorded data.",
        several=True,
    )

    _: KW_ONLY
    period: float = option("Period of the multisine.", unit="s", positive=True)
    transient: int = option("Number of periods to leave out at the beginning of each realisation.", least=0, default=0)
    name: str = option("What the data come from.", default="data")


class Bla(_Multisine, AtPoint, _InputOutput, ModelRequest["BlaResult"]):
    """Measure the best linear approximation, and what it leaves out: noise, odd and even distortion.

    Random-phase multisines of a chosen power, several realisations of the phases and several periods of each. The
    response Y/U averaged over realisations is the linear model with the least mean-square error for signals of this
    power and spectrum. What changes from period to period is noise; what changes from realisation to realisation
    beyond that is nonlinear distortion; what appears at lines that are not excited shows whether it is odd or even.

    Of the sampled model whose input is held, as `identify` finds it. Not for models that do not answer a periodic input
    with its period (subharmonics, chaos): they look noisy. Not a describing function: that is of a single sine (`nfr`).

    Returns:
        Response with 95 % errors, levels of noise and distortion, and up to which power a linear model is worth having.

    Raises:
        InputError: unknown name, a band that does not fit, an operating point of another model.
        FmuError: the FMU cannot be instantiated.
        SimulationError: the model failed while running.

    Source: R. Pintelon and J. Schoukens, System Identification: A Frequency Domain Approach, 2nd ed., chapters 3 to 5.

    Examples:
        A lag is linear: no distortion, and the gain of its sampled model, 1 − exp(−dt) over z − exp(−dt).

        >>> import numpy as np
        >>> with wb.load("fmu:FirstOrderLag") as lag:
        ...     found = wb.bla(lag, "u", "y", rms=[1.0], band=(0.05, 1.0), realisations=2)
        >>> z = np.exp(2j * np.pi * found.frequency_hz * found.dt)
        >>> a = math.exp(-found.dt)
        >>> print(np.allclose(found.response[0], (1 - a) / (z - a), atol=1e-5))
        True
    """

    command = "bla"
    algorithm = "workbench.data.bla.run:run"
    example = "workbench bla fmu:Rudder --input delC --output del --band 0.2:10 --rms 1,5,20 --plot rudder_bla.png"
    usual_tolerance = 1e-8
    counts = "realisations"

    _: KW_ONLY
    rms: Amounts = option(_RMS, of="input", change=True, metavar="R,..")
    band: Band = option("Lowest and highest frequency; lines are as far apart as the lowest.", unit="Hz")

    def __post_init__(self) -> None:
        super().__post_init__()
        positive_values("rms", self.rms, unit="unit of the input")
        low, high = self.band
        if not 0.0 < low < high:
            raise InputError(f"band must rise from above 0 Hz, not be {low:g}:{high:g}")


class BlaCommand(_Multisine, AtPoint, _InputOutput, ModelRequest["BlaResult"]):
    """Measure the best linear approximation, and what it leaves out: noise, odd and even distortion.

    Of a model, by multisines of the root mean squares and in the band asked for; or of recorded data, whose input
    repeats with a known period.
    """

    command = "bla"
    algorithm = ""
    example = Bla.example
    details = (
        "In place of MODEL, a file of recorded data with columns --input and --output; --period is that of the "
        "multisine. Where its phases change, another realisation begins; the first --transient periods of each are "
        "left out. "
        "--step is needed where the file has no times."
    )
    subject = replace(
        ModelRequest.subject,
        words=f"{ModelRequest.subject.words.removesuffix('.')}; or a file of recorded data (CSV, .mat, …).",
    )
    usual_tolerance = Bla.usual_tolerance
    counts = Bla.counts
    needs = ("rms", "band")

    _: KW_ONLY
    rms: Amounts | None = option(_RMS, of="input", change=True, metavar="R,..", default=None, first=True)
    band: Band | None = option(
        "Lowest and highest frequency; lines are as far apart as the lowest.", unit="Hz", default=None, first=True
    )
    period: float | None = option(
        "Period of the multisine in recorded data.",
        unit="s",
        metavar="T",
        positive=True,
        default=None,
        group=_RECORDED,
        first=True,
    )
    also: _Files | None = option(
        "More files, with other realisations of the phases at the same power.",
        metavar="DATA,..",
        default=None,
        group=_RECORDED,
    )

    @classmethod
    @contextmanager
    def opened(cls, given: str | Path, loading: Loading) -> Iterator[tuple[Model | Path, tuple[str, ...]]]:
        """Yield the model, or the path of recorded data.

        Args:
            given: what a command line or a study names.
            loading: how a model is opened.

        Raises:
            InputError: options of models with recorded data.
        """
        if not is_data(given):
            with super().opened(given, loading) as result:
                yield result
            return
        plain = cls.loading({})
        for declared in options_of(Loading):
            if getattr(loading, declared.name) != getattr(plain, declared.name):
                raise InputError(f"{declared.flag} is for models, and {given} is recorded data; leave it out")
        yield Path(given), ()

    def run(self, subject: Model | Path, job: Job) -> BlaResult:
        """Run the request that is meant.

        Args:
            subject: a model, which stays open, or the path of recorded data.
            job: is told what is finished.

        Raises:
            InputError: an option is missing, or is for the other.
        """
        recorded = isinstance(subject, Path)
        left = (
            ("period", "also")
            if not recorded
            else ("lines", "realisations", "measured_periods", "seed", "rms", "band", "at")
        )
        for declared in options_of(BlaCommand):
            if declared.name in left and getattr(self, declared.name) != declared.default:
                what = f"models, and {subject} is recorded data" if recorded else "recorded data, not for models"
                raise InputError(f"{declared.flag} is for {what}; leave it out")
        needed = ("period",) if recorded else ("rms", "band")
        for name in needed:
            if getattr(self, name) is None:
                raise InputError(f"--{name} is missing: {'recorded data need' if recorded else 'models need'} it")
        if isinstance(subject, Path):
            return recast(BestLinear, self, name=subject.name).run(self._read(subject), job)
        return recast(Bla, self).run(subject, job)

    def _read(self, path: Path) -> list[Experiment]:
        from workbench.data.experiment.experiment import read_experiment  # noqa: PLC0415 - numerics

        files = (path, *(self.also or ()))
        return [read_experiment(f, inputs=[self.input], outputs=[self.output], dt=self.dt) for f in files]


bla = function(Bla)
best_linear = function(BestLinear)

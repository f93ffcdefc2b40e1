"""Time histories: what can be asked."""

from __future__ import annotations

from dataclasses import KW_ONLY
from typing import TYPE_CHECKING

from workbench.core.records.forms import ARRAY, Names, Numbers
from workbench.core.records.option import option
from workbench.core.values.operating_point import AtPoint
from workbench.errors import InputError
from workbench.requests.request import ModelRequest, function
from workbench.signals.text import Signals

if TYPE_CHECKING:
    from workbench.jobs.job import Job
    from workbench.model import Model
    from workbench.response.simulate.result import SimulationResult

__all__ = ["Simulate", "simulate"]

_VERY_MANY = 1e7  # steps: from seconds to hours, by the FMU


class Simulate(AtPoint, ModelRequest["SimulationResult"]):
    """Simulate under given inputs and record a time history.

    A forced input has the values of its signal, not those of the operating point. Events are recorded in addition to
    the requested points.

    Returns:
        The time history; `ended_at` tells where an FMU ended its own run.

    Raises:
        InputError: unknown name, an output forced, times or points out of order.
        FmuError: the FMU cannot be instantiated.
        SimulationError: the model failed while running; its `before` is the result up to then.
        DivergenceError: likewise, because something grew without bound: what, whether exponentially or to infinity
            in finite time, and when. Unless `points` names them, rows are added that show how, ever more densely.

    Examples:
        The step response of 1/(s + 1) is 1 - exp(-t).

        >>> with wb.load("fmu:FirstOrderLag") as lag:
        ...     run = wb.simulate(lag, stop=1.0, inputs={"u": 1})
        >>> print(f"{run.signals['y'][-1]:.4f}")
        0.6321
    """

    command = "simulate"
    algorithm = "workbench.response.simulate.run:run"
    example = "workbench simulate fmu:Rudder --stop 1 --input delC=step:time=0.1,value=2 --output del --plot del.png"

    counts = "percent of the run"
    undivided = True

    instead = {"interval": "step"}  # noqa: RUF012 - as its annotation in `Request` says

    _: KW_ONLY
    stop: float | None = option(
        "End of the run; by default that of the FMU's default experiment.",
        unit="s",
        metavar="T",
        default=None,
        first=True,
    )
    inputs: Signals = option(
        "Force an input: a number, with a unit or without (2deg), sine:amplitude=1,frequency=2, step:time=1,value=2, "
        "file.csv; of an enumeration or a Boolean the name of a value, as Off or true. Other inputs keep their start "
        "value or that of the operating point.",
        flag="--input",
        default_factory=dict,
        first=True,
    )
    outputs: Names | None = option(
        "Variables to record; by default all outputs, or, if there are none, all states, or all local variables.",
        flag="--output",
        metavar="NAME",
        default=None,
        first=True,
    )
    start_time: float | None = option(
        "Start of the run; by default the time of the operating point, or the model's start time.",
        unit="s",
        python=True,
        default=None,
    )
    interval: float | None = option(
        "Interval between recorded points; by default the step of the default experiment, doubled until there are at "
        "most 5000 points (co-simulation: a multiple of the communication step), or 1/500 of the run.",
        unit="s",
        python=True,
        default=None,
    )
    points: Numbers | None = option(
        "Times to record beside the start, rising, instead of an interval.",
        unit="s",
        python=True,
        form=ARRAY,
        default=None,
    )
    verify_step: bool = option(
        "Co-simulation: repeat the run with half the communication step, and report outputs that change by more than "
        "1 %.",
        default=True,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.points is not None and self.interval is not None:
            raise InputError("points: are recorded instead of rows at an `interval`; give one of the two")

    def run(self, subject: Model, job: Job) -> SimulationResult:
        """Simulate, after a word where that takes very many steps.

        Args:
            subject: the model; it stays open.
            job: is told what is finished.
        """
        if words := self._very_long(subject):
            job.say(words)
        return super().run(subject, job)

    def _very_long(self, model: Model) -> str:
        """Return how many steps there are to be made where they are very many, and known; empty: they are not."""
        from workbench.model.described_model import DescribedModel  # noqa: PLC0415 - it is loaded, as the model is open

        stop = model.stop_time if self.stop is None else self.stop
        if stop is None or not isinstance(model, DescribedModel) or (step := model.shortest_step) is None:
            return ""
        start = model.start_time if self.start_time is None else self.start_time
        if not (count := (stop - start) / step) > _VERY_MANY:
            return ""
        other = ", or `interface=me`, which chooses its steps" if "me" in model.description.interfaces else ""
        return f"{count:.1g} steps of {step:g} s to stop {stop:g} s may take very long; give `stop`{other}"


simulate = function(Simulate)

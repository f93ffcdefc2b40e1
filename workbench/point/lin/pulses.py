"""Runs of a black box from its operating point: pulses at its inputs, and what its outputs answer."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.core.values.operating_point import OperatingPoint
from workbench.errors import InputError, SimulationError
from workbench.fmi.variable import FLOAT_TYPES
from workbench.jobs.job import SLOW, Job
from workbench.model import DescribedModel, Model
from workbench.model.names import check_variables
from workbench.point.lin.columns import relative_width, total_width
from workbench.point.lin.intersample import PARTS, periods_needed
from workbench.point.lin.realisation import Realisation
from workbench.point.lin.result import Doubt
from workbench.point.lin.task import LinTask, width_for
from workbench.point.lin.validation_run import MoveTrial, trial_levels
from workbench.point.scales import INTEGRATION, MODELS_OWN_ERROR
from workbench.session.base import Recorded, Session
from workbench.signals.kinds import Constant, Signal

__all__ = ["PulseRuns", "Pulses", "RunCosts", "communication_step", "declared_step", "open_at_point"]

UNDECLARED = 1.0
LEAD = 1e-6  # of the period
NONLINEAR = 1e-2  # of a response: how much each direction may differ from the mean of both
QUIET = 1e-6  # noise of a response below which no wider pulse is tried
WIDER, WIDEST = 10.0, 1000.0  # times the width, step by step, and in all
_ROUNDING = 4.0 * float(np.finfo(float).eps)


@dataclass
class RunCosts:
    """Tells of the runs of a linearisation, and what they cost.

    Attributes:
        job: is told.
        attempts: with different tolerances, that there may be.
        done: runs made.
        left: runs that are still to come, at least 1 as long as it is not over.
    """

    job: Job
    attempts: int
    done: int = 0
    left: int = 0

    def begin(self, count: int, cost: float) -> None:
        """Tell what is coming: so many runs, of so many seconds each [s]."""
        if not self.done and count * cost > SLOW:
            self.job.say(
                f"a run takes about {cost:.2g} s, and at least {count} are coming, {count * cost:.2g} s in all: fewer "
                "`points` or `inputs` take less"
            )
        self.left = max(self.left, self.attempts * count)

    def ran(self, seconds: float) -> None:
        """Tell that one more is finished, which took so long [s]."""
        self.done, self.left = self.done + 1, max(self.left - 1, 1)
        total = self.done + self.left
        self.job.done(f"run {self.done} of about {total}, {seconds:.2g} s each", self.done, total)


def declared_step(model: Model) -> float | None:
    """Return the communication step that the user or the FMU names [s]; None: there is none, or nobody does."""
    if not isinstance(model, DescribedModel) or model.interface != "cs":
        return None
    return model.recipe.step or model.description.experiment.step


def open_at_point(task: LinTask, period: float, costs: RunCosts) -> Session:
    """Return a session that stands one period after the task's time, all inputs at their values.

    There it has not yet handled what happens at that very instant: a sampler that samples then will see the pulse.
    What a run costs is known from that period.
    """
    model, names = task.model, [v.name for v in task.model.inputs if v.is_number]
    step = communication_step(model, period)
    if task.values:
        check_variables(model, task.values, "variable", "input", "state", "parameter", what="x0")
    try:
        session = model.open_at(values=task.values, step=step, tolerance=INTEGRATION)
    except InputError:
        if task.values:
            raise
        session = model.open_session(step=step)
    try:
        values = session.values(names)
        if task.time > session.time:
            session.advance(task.time, signals={n: Constant(v) for n, v in values.items()})
        standing: dict[str, Signal] = {n: Constant(v) for n, v in values.items()}
        until, begun = session.time + period - _lead(task, period), time.monotonic()
        session.advance(until, signals=standing)
        costs.begin(1 + 3 * len(task.inputs), task.points * (time.monotonic() - begun))
    except BaseException:
        session.close()
        raise
    return session


def _lead(task: LinTask, period: float) -> float:
    """Return how long before a sample the input changes [s]; 0 where nothing is sampled, or cannot be seen."""
    if task.model.interface != "me":
        return 0.0
    try:
        with task.model.open_point(time=task.time, values=task.values) as point:
            return LEAD * period if len(point.ticks(1, np.inf)) else 0.0
    except InputError:
        return 0.0


def _rows(record: Recorded, times: Floats, period: float, outputs: Sequence[str]) -> Floats:
    """Return the right limits of the outputs at `times`, shape (len(times), q)."""
    rows = np.searchsorted(record.time, times + 1e-9 * period, side="right") - 1
    return np.column_stack([record.values[n][rows] for n in outputs])


def communication_step(model: Model, period: float) -> float | None:
    """Return the communication step of a co-simulation whose inputs are held over `period` [s]; None: no such thing."""
    if model.interface != "cs":
        return None
    return min(declared_step(model) or period, period)


@dataclass(frozen=True, eq=False)
class Pulses:
    """What the pulses gave.

    Attributes:
        markov: per unit of the inputs, shape (k, q, m).
        noise: of the markov parameters, absolute, shape (q, m).
        base: outputs of the run that is left alone, shape (k, q).
        widths: of the pulses, by input.
        widened: inputs whose pulses are wider than usual.
        doubts: where rising and falling differ.
        runs: that were made.
    """

    markov: Floats
    noise: Floats
    base: Floats
    widths: Mapping[str, float]
    widened: tuple[str, ...]
    doubts: list[Doubt]
    runs: int


@dataclass(frozen=True, eq=False)
class _PulseColumn:
    """Answers of all outputs to a pulse at one input.

    Attributes:
        width: of the pulse.
        found: per unit of the input, shape (k, q).
        bend: largest mean of both directions' answers less the run that is left alone, likewise per unit, (q,).
        noise: the same, but not below the rounding of the outputs, (q,).
        runs: that were made so far.
    """

    width: float
    found: Floats
    bend: Floats
    noise: Floats
    runs: int

    @property
    def size(self) -> Floats:
        """Largest answer of each output, shape (q,)."""
        result: Floats = np.abs(self.found).max(axis=0)
        return result

    @property
    def worst(self) -> float:
        """Noise over answer, of the output where it is largest."""
        usable = self.size > 0.0
        return float((self.noise[usable] / self.size[usable]).max(initial=0.0))

    def better_than(self, other: _PulseColumn) -> bool:
        """Whether this has less noise than the answers to a narrower pulse and is the same within their noise."""
        same = np.abs(self.found - other.found).max(axis=0) <= 3.0 * other.noise
        return self.worst < 0.5 * other.worst and bool(same.all())


class PulseRuns:
    """Runs from the point: what one input does that is moved while the others stay.

    Args:
        task: the linearisation.
        session: stands at the point.
        period: over which an input is held [s].
        costs: are told of each run.

    Attributes:
        widths: total widths of the pulses of the task's inputs, shape (m,).
    """

    def __init__(self, task: LinTask, session: Session, period: float, costs: RunCosts) -> None:
        self.task, self.period = task, period
        self._session, self._start, self._costs = session, session.snapshot(), costs
        # Time by which the input changes before the samples of a sampled model, and after them the output is read.
        self._lead = _lead(task, period)
        start = session.values([v.name for v in task.model.inputs if v.is_number])
        self._u0 = {n: start[n] for n in task.inputs}
        self._variables = {v.name: v for v in task.model.inputs}
        self._given = width_for(task.du, task.inputs, what="du")
        relative = relative_width(MODELS_OWN_ERROR)
        usual = [total_width(self._variables[n], u, relative, UNDECLARED) for n, u in self._u0.items()]
        self.widths = np.where(np.isnan(self._given), usual, self._given)

    def measure(self) -> Iterator[Pulses]:
        """Yield the answers to one pulse at each input, after each all that there are so far."""
        base, columns = self._run({}), list[_PulseColumn]()
        for name, width in zip(self.task.inputs, self.widths.tolist(), strict=True):
            columns.append(self._column(name, width, base))
            yield self._pulses(base, columns)

    def _pulses(self, base: Floats, columns: Sequence[_PulseColumn]) -> Pulses:
        """Return what the pulses at the first inputs gave."""
        inputs = self.task.inputs[: len(columns)]
        widths = {n: c.width for n, c in zip(inputs, columns, strict=True)}
        return Pulses(
            markov=np.stack([c.found for c in columns], axis=-1),
            noise=np.stack([c.noise for c in columns], axis=-1),
            base=base,
            widths=widths,
            widened=tuple(n for n, w in zip(inputs, self.widths.tolist(), strict=False) if widths[n] > w),
            doubts=[d for n, c in zip(inputs, columns, strict=True) for d in self._doubts(n, c)],
            runs=1 + sum(c.runs for c in columns),
        )

    def _column(self, name: str, width: float, base: Floats) -> _PulseColumn:
        """Return the answers to a pulse as wide as it takes to rise above the noise."""
        best = self._pair(name, width, base, runs=0)
        runs = best.runs
        while best.worst > QUIET and self._may_be(name, WIDER * best.width, width):
            self._costs.left += 2
            wider = self._pair(name, WIDER * best.width, base, runs=runs)
            runs = wider.runs
            if not wider.better_than(best):
                break
            best = wider
        return replace(best, runs=runs)

    def _may_be(self, name: str, width: float, usual: float) -> bool:
        """Whether an input may be moved by a width that was not asked for."""
        variable = self._variables[name]
        if not np.isnan(self._given[self.task.inputs.index(name)]):
            return False
        low = -np.inf if variable.minimum is None else variable.minimum
        high = np.inf if variable.maximum is None else variable.maximum
        inside = low <= self._u0[name] - 0.5 * width and self._u0[name] + 0.5 * width <= high
        return variable.type in FLOAT_TYPES and inside and width <= 1.001 * WIDEST * usual

    def _pair(self, name: str, width: float, base: Floats, *, runs: int) -> _PulseColumn:
        pulse = np.zeros(len(base))
        pulse[0] = 0.5 * width
        above, below = self._run({name: pulse}), self._run({name: -pulse})
        bend: Floats = np.abs(above - 2.0 * base + below).max(axis=0) / width
        rounding = _ROUNDING * np.abs(base).max(axis=0) / width
        return _PulseColumn(width, (above - below) / width, bend, np.maximum(bend, rounding), runs + 2)

    def _doubts(self, name: str, column: _PulseColumn) -> list[Doubt]:
        result, bend, size, half = [], column.bend, column.size, column.width / 2.0
        for i in np.flatnonzero(bend > NONLINEAR * size):
            why = f"not linear or noisy: {name} rising and falling by {half:.3g} differ by {2.0 * bend[i]:.3g}"
            result.append(Doubt(self.task.outputs[i], name, float(size[i]), float(bend[i]), why))
        return result

    def trial(self, name: str, pulses: Pulses) -> MoveTrial:
        """Return a run that the model was not made from: other pulses and a step at an input."""
        levels = 0.5 * pulses.widths[name] * trial_levels(len(pulses.base))
        j = self.task.inputs.index(name)
        answer = self._run({name: levels}) - pulses.base
        rounding = _ROUNDING * np.abs(pulses.base).max(axis=0)
        result, noise = pulses.markov[:, :, j], pulses.noise[:, j]
        return MoveTrial(name, j, self.task.outputs, levels, answer, result, noise, rounding)

    def inside(self, realised: Realisation, names: Sequence[str], pulses: Pulses) -> Floats | None:
        """Return the answers to one pulse at each input within the periods, per unit, shape (k, parts, q, m).

        None: a co-simulation whose communication step is the period shows nothing there.
        """
        parts = self._parts()
        if parts < 2:
            return None
        count = min(self.task.points, periods_needed(len(realised.A)))
        base, pulse = self._run({}, count, parts), np.zeros(count)
        columns = []
        for name in names:
            pulse[0] = 0.5 * pulses.widths[name]
            columns.append((self._run({name: pulse}, count, parts) - base) / pulse[0])
        return np.stack(columns, axis=-1).reshape(count, parts, len(self.task.outputs), len(names))

    def _parts(self) -> int:
        step = communication_step(self.task.model, self.period)
        if step is None:
            return PARTS
        whole = round(self.period / step)
        return whole if whole <= PARTS and abs(whole * step - self.period) <= 1e-9 * self.period else 1

    def _run(self, moved: Mapping[str, Floats], count: int | None = None, parts: int = 1) -> Floats:
        """Return the outputs (k parts, q) at the beginning of the parts of k periods, right limits.

        Args:
            moved: inputs → how far each is from its value over each period, shape (k,).
            count: k; None: as many as the task records.
            parts: of each period.
        """
        session, task, h, begun = self._session, self.task, self.period, time.monotonic()
        session.restore(self._start)
        begin, count = session.time, task.points if count is None else count
        times: Floats = begin + 2.0 * self._lead + h / parts * np.arange(float(count * parts))
        table = np.array([moved.get(n, np.zeros(count)) for n in self._u0])
        changes = np.flatnonzero(np.any(np.diff(table, axis=1) != 0.0, axis=0)) + 1
        # The last of each part is the left limit at its end; at the beginning, the right limit is recorded anyway.
        ends = np.unique([1, *changes.tolist(), count])
        pieces = []
        for first, last in zip([0, *ends[:-1].tolist()], ends.tolist(), strict=True):
            signals: dict[str, Signal] = {
                n: Constant(v + float(table[i, first])) for i, (n, v) in enumerate(self._u0.items())
            }
            own = times[first * parts : last * parts]
            later = own[own > begin + h * first]
            until = float(times[-1]) + h / parts if last == count else begin + h * last
            record = session.advance(until, signals=signals, record=task.outputs, points=later if len(later) else None)
            pieces.append(_rows(record, own, h / parts, task.outputs))
        self._costs.ran(time.monotonic() - begun)
        return np.vstack(pieces)

    def acts_at_samples(self) -> bool:
        """Whether inputs are only read at sample instants: what comes and goes between them has no effect."""
        raised = {n: u + 0.5 * w for (n, u), w in zip(self._u0.items(), self.widths.tolist(), strict=True)}
        try:
            usual = self._late({})
            return all(np.array_equal(usual, self._late({name: value})) for name, value in raised.items())
        except (InputError, SimulationError):  # a co-simulation that takes no other step
            return False

    def _late(self, pulse: Mapping[str, float]) -> Floats:
        """Return the outputs during and after a pulse that begins and ends within a period, (2, q)."""
        session, h = self._session, self.period
        session.restore(self._start)
        begin = session.time
        usual: dict[str, Signal] = {n: Constant(v) for n, v in self._u0.items()}
        raised: dict[str, Signal] = {n: Constant(pulse.get(n, v)) for n, v in self._u0.items()}
        session.advance(begin + 0.4 * h, signals=usual)
        during = session.advance(begin + 0.7 * h, signals=raised, record=self.task.outputs)
        after = session.advance(begin + 2.0 * h, signals=usual, record=self.task.outputs)
        return np.array([[record.values[n][-1] for n in self.task.outputs] for record in (during, after)])

    def point(self) -> OperatingPoint:
        """Return where the session stands."""
        session, model, task = self._session, self.task.model, self.task
        session.restore(self._start)
        # The right limit at the point: inputs that are forced are put in place first.
        session.advance(session.time, signals={n: Constant(v) for n, v in self._u0.items()})
        states = session.values([v.name for v in model.states]) if isinstance(model, DescribedModel) else {}
        variables = (*model.inputs, *model.outputs, *model.states)
        return OperatingPoint(
            x=states,
            u=session.values([v.name for v in model.inputs if v.is_number]),
            y=session.values(task.outputs),
            units={v.name: v.unit for v in variables},
            time=session.time,
        )

"""Linearise a black box by its response to small perturbations of its inputs."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.core.values.operating_point import OperatingPoint
from workbench.errors import InputError, SimulationError, WorkbenchError
from workbench.fmi.variable import FLOAT_TYPES
from workbench.jobs.job import SLOW, Job
from workbench.model import DescribedModel, Model
from workbench.model.described_model import LoadRecipe
from workbench.model.names import check_variables
from workbench.model.operating_point import named
from workbench.point.lin.columns import relative_width, total_width
from workbench.point.lin.intersample import PARTS, held, inside, lines, periods_needed
from workbench.point.lin.realisation import Realisation, realise
from workbench.point.lin.result import Doubt, Intersample, LinResult, Zero
from workbench.point.lin.task import LinTask, moving_note, width_for
from workbench.point.lin.validation_run import DOUBT, MoveTrial, accepted, smallest, trial_levels
from workbench.point.lin.zero_entries import LargePerturbation, zeros_of
from workbench.point.scales import INTEGRATION, MODELS_OWN_ERROR
from workbench.session.base import Recorded, Session, Snapshot
from workbench.session.settle import STEP
from workbench.signals.kinds import Constant, Signal

__all__ = ["response"]

UNDECLARED = 1.0
LEAD = 1e-6  # of the period
NONLINEAR = 1e-2  # of a response: how much each direction may differ from the mean of both
QUIET = 1e-6  # noise of a response below which no wider pulse is tried
WIDER, WIDEST = 10.0, 1000.0  # times the width, step by step, and in all
_ROUNDING = 4.0 * float(np.finfo(float).eps)
_MOVING, _STANDS = 1e-3, 1e-6  # of the answers to a pulse, of the outputs: what may drift of its own


def response(task: LinTask) -> LinResult:
    """Linearise any model, co-simulation included, by short pulses at its inputs.

    From the running operating point (one period after `time`, so that samplers see the pulse), saved by snapshot (the
    FMU's own state where it can be trusted, else replay), each input in turn is raised for one period h and then put
    back, lowered likewise, and left alone. The difference of the first two runs over the width gives the Markov
    parameters of the discrete model with the input held over h; its realisation (ERA) has at most as many states as
    singular values stand out of the noise. The model at the point need not rest: what it does on its own
    cancels. The states have no physical meaning.

    Widths (`du`, total) that are not given are 0.002 times the larger of magnitude and nominal value (1 where none
    is declared). How far the two directions differ from the run that is left alone gives the noise, and a
    doubt where the model is not linear over the width. Where that noise is above 1e-6 of the response, pulses 10, 100
    and 1000 times as wide are tried, as long as the noise falls and the response per unit stays the same.

    One pulse is reproduced by construction, and so are the solver's own errors, by states of their own. So each
    input is moved once more, by pulses of other lengths and heights at other times and a step (see `trial`), and the
    model must predict the answer: superposition and time shift are tested with it, relative to the communication
    steps and to whatever steps an FMU makes inside. The order is the smallest that predicts about as well as the best
    one does; its error is stated in the notes. Above 5 % it is a doubt, and above 50 % there is no linear model of
    this period: typically an FMU whose own solver does not restart where inputs change, or samples them. An input
    for which there is none is left out, with the reason; so is one of which no answer rises above the scatter of the
    runs, and an output that does not is a doubt. Where a co-simulation FMU fails that test with a tolerance that
    nobody asked for, it is tried with 1e-10, and the better model is taken.

    Outputs are watched within the periods too, where the interface shows them there. The result says up to which
    frequency its samples alone, joined by straight lines, show what a sine does; where outputs move much in between
    (a period too long for the model's motion, whose poles are folded then), that is a doubt.

    Not for: dynamics that the chosen outputs do not show or the inputs do not reach (no input-output
    method finds them); models whose slowest motion takes thousands of periods (choose a longer `period`); FMUs with
    internal variable steps coarser than the perturbation (raise `du`, tighten the tolerance).

    Args:
        task: the linearisation.

    Raises:
        InputError: no inputs or outputs, widths for states, unknown names, no period can be derived.
        SimulationError: a run fails, or for every input no linear model predicts the answers.

    Source: J.-N. Juang and R. S. Pappa, J. Guidance 8 (1985).
    """
    _check(task)
    recipe = _tighter(task)
    runs = _PulseRuns(task.job, 1 if recipe is None else 2)
    first = _tried(task, runs)
    better = None if first.error <= DOUBT or recipe is None else _better(first, task, recipe, runs)
    return first.given() if better is None else better


def _check(task: LinTask) -> None:
    """Refuse what the method cannot do."""
    if task.dx is not None:
        raise InputError("method response: it perturbs only inputs; leave out dx, or use another method")
    lacking = [kind for kind, names in (("input", task.inputs), ("output", task.outputs)) if not names]
    if lacking:
        raise InputError(
            "method response: it needs an input and an output that are real numbers, and there is no "
            f"{' and no '.join(lacking)}"
        )
    if task.points < 8:
        raise InputError(f"points: {task.points} are too few for a realisation; at least 8 are needed")


def _better(first: _Tried, task: LinTask, recipe: LoadRecipe, runs: _PulseRuns) -> LinResult | None:
    """Return the linear model with another tolerance where it predicts better; None: it does not."""
    try:
        with recipe.open() as model:
            second = _tried(replace(task, model=model), runs)
    except WorkbenchError:  # it takes no such tolerance
        return None
    if second.result is None or not second.error < first.error:
        return None
    before = f"missed by {100.0 * first.error:.2g} %" if np.isfinite(first.error) else "not predicted"
    why = (
        f"tolerance: {recipe.tolerance:g} in place of the FMU's own, with which other pulses and a step are {before}; "
        "--tolerance sets another"
    )
    return replace(second.result, notes=(*second.result.notes, why))


@dataclass
class _PulseRuns:
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
                "--points or --inputs take less"
            )
        self.left = max(self.left, self.attempts * count)

    def ran(self, seconds: float) -> None:
        """Tell that one more is finished, which took so long [s]."""
        self.done, self.left = self.done + 1, max(self.left - 1, 1)
        total = self.done + self.left
        self.job.done(f"run {self.done} of about {total}, {seconds:.2g} s each", self.done, total)


@dataclass(frozen=True)
class _Tried:
    """What one attempt gave.

    Attributes:
        result: the linear model; None: there is none.
        error: of its predictions, relative; inf where there is none, or something could not be tested.
        why: there is none.
    """

    result: LinResult | None
    error: float
    why: SimulationError | None = None

    def given(self) -> LinResult:
        """Return the linear model.

        Raises:
            SimulationError: there is none.
        """
        if self.result is None:
            raise self.why or SimulationError("method response: there is no linear model")
        return self.result


def _tighter(task: LinTask) -> LoadRecipe | None:
    """Return the model with a solver of its own as exact as ours; None: it has none, or its tolerance was asked for."""
    recipe = task.model.recipe
    if task.model.interface != "cs" or not isinstance(recipe, LoadRecipe) or recipe.tolerance is not None:
        return None
    return replace(recipe, tolerance=INTEGRATION)


def _tried(task: LinTask, runs: _PulseRuns) -> _Tried:
    try:
        return _identified(task, _period(task), runs)
    except SimulationError as error:
        return _Tried(None, np.inf, error)


def _identified(task: LinTask, period: float, told: _PulseRuns) -> _Tried:
    """Return the linear model, and how well it predicts runs that it was not made from."""
    with _open(task, period, told) as session:
        setting = _Setting.of(task, session, period, told)
        pulses = setting.measure()
        longer = "use a longer period, or nfr"
        way = task.model.way_out(longer) if task.model.interface == "cs" else longer
        tried = [setting.trial(name, pulses) for name in task.inputs]
        task.job.partial = _nothing  # what is refused now is not what there is
        trials, refused = accepted(tried, way)
        kept = replace(task, inputs=tuple(t.input for t in trials))
        columns = [task.inputs.index(t.input) for t in trials]
        largest = realise(pulses.markov[:, :, columns], noise=pulses.noise[:, columns], order=task.order)
        found = smallest(largest, trials, given=task.order is not None)
        point = setting.point()
        plain = _result(kept, found, named(task.model, point), period, lines(found, period, sampled=False))
        why = "ended before it was looked at between the samples"
        task.job.partial = lambda: replace(plain, why=why, refused=refused)
        sampled = setting.acts_at_samples()
        answers = setting.inside(found, kept.inputs, pulses)
    between = lines(found, period, sampled=sampled)
    result = _result(kept, found, point, period, between)
    doubts = [d for d in pulses.doubts if d.column in kept.inputs] + [d for t in trials for d in t.doubts(found)]
    over = f"inputs held over {period:.6g} s{_assumed(task)}"
    notes = [*_notes(found, largest, pulses, trials), over, *_replayed(task.model)]
    notes += [*_moving(task, pulses, period), *(f"{n} is left out: {why}" for n, why in refused.items())]
    if answers is not None and (len(found.A) or found.D.any()):
        joined, between = result, inside(found, answers, period, sampled=sampled)
        result = replace(result, intersample=between)
        limit = held(result, joined)
        result = replace(result, holds_to_hz=limit.to_hz)
        doubts += limit.doubts
        notes.append(
            f"the samples, joined by straight lines, are valid within 5 % for sines up to {limit.to_hz:.3g} Hz"
        )
    runs = {"runs": pulses.runs + len(task.inputs) + (0 if answers is None else 1 + len(trials))}
    untested = {name for t in trials for name in t.untested}
    zeros = tuple(_not_known(z) if z.kind == "output" and z.name in untested else z for z in result.zeros)
    result = replace(result, notes=tuple(notes), doubts=tuple(doubts), refused=refused, calls=runs, zeros=zeros)
    return _Tried(result, np.inf if untested or refused else max(t.error(found) for t in trials))


def _not_known(zero: Zero) -> Zero:
    return replace(zero, reason="it moves by no more than the runs scatter: whether an input moves it is not known")


def _replayed(model: Model) -> list[str]:
    """Say why every run began anew, where the FMU does not even claim to save its state."""
    if not isinstance(model, DescribedModel) or model.replay_note() or not model.why_replay():
        return []
    return [f"each run falls back to replay from the start: {model.why_replay()}"]


def _period(task: LinTask) -> float:
    """Return the period over which an input is held [s]."""
    if task.period is not None:
        if not task.period > 0.0:
            raise InputError(f"period must be positive, not {task.period:g} s")
        return task.period
    model = task.model
    step, span = _declared_step(model), 0.0
    if isinstance(model, DescribedModel):
        experiment = model.description.experiment
        step = step or experiment.step
        span = (experiment.stop_time or 0.0) - (experiment.start_time or 0.0)
    if step is None and span <= 0.0:
        if model.interface == "cs":
            return STEP
        raise InputError("method response: the model has neither a step nor a default experiment; give period")
    return step or span / 500.0


def _assumed(task: LinTask) -> str:
    """Return that nothing says how long the period should be; empty: something does."""
    model = task.model
    if task.period is not None or not isinstance(model, DescribedModel) or _declared_step(model) is not None:
        return ""
    experiment = model.description.experiment
    if experiment.step is not None or (experiment.stop_time or 0.0) > (experiment.start_time or 0.0):
        return ""
    return ", since the model names neither a step nor a default experiment; --period changes it"


def _declared_step(model: Model) -> float | None:
    """Return the communication step that the user or the FMU names [s]; None: there is none, or nobody does."""
    if not isinstance(model, DescribedModel) or model.interface != "cs":
        return None
    return model.recipe.step or model.description.experiment.step


def _open(task: LinTask, period: float, told: _PulseRuns) -> Session:
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
        told.begin(1 + 3 * len(task.inputs), task.points * (time.monotonic() - begun))
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
    return min(_declared_step(model) or period, period)


@dataclass(frozen=True, eq=False)
class _Pulses:
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


@dataclass(frozen=True)
class _Setting:
    """What all runs have in common.

    Attributes:
        task: the linearisation.
        session: stands at the point.
        start: saved there.
        period: [s].
        u0: all forced inputs there.
        widths: of the task's inputs, shape (m,).
        lead: time by which the input changes before the samples of a sampled model, and after them the output is
            read [s].
        told: of each run.
    """

    task: LinTask
    session: Session
    start: Snapshot
    period: float
    u0: Mapping[str, float]
    widths: Floats
    lead: float
    told: _PulseRuns

    @classmethod
    def of(cls, task: LinTask, session: Session, period: float, told: _PulseRuns) -> _Setting:
        """Collect them."""
        u0 = session.values([v.name for v in task.model.inputs if v.is_number])
        variables = {v.name: v for v in task.model.inputs}
        given = width_for(task.du, task.inputs, what="du")
        relative = relative_width(MODELS_OWN_ERROR)
        usual = np.array([total_width(variables[n], u0[n], relative, UNDECLARED) for n in task.inputs])
        widths = np.where(np.isnan(given), usual, given)
        forced = {n: u0[n] for n in task.inputs}
        return cls(task, session, session.snapshot(), period, forced, widths, _lead(task, period), told)

    def measure(self) -> _Pulses:
        """Return the answers to one pulse at each input."""
        point, base, columns = self.point(), self._run({}), list[_PulseColumn]()
        for name, width in zip(self.task.inputs, self.widths.tolist(), strict=True):
            columns.append(self._column(name, width, base))
            self.task.job.partial = partial(self._so_far, point, self._pulses(base, columns), len(columns))
        return self._pulses(base, columns)

    def _so_far(self, point: OperatingPoint, pulses: _Pulses, count: int) -> LinResult:
        """Return the linear model of the inputs that were moved so far, which nothing has tested."""
        task = replace(self.task, inputs=self.task.inputs[:count])
        found = realise(pulses.markov, noise=pulses.noise, order=task.order)
        result = _result(task, found, named(task.model, point), self.period, lines(found, self.period, sampled=False))
        doubts = [*pulses.doubts, *(d for n in task.inputs for d in _untested(result, n))]
        left = dict.fromkeys(self.task.inputs[count:], "the end came before it was moved")
        return replace(result, why="ended before it was tested", doubts=tuple(doubts), refused=left)

    def _pulses(self, base: Floats, columns: Sequence[_PulseColumn]) -> _Pulses:
        """Return what the pulses at the first inputs gave."""
        inputs = self.task.inputs[: len(columns)]
        widths = {n: c.width for n, c in zip(inputs, columns, strict=True)}
        return _Pulses(
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
            self.told.left += 2
            wider = self._pair(name, WIDER * best.width, base, runs=runs)
            runs = wider.runs
            if not wider.better_than(best):
                break
            best = wider
        return replace(best, runs=runs)

    def _may_be(self, name: str, width: float, usual: float) -> bool:
        """Whether an input may be moved by a width that was not asked for."""
        variable = next(v for v in self.task.model.inputs if v.name == name)
        if not np.isnan(width_for(self.task.du, self.task.inputs, what="du")[self.task.inputs.index(name)]):
            return False
        low = -np.inf if variable.minimum is None else variable.minimum
        high = np.inf if variable.maximum is None else variable.maximum
        inside = low <= self.u0[name] - 0.5 * width and self.u0[name] + 0.5 * width <= high
        return variable.type in FLOAT_TYPES and inside and width <= 1.001 * WIDEST * usual

    def _pair(self, name: str, width: float, base: Floats, *, runs: int) -> _PulseColumn:
        pulse = np.zeros(len(base))
        pulse[0] = 0.5 * width
        above, below = self._run({name: pulse}), self._run({name: -pulse})
        bend: Floats = np.abs(above - 2.0 * base + below).max(axis=0) / width
        rounding = _ROUNDING * np.abs(base).max(axis=0) / width
        return _PulseColumn(width, (above - below) / width, bend, np.maximum(bend, rounding), runs + 2)

    def _doubts(self, name: str, column: _PulseColumn) -> list[Doubt]:
        found, bend, size, half = [], column.bend, column.size, column.width / 2.0
        for i in np.flatnonzero(bend > NONLINEAR * size):
            why = f"not linear or noisy: {name} rising and falling by {half:.3g} differ by {2.0 * bend[i]:.3g}"
            found.append(Doubt(self.task.outputs[i], name, float(size[i]), float(bend[i]), why))
        return found

    def trial(self, name: str, pulses: _Pulses) -> MoveTrial:
        """Return a run that the model was not made from: other pulses and a step at an input."""
        levels = 0.5 * pulses.widths[name] * trial_levels(len(pulses.base))
        j = self.task.inputs.index(name)
        answer = self._run({name: levels}) - pulses.base
        rounding = _ROUNDING * np.abs(pulses.base).max(axis=0)
        found, noise = pulses.markov[:, :, j], pulses.noise[:, j]
        return MoveTrial(name, j, self.task.outputs, levels, answer, found, noise, rounding)

    def inside(self, found: Realisation, names: Sequence[str], pulses: _Pulses) -> Floats | None:
        """Return the answers to one pulse at each input within the periods, per unit, shape (k, parts, q, m).

        None: a co-simulation whose communication step is the period shows nothing there.
        """
        parts = self._parts()
        if parts < 2:
            return None
        count = min(self.task.points, periods_needed(len(found.A)))
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
        session, task, h, begun = self.session, self.task, self.period, time.monotonic()
        session.restore(self.start)
        begin, count = session.time, task.points if count is None else count
        times: Floats = begin + 2.0 * self.lead + h / parts * np.arange(float(count * parts))
        table = np.array([moved.get(n, np.zeros(count)) for n in self.u0])
        changes = np.flatnonzero(np.any(np.diff(table, axis=1) != 0.0, axis=0)) + 1
        # The last of each part is the left limit at its end; at the beginning, the right limit is recorded anyway.
        ends = np.unique([1, *changes.tolist(), count])
        pieces = []
        for first, last in zip([0, *ends[:-1].tolist()], ends.tolist(), strict=True):
            signals: dict[str, Signal] = {
                n: Constant(v + float(table[i, first])) for i, (n, v) in enumerate(self.u0.items())
            }
            own = times[first * parts : last * parts]
            later = own[own > begin + h * first]
            until = float(times[-1]) + h / parts if last == count else begin + h * last
            record = session.advance(until, signals=signals, record=task.outputs, points=later if len(later) else None)
            pieces.append(_rows(record, own, h / parts, task.outputs))
        self.told.ran(time.monotonic() - begun)
        return np.vstack(pieces)

    def acts_at_samples(self) -> bool:
        """Whether inputs are only read at sample instants: what comes and goes between them has no effect."""
        try:
            usual = self._late({})
            return all(np.array_equal(usual, self._late({name: value})) for name, value in self._raised().items())
        except (InputError, SimulationError):  # a co-simulation that takes no other step
            return False

    def _raised(self) -> dict[str, float]:
        return {n: self.u0[n] + w / 2.0 for n, w in zip(self.task.inputs, self.widths.tolist(), strict=True)}

    def _late(self, pulse: Mapping[str, float]) -> Floats:
        """Return the outputs during and after a pulse that begins and ends within a period, (2, q)."""
        session, h = self.session, self.period
        session.restore(self.start)
        begin = session.time
        usual: dict[str, Signal] = {n: Constant(v) for n, v in self.u0.items()}
        raised: dict[str, Signal] = {n: Constant(pulse.get(n, v)) for n, v in self.u0.items()}
        session.advance(begin + 0.4 * h, signals=usual)
        during = session.advance(begin + 0.7 * h, signals=raised, record=self.task.outputs)
        after = session.advance(begin + 2.0 * h, signals=usual, record=self.task.outputs)
        return np.array([[record.values[n][-1] for n in self.task.outputs] for record in (during, after)])

    def point(self) -> OperatingPoint:
        """Return where the session stands."""
        session, model, task = self.session, self.task.model, self.task
        session.restore(self.start)
        # The right limit at the point: inputs that are forced are put in place first.
        session.advance(session.time, signals={n: Constant(v) for n, v in self.u0.items()})
        states = session.values([v.name for v in model.states]) if isinstance(model, DescribedModel) else {}
        variables = (*model.inputs, *model.outputs, *model.states)
        return OperatingPoint(
            x=states,
            u=session.values([v.name for v in model.inputs if v.is_number]),
            y=session.values(task.outputs),
            units={v.name: v.unit for v in variables},
            time=session.time,
        )


def _nothing() -> None:
    """Return that there is nothing."""


def _untested(result: LinResult, input: str) -> Iterator[Doubt]:
    """Yield a doubt about each entry of an input."""
    for i, output in enumerate(result.output_names):
        why = "ended before other pulses and a step at this input could test it"
        yield Doubt(output, input, float(result.D[i, result.input_names.index(input)]), None, why)


def _moving(task: LinTask, pulses: _Pulses, period: float) -> tuple[str, ...]:
    """Return a remark where the outputs of the run that is left alone do not stay."""
    answers = np.abs(pulses.markov).max(axis=0) @ np.array([pulses.widths[n] for n in task.inputs])
    size = np.abs(pulses.base).max(axis=0)
    drift = np.abs(pulses.base - pulses.base[0]).max(axis=0)
    found = np.flatnonzero(drift > np.maximum(_MOVING * answers, _STANDS * size))
    span = period * (len(pulses.base) - 1)
    return moving_note([f"{task.outputs[i]} changes by {drift[i]:.4g} within {span:.4g} s" for i in found])


def _notes(found: Realisation, largest: Realisation, pulses: _Pulses, trials: Sequence[MoveTrial]) -> list[str]:
    size = np.abs(pulses.markov).max(axis=0)
    relative = np.divide(pulses.noise, size, out=np.zeros_like(size), where=size > 0.0)
    notes = [f"order {len(found.A)} (singular values above the noise, {relative.max(initial=0.0):.1e} of the response)"]
    if len(found.A) < len(largest.A):
        more = f"singular values above the noise would give {len(largest.A)}"
        notes = [
            (
                f"order {len(found.A)}, the smallest that predicts other pulses and a step as well as any larger one; "
                f"{more}"
            )
        ]
    error = max((t.error(found) for t in trials), default=0.0)
    untested = [f"{name} by {t.input}" for t in trials for name in t.untested]
    less = f", as far as they rise above the scatter of the runs; {', '.join(untested)} did not" if untested else ""
    notes.append(f"other pulses and a step, not used for the fit, are predicted within {100.0 * error:.2g} %{less}")
    notes += [
        f"{n}: moved by {0.5 * pulses.widths[n]:.3g} up and down; smaller pulses would be lost in the noise of the "
        "integration"
        for n in pulses.widened
    ]
    return notes


def _result(task: LinTask, found: Realisation, point: OperatingPoint, period: float, between: Intersample) -> LinResult:
    names = tuple(f"z{i}" for i in range(1, len(found.A) + 1))
    units = {**dict.fromkeys(names), **{n: point.units.get(n) for n in (*task.inputs, *task.outputs)}}
    result = LinResult(
        model=task.model.name,
        interface=task.model.interface,
        method="response",
        why="it was asked for",
        A=found.A,
        B=found.B,
        C=found.C,
        D=found.D,
        dt=period,
        state_names=names,
        input_names=task.inputs,
        output_names=task.outputs,
        units=units,
        operating_point=point,
        intersample=between,
    )
    rows = [*names, *task.outputs]
    return replace(result, zeros=zeros_of(result, LargePerturbation.none(rows, [*names, *task.inputs], looked=False)))

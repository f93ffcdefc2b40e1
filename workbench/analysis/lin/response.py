"""Linearise a black box by its response to small perturbations of its inputs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from workbench.analysis.lin.explain import Reach, zeros_of
from workbench.analysis.lin.realise import Realisation, realise
from workbench.analysis.lin.result import Doubt, Intersample, LinResult
from workbench.analysis.lin.task import LinTask, check_names, width_for
from workbench.core.operating_point import OperatingPoint
from workbench.errors import InputError, SimulationError
from workbench.fmi.variable import FLOAT_TYPES, Variable
from workbench.model import DescribedModel, Model
from workbench.session.base import Floats, Record, Session, Snapshot
from workbench.signals import Constant, Signal

__all__ = ["response"]

RELATIVE_WIDTH = 2e-3
TOLERANCE = 1e-10  # of the integration, where the workbench integrates
UNDECLARED = 1.0
LEAD = 1e-6  # of the period
NONLINEAR = 1e-2  # of a response: how much both directions may differ


def response(task: LinTask) -> LinResult:
    """Linearise any model, co-simulation included, by short pulses at its inputs.

    From the running operating point (one period after `time`, so that samplers see the pulse), saved by snapshot (the
    FMU's own state where it can be trusted, else replay), each input in turn is raised for one period h and then put
    back, lowered likewise, and left alone. The difference of the first two runs over the width gives the Markov
    parameters of the discrete model with the input held over h; its realisation (ERA) has as many states as
    singular values stand out of the noise. The model at the point need not rest: what it does on its own
    cancels. The states have no physical meaning.

    Widths (`du`, total) that are not given are 0.002 times the larger of magnitude and nominal value (1 where none
    is declared). How far the two directions differ from the run that is left alone gives the noise, and a
    doubt where the model is not linear over the width.

    Not for: dynamics that the chosen outputs do not show or the inputs do not reach (no input-output
    method finds them); models whose slowest motion takes thousands of periods (choose a longer `period`); FMUs with
    internal variable steps coarser than the perturbation (raise `du`, tighten the tolerance).

    Args:
        task: the linearisation.

    Raises:
        InputError: no inputs or outputs, widths for states, unknown names, no period can be derived.
        SimulationError: a run fails.

    Source: J.-N. Juang and R. S. Pappa, J. Guidance 8 (1985).
    """
    if task.dx is not None:
        raise InputError("method response: it perturbs inputs only; leave dx out, or use another method")
    if not task.inputs or not task.outputs:
        raise InputError("method response: it needs an input and an output")
    if task.points < 8:
        raise InputError(f"points: {task.points} are too few for a realisation; at least 8 are needed")
    period = _period(task)
    with _open(task, period) as session:
        setting = _Setting.of(task, session, period)
        markov, noise, doubts = setting.measure()
        point, sampled = setting.point(), setting.acts_at_samples()
    found = realise(markov, noise=noise, order=task.order)
    result = _result(task, found, point, period, sampled=sampled)
    notes = [*_notes(found, noise), f"inputs held over {period:.6g} s", *_replayed(task.model)]
    return replace(result, notes=tuple(notes), doubts=tuple(doubts), calls={"runs": 2 * len(task.inputs) + 1})


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
        raise InputError("method response: the model names neither step nor default experiment; give period")
    return step or span / 500.0


def _declared_step(model: Model) -> float | None:
    """Return the communication step that the user or the FMU names [s]; None: there is none, or nobody does."""
    if not isinstance(model, DescribedModel) or model.interface != "cs":
        return None
    return model.recipe.step or model.description.experiment.step


def _open(task: LinTask, period: float) -> Session:
    """Return a session that stands one period after the task's time, all inputs at their values.

    There it has not yet handled what happens at that very instant: a sampler that samples then will see the pulse.
    """
    model, names = task.model, [v.name for v in task.model.inputs if v.is_number]
    step = communication_step(model, period)
    if task.values:
        known = [v.name for v in (*model.inputs, *model.states, *model.parameters, *model.outputs)]
        if isinstance(model, DescribedModel):
            known = [v.name for v in model.description.variables]
        check_names("x0", task.values, known)
    try:
        session = model.open_at(values=task.values, step=step, tolerance=TOLERANCE)
    except InputError:
        if task.values:
            raise
        session = model.open_session(step=step)
    try:
        values = session.values(names)
        if task.time > session.time:
            session.advance(task.time, signals={n: Constant(v) for n, v in values.items()})
        standing: dict[str, Signal] = {n: Constant(v) for n, v in values.items()}
        session.advance(session.time + period - _lead(task, period), signals=standing)
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


def _rows(record: Record, times: Floats, period: float, outputs: Sequence[str]) -> Floats:
    """Return the right limits of the outputs at `times`, shape (len(times), q)."""
    rows = np.searchsorted(record.time, times + 1e-9 * period, side="right") - 1
    return np.column_stack([record.values[n][rows] for n in outputs])


def communication_step(model: Model, period: float) -> float | None:
    """Return the communication step of a co-simulation whose inputs are held over `period` [s]; None: no such thing."""
    if model.interface != "cs":
        return None
    return min(_declared_step(model) or period, period)


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
        lead: so long before the samples of a sampled model the input changes, and so long after them the output is
            read [s].
    """

    task: LinTask
    session: Session
    start: Snapshot
    period: float
    u0: Mapping[str, float]
    widths: Floats
    lead: float

    @classmethod
    def of(cls, task: LinTask, session: Session, period: float) -> _Setting:
        """Collect them."""
        u0 = session.values([v.name for v in task.model.inputs if v.is_number])
        variables = {v.name: v for v in task.model.inputs}
        given = width_for(task.du, task.inputs, what="du")
        usual = np.array([_default(variables[n], u0[n]) for n in task.inputs])
        widths = np.where(np.isnan(given), usual, given)
        forced = {n: u0[n] for n in task.inputs}
        return cls(task, session, session.snapshot(), period, forced, widths, _lead(task, period))

    def measure(self) -> tuple[Floats, float, list[Doubt]]:
        """Return the Markov parameters (k, q, m), their relative noise, and doubts."""
        base = self._run({})
        parameters, noise, doubts = [], 0.0, list[Doubt]()
        for name, width in zip(self.task.inputs, self.widths.tolist(), strict=True):
            above, below = (self._run({name: self.u0[name] + s * width / 2.0}) for s in (1.0, -1.0))
            found = (above - below) / width
            parameters.append(found)
            bend = np.abs(above - 2.0 * base + below).max(axis=0) / width
            size = np.abs(found).max(axis=0)
            doubts += self._doubts(name, width, bend, size)
            usable = size > 0.0
            rounding = 4.0 * np.finfo(float).eps * np.abs(base).max(axis=0) / width
            relative = np.maximum(bend, rounding)[usable] / size[usable]
            noise = max(noise, float(relative.max(initial=0.0)))
        return np.stack(parameters, axis=-1), noise, doubts

    def _doubts(self, name: str, width: float, bend: Floats, size: Floats) -> list[Doubt]:
        found = []
        for i in np.flatnonzero(bend > NONLINEAR * size):
            why = f"not linear or noisy: {name} rising and falling by {width / 2.0:.3g} differ by {bend[i]:.3g}"
            found.append(Doubt(self.task.outputs[i], name, float(size[i]), float(bend[i]), why))
        return found

    def _run(self, pulse: Mapping[str, float]) -> Floats:
        """Return the outputs (k, q) at k periods after a pulse of one period at an input, right limits."""
        session, task, h = self.session, self.task, self.period
        session.restore(self.start)
        begin = session.time
        raised: dict[str, Signal] = {n: Constant(pulse.get(n, v)) for n, v in self.u0.items()}
        usual: dict[str, Signal] = {n: Constant(v) for n, v in self.u0.items()}
        times: Floats = begin + 2.0 * self.lead + h * np.arange(float(task.points))
        early = times[:1] if self.lead else None
        first = session.advance(begin + h, signals=raised, record=task.outputs, points=early)
        rest = session.advance(
            float(times[-1]) + h, signals=usual, record=task.outputs, points=times[times > begin + h]
        )
        parts = [_rows(first, times[:1], h, task.outputs), _rows(rest, times[1:], h, task.outputs)]
        return np.vstack(parts)

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
        """Return the outputs after a pulse that begins in the middle of a period and ends before the next, (1, q)."""
        session, h = self.session, self.period
        session.restore(self.start)
        begin = session.time
        usual: dict[str, Signal] = {n: Constant(v) for n, v in self.u0.items()}
        raised: dict[str, Signal] = {n: Constant(pulse.get(n, v)) for n, v in self.u0.items()}
        session.advance(begin + 0.4 * h, signals=usual)
        session.advance(begin + 0.7 * h, signals=raised)
        record = session.advance(begin + 2.0 * h, signals=usual, record=self.task.outputs)
        return np.array([[record.values[n][-1] for n in self.task.outputs]])

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


def _default(variable: Variable, value: float) -> float:
    if variable.type not in FLOAT_TYPES:
        return 2.0
    return RELATIVE_WIDTH * max(abs(value), variable.nominal or UNDECLARED)


def _notes(found: Realisation, noise: float) -> list[str]:
    words = f"order {len(found.A)} (singular values above the noise, {noise:.1e} of the response)"
    notes = [f"{words}; the response is reproduced within {100.0 * found.error:.2g} %"]
    if found.error > 0.05:
        notes.append("the realisation does not reproduce the response; give order, more points or another period")
    return notes


def _result(task: LinTask, found: Realisation, point: OperatingPoint, period: float, *, sampled: bool) -> LinResult:
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
        point=point,
        intersample=_lines(found, period, sampled=sampled),
    )
    rows = [*names, *task.outputs]
    return replace(result, zeros=zeros_of(result, Reach.none(rows, [*names, *task.inputs], looked=False)))


def _lines(found: Realisation, period: float, *, sampled: bool) -> Intersample:
    """Between two samples the output is taken as a straight line, from the right to the next left limit."""
    C = np.stack([found.C, found.C @ found.A])[None]
    # The left limit at the end still has the old input: D stays where outputs follow inputs at once.
    D = np.stack([found.D, found.C @ found.B + found.D])[None]
    return Intersample(np.array([0.0, period]), C, D, sampled=sampled)

"""Linearise a black box by its response to small perturbations of its inputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from workbench.core.values.operating_point import OperatingPoint
from workbench.errors import InputError, SimulationError, WorkbenchError, article
from workbench.model import DescribedModel, Model, Variable
from workbench.model.described_model import LoadRecipe
from workbench.model.operating_point import named
from workbench.point.lin.intersample import held, inside, lines
from workbench.point.lin.pulses import PulseRuns, Pulses, RunCosts, communication_step, declared_step, open_at_point
from workbench.point.lin.realisation import Realisation, realise
from workbench.point.lin.result import Doubt, Intersample, LinResult, Zero
from workbench.point.lin.task import LinTask, moving_note
from workbench.point.lin.validation_run import DOUBT, MoveTrial, accepted, smallest
from workbench.point.lin.zero_entries import LargePerturbation, zeros_of
from workbench.point.scales import INTEGRATION
from workbench.session.settle import STEP

__all__ = ["response"]

_SHOWN = 4  # names in a message
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
    runs = RunCosts(task.job, 1 if recipe is None else 2)
    first = _tried(task, runs)
    better = None if first.error <= DOUBT or recipe is None else _better(first, task, recipe, runs)
    return first.given() if better is None else better


def _check(task: LinTask) -> None:
    """Refuse what the method cannot do."""
    if task.dx is not None:
        raise InputError("method response: it perturbs only inputs; leave out dx, or use another method")
    sides = (("input", task.inputs, task.model.inputs), ("output", task.outputs, task.model.outputs))
    lacking = [_lacking(kind, list(there)) for kind, names, there in sides if not names]
    if lacking:
        raise InputError(
            "method response: it needs an input and an output that are real numbers, and there is "
            f"{' and '.join(lacking)}; {task.model.way_out('choose others')}"
        )
    if task.points < 8:
        raise InputError(f"points: {task.points} are too few for a realisation; at least 8 are needed")


def _lacking(kind: str, there: list[Variable]) -> str:
    """Return in words that a model has no input or output that is a real number."""
    shown = ", ".join(f"{v.name} is {article(v.type)}" for v in there[:_SHOWN])
    return f"no {kind}" if not there else f"no such {kind} ({shown}{', …' if there[_SHOWN:] else ''})"


def _better(first: _Attempt, task: LinTask, recipe: LoadRecipe, runs: RunCosts) -> LinResult | None:
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
        "`tolerance` sets another"
    )
    return replace(second.result, notes=(*second.result.notes, why))


@dataclass(frozen=True)
class _Attempt:
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


def _tried(task: LinTask, runs: RunCosts) -> _Attempt:
    try:
        return _identified(task, _period(task), runs)
    except SimulationError as error:
        return _Attempt(None, np.inf, error)


def _identified(task: LinTask, period: float, costs: RunCosts) -> _Attempt:
    """Return the linear model, and how well it predicts runs that it was not made from."""
    with open_at_point(task, period, costs) as session:
        runs = PulseRuns(task, session, period, costs)
        point = runs.point()
        for pulses in runs.measure():
            task.job.partial = partial(_so_far, task, named(task.model, point), pulses, period)
        longer = "use a longer period, or nfr"
        way = task.model.way_out(longer) if task.model.interface == "cs" else longer
        tried = [runs.trial(name, pulses) for name in task.inputs]
        task.job.partial = _nothing  # what is refused now is not what there is
        trials, refused = accepted(tried, way)
        kept = replace(task, inputs=tuple(t.input for t in trials))
        columns = [task.inputs.index(t.input) for t in trials]
        largest = realise(pulses.markov[:, :, columns], noise=pulses.noise[:, columns], order=task.order)
        realised = smallest(largest, trials, given=task.order is not None)
        plain = _result(kept, realised, named(task.model, point), period, lines(realised, period, sampled=False))
        why = "ended before it was looked at between the samples"
        task.job.partial = lambda: replace(plain, why=why, refused=refused)
        sampled = runs.acts_at_samples()
        answers = runs.inside(realised, kept.inputs, pulses)
    between = lines(realised, period, sampled=sampled)
    result = _result(kept, realised, point, period, between)
    doubts = [d for d in pulses.doubts if d.column in kept.inputs] + [d for t in trials for d in t.doubts(realised)]
    over = f"inputs held over {period:.6g} s{_assumed(task)}"
    step = communication_step(task.model, period)
    derived = task.model.derived_step(step) if isinstance(task.model, DescribedModel) else ()
    notes = [*_notes(realised, largest, pulses, trials), over, *derived, *_replayed(task.model)]
    notes += [*_moving(task, pulses, period), *(f"{n} is left out: {why}" for n, why in refused.items())]
    if answers is not None and (len(realised.A) or realised.D.any()):
        joined, between = result, inside(realised, answers, period, sampled=sampled)
        result = replace(result, intersample=between)
        limit_hz, between_samples = held(result, joined)
        result = replace(result, holds_to_hz=limit_hz)
        doubts += between_samples
        notes.append(f"the samples, joined by straight lines, are valid within 5 % for sines up to {limit_hz:.3g} Hz")
    calls = {"runs": pulses.runs + len(task.inputs) + (0 if answers is None else 1 + len(trials))}
    untested = {name for t in trials for name in t.untested}
    zeros = tuple(_not_known(z) if z.kind == "output" and z.name in untested else z for z in result.zeros)
    result = replace(result, notes=tuple(notes), doubts=tuple(doubts), refused=refused, calls=calls, zeros=zeros)
    return _Attempt(result, np.inf if untested or refused else max(t.error(realised) for t in trials))


def _so_far(task: LinTask, point: OperatingPoint, pulses: Pulses, period: float) -> LinResult:
    """Return the linear model of the inputs that were moved so far, which nothing has tested."""
    moved, left = task.inputs[: len(pulses.widths)], task.inputs[len(pulses.widths) :]
    realised = realise(pulses.markov, noise=pulses.noise, order=task.order)
    result = _result(replace(task, inputs=moved), realised, point, period, lines(realised, period, sampled=False))
    why = "ended before other pulses and a step at this input could test it"
    untested = [
        Doubt(output, input, float(result.D[i, j]), None, why)
        for j, input in enumerate(moved)
        for i, output in enumerate(result.output_names)
    ]
    refused = dict.fromkeys(left, "the end came before it was moved")
    return replace(result, why="ended before it was tested", doubts=(*pulses.doubts, *untested), refused=refused)


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
    step, span = declared_step(model), 0.0
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
    if task.period is not None or not isinstance(model, DescribedModel) or declared_step(model) is not None:
        return ""
    experiment = model.description.experiment
    if experiment.step is not None or (experiment.stop_time or 0.0) > (experiment.start_time or 0.0):
        return ""
    return ", since the model names neither a step nor a default experiment; `period` changes it"


def _nothing() -> None:
    """Return that there is nothing."""


def _moving(task: LinTask, pulses: Pulses, period: float) -> tuple[str, ...]:
    """Return a remark where the outputs of the run that is left alone do not stay."""
    answers = np.abs(pulses.markov).max(axis=0) @ np.array([pulses.widths[n] for n in task.inputs])
    size = np.abs(pulses.base).max(axis=0)
    drift = np.abs(pulses.base - pulses.base[0]).max(axis=0)
    result = np.flatnonzero(drift > np.maximum(_MOVING * answers, _STANDS * size))
    span = period * (len(pulses.base) - 1)
    return moving_note([f"{task.outputs[i]} changes by {drift[i]:.4g} within {span:.4g} s" for i in result])


def _notes(realised: Realisation, largest: Realisation, pulses: Pulses, trials: Sequence[MoveTrial]) -> list[str]:
    size = np.abs(pulses.markov).max(axis=0)
    relative = np.divide(pulses.noise, size, out=np.zeros_like(size), where=size > 0.0)
    order, noise = len(realised.A), relative.max(initial=0.0)
    notes = [f"order {order} (singular values above the noise, {noise:.1e} of the response)"]
    if order < len(largest.A):
        more = f"singular values above the noise would give {len(largest.A)}"
        notes = [f"order {order}, the smallest that predicts other pulses and a step as well as any larger one; {more}"]
    error = max((t.error(realised) for t in trials), default=0.0)
    untested = [f"{name} by {t.input}" for t in trials for name in t.untested]
    less = f", as far as they rise above the scatter of the runs; {', '.join(untested)} did not" if untested else ""
    notes.append(f"other pulses and a step, not used for the fit, are predicted within {100.0 * error:.2g} %{less}")
    notes += [
        f"{n}: moved by {0.5 * pulses.widths[n]:.3g} up and down; smaller pulses would be lost in the noise of the "
        "integration"
        for n in pulses.widened
    ]
    return notes


def _result(
    task: LinTask, realised: Realisation, point: OperatingPoint, period: float, between: Intersample
) -> LinResult:
    names = tuple(f"z{i}" for i in range(1, len(realised.A) + 1))
    units = {**dict.fromkeys(names), **{n: point.units.get(n) for n in (*task.inputs, *task.outputs)}}
    result = LinResult(
        model=task.model.name,
        interface=task.model.interface,
        method="response",
        why="it was asked for",
        A=realised.A,
        B=realised.B,
        C=realised.C,
        D=realised.D,
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

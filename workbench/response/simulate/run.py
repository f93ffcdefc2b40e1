"""Time histories: run a model under given inputs and record its outputs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeGuard

import numpy as np
from numpy.typing import NDArray

from workbench.core.records.forms import Numbers
from workbench.core.values.arrays import Floats
from workbench.core.values.operating_point import OperatingPoint
from workbench.errors import EndedError, FmuError, InputError, SimulationError, StoppedError
from workbench.fmi.variable import EXACT_TO, WHOLE_RANGES
from workbench.jobs.job import Job
from workbench.model.base import Model
from workbench.model.described_model import DescribedModel
from workbench.model.load import FmuModel
from workbench.model.names import declared_units, forced_inputs, found_variables, variables_of
from workbench.model.operating_point import standing, start_at
from workbench.response.simulate.divergence import DivergenceError, divergence, explained
from workbench.response.simulate.request import Simulate
from workbench.response.simulate.result import SimulationResult
from workbench.session.base import Recorded, Session
from workbench.session.compiled import CompiledSession
from workbench.session.pauses import at_pauses
from workbench.signals.kinds import Signal, Sine

__all__ = ["run"]

DEFAULT_POINTS = 500
MOST_USUAL_POINTS = 5000
MAX_POINTS = 10_000_000
WORRYING_CHANGE = 0.01
_FEW = 6  # elements of an array that are named
_SAME = 1e-6  # of a step: rounding
_JUMP = 1e-9  # relative: an input that moves by less stays where it is


def run(model: Model, request: Simulate, job: Job) -> SimulationResult:
    """Simulate a model; see `Simulate`."""
    model, remarks = start_at(model, request.at)
    inputs = forced_inputs(model, request.inputs)
    names, instead = _names(model, request.outputs)
    start = model.start_time if request.start_time is None else request.start_time
    stop, notes = _stop(model, request)
    stop, ends = _on_grid(start, stop, model.grid if request.points is None else None)
    notes = (*remarks, *notes, *ends, *instead, *_left_out(model, inputs), *_jumps(model, inputs, start))
    interval = _usual_interval(model, stop - start) if request.interval is None else request.interval
    rows = _points(start, stop, interval, request.points, grid=model.grid)
    running = _Run(model, start, stop, inputs, names, rows, exactly=request.points is not None)

    def tell(time: float) -> None:
        part = int(100.0 * (time - start) / (stop - start))
        if job.reached != (part, 100):
            job.done(f"t = {time:.6g} s", part, 100)

    try:
        with at_pauses(tell):
            result = running.once(None)
        tell(stop)
        if result.step is not None and request.verify_step:
            job.found(lambda: running.result(result, notes), "the repetition with half the communication step")
    except StoppedError as error:
        if _has_rows(error.before):
            ended = running.result(_Once(error.before, None), (*notes, f"stopped before {stop:g} s"))
            job.partial = lambda: replace(ended, ended_at=float(ended.time[-1]))
        raise
    except SimulationError as error:
        why = explained(model, error, start=start, signals=inputs, names=names)
        if _has_rows(error.before):
            why.before = cut = running.result(_Once(error.before, None), notes, failed=why)
            job.partial = lambda: cut
        if why is error:
            raise
        raise why from error
    if result.step is None or not request.verify_step:
        return running.result(result, notes)
    doubts, finer = running.doubts(result)
    whole = running.result(result, (*notes, *doubts))
    return whole if finer is None else replace(whole, step_change=_changes(whole, finer))


def _left_out(model: Model, inputs: Mapping[str, Signal]) -> Iterator[str]:
    """Yield notes on inputs that are not forced: that none is, and elements of arrays, as by too short a list."""
    if model.inputs and not inputs:
        count = len(model.inputs)
        yield f"no input is forced: {'it stays' if count == 1 else f'all {count} stay'} as at the start"
    whole: dict[str, list[str]] = {}
    for variable in model.inputs:
        if variable.name.endswith("]"):
            whole.setdefault(variable.name.rpartition("[")[0], []).append(variable.name)
    for name, elements in whole.items():
        free = [one for one in elements if one not in inputs]
        if 0 < len(free) < len(elements):
            shown = ", ".join(free[:_FEW]) + (", …" if len(free) > _FEW else "")
            yield f"{name}: of {len(elements)} elements these are not forced, and keep their start values: {shown}"


def _jumps(model: Model, inputs: Mapping[str, Signal], start: float) -> tuple[str, ...]:
    """Return a note on each forced input that leaves the operating point at once."""
    held = {} if model.at is None else model.at.u
    begins = {name: signal(start) for name, signal in inputs.items() if name in held}
    return tuple(
        f"{name} is {held[name]:g} at the operating point, but its signal begins at {value:g}"
        for name, value in begins.items()
        if abs(value - held[name]) > _JUMP * max(abs(value), abs(held[name]))
    )


def _stop(model: Model, request: Simulate) -> tuple[float, tuple[str, ...]]:
    """Return when the run ends [s], with the last point that is recorded or else as the model says, with a note."""
    if request.stop is not None:
        return request.stop, ()
    if request.points is not None and np.size(request.points) > 1:
        return float(np.ravel(request.points)[-1]), ()
    if model.stop_time is None:
        raise InputError(f"{model.name} has no default stop time; give the end of the run, `stop`")
    return model.stop_time, (f"stop: {model.stop_time:g} s, from the FMU's default experiment; `stop` changes it",)


def _on_grid(start: float, stop: float, step: float | None) -> tuple[float, tuple[str, ...]]:
    """Return the last instant up to `stop` [s] that constant steps reach, and a note where it is earlier."""
    if step is None:
        return stop, ()
    last = start + step * math.floor((stop - start) / step + _SAME)
    if last <= start or stop - last <= _SAME * step:
        return stop, ()
    return last, (f"the run ends at {last:g} s, before {stop:g} s: the FMU takes steps of {step:g} s only",)


def _usual_interval(model: Model, span: float) -> float | None:
    """Return the interval at which rows are recorded unless told otherwise [s]; None: a 500th of the run.

    Model exchange: the step that it was loaded with, else that of the default experiment, doubled where it gives too
    many points. Co-simulation: a multiple of the communication step, so that recording does not shorten the steps.
    """
    if isinstance(model, DescribedModel) and model.interface == "me" and model.recipe.step is not None:
        return model.recipe.step
    if not isinstance(model, DescribedModel):
        return None
    is_cs = model.interface == "cs"
    step = model.recipe.step
    if isinstance(model, FmuModel):
        step = step or model.description.experiment.step
    if step is None or not step < span:
        return None
    if is_cs:
        return step * max(1, round(span / DEFAULT_POINTS / step))
    while span / step > MOST_USUAL_POINTS:
        step *= 2.0
    return step


def _growth(record: Recorded, units: Mapping[str, str | None]) -> tuple[str, ...]:
    """Return a note on what still grows without bound at the end, by more than a million times."""
    for name, values in record.values.items():
        result = divergence(record.time, values, variable=name, unit=units.get(name))
        if result is not None:
            return (result.words,)
    return ()


def _inexact(model: Model, columns: Mapping[str, Floats]) -> tuple[str, ...]:
    """Return a note on whole numbers with more digits than a result keeps."""
    known = variables_of(model)
    whole = [name for name in columns if known[name].type in WHOLE_RANGES]
    names = [name for name in whole if np.any(np.abs(columns[name]) >= EXACT_TO)]
    return (f"{', '.join(names)}: may be rounded, since results are exact below 2^53",) if names else ()


def _sampled(model: Model, inputs: Mapping[str, Signal]) -> tuple[str, ...]:
    """Return a note on inputs that may change at events only under a signal that never stands still."""
    known = variables_of(model)
    names = [name for name, s in inputs.items() if isinstance(s, Sine) and not known[name].is_continuous_input]
    if not names or model.interface != "me":
        return ()
    how = "may change at events only, so the sine is sampled where a value is recorded; `step` sets how often"
    return (f"{', '.join(names)}: {how}",)


def _has_rows(before: object) -> TypeGuard[Recorded]:
    """Return whether there are rows of a run that ended early: without any there is no time history."""
    return isinstance(before, Recorded) and len(before.time) > 0


@dataclass(frozen=True)
class _Once:
    """What one run gave: rows, communication step (None: model exchange), and how the FMU ended it if it did."""

    record: Recorded
    step: float | None
    ended: EndedError | None = None


@dataclass(frozen=True)
class _Run:
    """What to run, so that it can be run again with another communication step.

    Attributes:
        exactly: whether the recorded points were asked for one by one.
        begins: where each run began.
    """

    model: Model
    start: float
    stop: float
    inputs: dict[str, Signal]
    names: list[str]
    points: Floats
    exactly: bool
    begins: list[OperatingPoint] = field(default_factory=list)

    def once(self, step: float | None) -> _Once:
        """Run with a communication step; None: the model's own."""
        with self.model.open_session(start_time=self.start, step=step, signals=self.inputs) as session:
            self.begins.append(standing(self.model, session))
            if isinstance(session, CompiledSession):
                session.recording.missing = True
            ended = None
            try:
                record = session.advance(self.stop, signals=self.inputs, record=self.names, points=self.points)
                record = _with_end(session, record, self.inputs, self.names)
            except EndedError as error:
                if not _has_rows(error.before):
                    raise
                record, ended = error.before, error
            return _Once(record, session.communication_step, ended)

    def result(self, once: _Once, notes: tuple[str, ...], *, failed: SimulationError | None = None) -> SimulationResult:
        """Return the result of a run, cut short or not."""
        model, end = self.model, once.ended or failed
        record = once.record
        if model.interface == "cs":
            record = _at_points(record, self.start, self.points, () if end is None else record.time[-1:])
        if isinstance(failed, DivergenceError) and not self.exactly:
            record = _with_rows(record, failed.followed)
        record, missing = _missing(_without_twins(record))
        units = declared_units(model, [*self.names, *self.inputs])
        columns = {**record.values, **record.inputs}
        if once.ended is not None:
            notes += (f"{once.ended}, before {self.stop:g} s",)
        notes += (*missing, *_growth(record, units), *_inexact(model, columns))
        derived = model.derived_step(once.step) if isinstance(model, DescribedModel) else ()
        notes += (*derived, *_sampled(model, self.inputs), *model.remarks(self.inputs))
        return SimulationResult(
            model.name,
            model.interface,
            model.solver,
            record.time,
            columns,
            units,
            notes,
            ended_at=None if end is None else end.time,
            failed=None if failed is None else str(failed),
            operating_point=self.begins[0],
        )

    def doubts(self, result: _Once) -> tuple[tuple[str, ...], Recorded | None]:
        """Repeat with half the communication step; return a note if the answer changes, and what that run gave."""
        step = result.step or 0.0
        advice = self.model.way_out(f"use a step below {step:.3g} s")
        try:
            finer = self.once(0.5 * step)
        except SimulationError as error:
            if self.model.grid is not None:  # it may refuse every other step
                advice = f"what the step of {step:.3g} s makes of the answer is not known"
            return (f"with half the communication step the run fails ({error}); {advice}",), None
        except InputError:  # a constant step that cannot be halved
            return (), None
        except FmuError as error:
            return (f"the FMU cannot be run again with half the communication step: {error}",), None
        change, name = _largest_change(result.record, finer.record)
        if change <= WORRYING_CHANGE:
            return (), finer.record
        note = f"{name} changes by {100.0 * change:.3g} % with half the communication step; {advice}"
        return (note,), finer.record


def _changes(result: SimulationResult, fine: Recorded) -> dict[str, Floats]:
    """Return how far each recorded variable is from the run with half the step at each row, 0 where one has no value.

    At an event the nearer limit counts: which one a row holds is no matter of the step.
    """
    left = np.searchsorted(fine.time, result.time, side="left")
    right = np.searchsorted(fine.time, result.time, side="right") - 1
    sides = [np.clip(k, 0, len(fine.time) - 1) for k in (left, right)]
    changes = {}
    for name, other in fine.values.items():
        both = [np.abs(result.signals[name] - other[k]) for k in sides]
        changes[name] = np.nan_to_num(np.minimum(*both), nan=0.0, posinf=0.0)
    return changes


def _largest_change(coarse: Recorded, fine: Recorded) -> tuple[float, str]:
    """Return the largest difference at common times relative to the signal's range, and its name."""
    worst, name = 0.0, ""
    for signal, values in coarse.values.items():
        last = np.searchsorted(fine.time, coarse.time, side="right") - 1
        other = fine.values[signal][last]
        right = np.append(coarse.time[1:] > coarse.time[:-1], True) & (coarse.time <= fine.time[-1])
        right &= np.isfinite(values) & np.isfinite(other)
        if not right.any():
            continue
        seen = other[np.isfinite(other)]
        span = max(float(np.ptp(seen)), 1e-9 * float(np.max(np.abs(seen))), 1e-300)
        change = float(np.max(np.abs(values - other)[right])) / span
        if change > worst:
            worst, name = change, signal
    return worst, name


def _names(model: Model, outputs: Sequence[str] | None) -> tuple[list[str], tuple[str, ...]]:
    """Return what is recorded, and a note if it stands in for outputs that are not declared."""
    if outputs is not None:
        return found_variables(model, outputs, "variable", what="outputs"), ()
    variables = model.description.variables if isinstance(model, DescribedModel) else ()
    known = {v.name for v in variables} or {v.name for v in model.states}
    kinds = {
        "outputs": model.outputs,
        "states": tuple(v for v in model.states if v.name in known),  # FMI 1.0 does not name them
        "local variables": tuple(
            v for v in variables if v.causality == "local" and v.variability != "constant" and not v.alias_of
        ),
    }
    for kind, result in kinds.items():
        names = [v.name for v in result if v.is_number]
        if names and kind == "outputs":
            return names, ()
        if names:
            return names, (
                f"no outputs are declared: the {kind} are recorded ({_some(names)}); `outputs` selects others",
            )
    return [], ("nothing is recorded: no outputs, states or local variables are declared",)


def _some(names: Sequence[str]) -> str:
    return ", ".join(names[:5]) + (f", … {len(names)} in all" if len(names) > 5 else "")


def _points(
    start: float,
    stop: float,
    interval: float | None,
    points: Numbers | None,
    *,
    grid: float | None = None,
) -> Floats:
    """Return where values are recorded [s]; where nothing is asked for, on the `grid` of communication points."""
    if not (math.isfinite(start) and math.isfinite(stop) and stop > start):
        raise InputError(f"stop: must be after the start at {start:g} s, not {stop:g} s")
    if points is not None:
        request: Floats = np.asarray(points, dtype=np.float64)
        if len(request) == 1 and request[0] > stop:
            raise InputError(
                f"points: are times to record, and {request[0]:g} s is after the stop at {stop:g} s; for a number of "
                f"rows give `interval`, as in interval={(stop - start) / request[0]:g}"
            )
        return request[1:] if len(request) and request[0] == start else request  # the start has a row in any case
    span = stop - start
    if interval is None:
        interval = span / DEFAULT_POINTS
        interval = grid * max(1, round(interval / grid)) if grid is not None else interval
    if not interval > 0.0:
        raise InputError(f"interval must be positive, not {interval:g} s")
    count = max(1, round(span / interval, 9).__floor__())
    if count > MAX_POINTS:
        raise InputError(f"interval {interval:g} s gives {count} points; at most {MAX_POINTS} are recorded")
    at = start + interval * np.arange(1, count + 1)
    return np.append(at[at < stop - 1e-9 * interval], stop)


_ROUNDING = 8.0 * np.finfo(float).eps  # of the largest value: both sides of a knot of straight lines


def _same(a: Floats, b: Floats) -> NDArray[np.bool_]:
    return np.asarray((a == b) | (np.isnan(a) & np.isnan(b)), dtype=np.bool_)


def _missing(record: Recorded) -> tuple[Recorded, tuple[str, ...]]:
    """Return a record in which all that is not finite is NaN, and a note on each variable where something is."""
    notes = []
    for name, values in record.values.items():
        gone = np.flatnonzero(~np.isfinite(values))
        if len(gone):
            first, to_the_end = record.time[gone[0]], gone[0] + len(gone) == len(values)
            when = f"from t = {first:.6g} s on"
            if not to_the_end:
                when = f"at {len(gone)} of {len(values)} instants, the first at t = {first:.6g} s"
            notes.append(f"{name} is not a finite number {when}; it is recorded as missing there")
    if not notes:
        return record, ()
    finite = {n: np.where(np.isfinite(v), v, np.nan) for n, v in record.values.items()}
    return replace(record, values=finite), tuple(notes)


def _with_end(session: Session, record: Recorded, inputs: Mapping[str, Signal], names: Sequence[str]) -> Recorded:
    """Append the right limit at the end if an event there changes something."""
    last = session.advance(session.time, signals=inputs, record=names)
    same = all(_same(last.values[n][:1], record.values[n][-1:]).all() for n in record.values)
    if same and all(last.inputs[n][0] == record.inputs[n][-1] for n in record.inputs):
        return record
    return Recorded(
        time=np.append(record.time, last.time[:1]),
        values={n: np.append(v, last.values[n][:1]) for n, v in record.values.items()},
        inputs={n: np.append(v, last.inputs[n][:1]) for n, v in record.inputs.items()},
    )


def _at_points(record: Recorded, start: float, points: Floats, end: Sequence[float] | Floats) -> Recorded:
    """Keep the rows at the points (and the end) only; co-simulation records every communication point twice."""
    times = np.sort(np.concatenate([[start], points, end]), kind="stable")  # almost sorted, as the record is
    last = np.append(record.time[1:] != record.time[:-1], True)
    keep = last.copy()
    for column in record.values.values():
        keep[:-1] |= ~_same(column[1:], column[:-1])
    if not np.array_equal(record.time[last], times):
        keep &= times[np.searchsorted(times[:-1], record.time)] == record.time
    return Recorded(
        time=record.time[keep],
        values={n: v[keep] for n, v in record.values.items()},
        inputs={n: v[keep] for n, v in record.inputs.items()},
    )


def _without_twins(record: Recorded) -> Recorded:
    """Leave out each row that is the one before it, but for rounding: an event at which nothing recorded changes."""
    twin = record.time[1:] == record.time[:-1]
    for column in (*record.values.values(), *record.inputs.values()):
        rounding = _ROUNDING * float(np.nanmax(np.abs(column), initial=0.0))
        twin &= _same(column[1:], column[:-1]) | (np.abs(column[1:] - column[:-1]) <= rounding)
    if not twin.any():
        return record
    keep = np.append(True, ~twin)
    return Recorded(
        time=record.time[keep],
        values={n: v[keep] for n, v in record.values.items()},
        inputs={n: v[keep] for n, v in record.inputs.items()},
    )


def _with_rows(record: Recorded, others: Recorded) -> Recorded:
    """Return a record with rows of another one between and after its own, in the order of time."""
    new = ~np.isin(others.time, record.time)
    time = np.append(record.time, others.time[new])
    order = np.argsort(time, kind="stable")  # two rows at one time are an event and keep their order
    return Recorded(
        time=time[order],
        values={n: np.append(v, others.values[n][new])[order] for n, v in record.values.items()},
        inputs={n: np.append(v, others.inputs[n][new])[order] for n, v in record.inputs.items()},
    )

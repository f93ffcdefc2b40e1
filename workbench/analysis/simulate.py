"""Time histories: run a model under given inputs and record its outputs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import numpy as np

from workbench.analysis.divergence import DivergenceError, divergence
from workbench.analysis.divergence_run import explained
from workbench.core.operating_point import At, OperatingPoint, point_in_json
from workbench.csv_file import write_csv
from workbench.errors import EndedError, InputError, SimulationError, article, suggest
from workbench.model.base import Model
from workbench.model.described import DescribedModel
from workbench.model.fmu_model import FmuModel
from workbench.model.placing import standing, start_at
from workbench.origin import Reportable, with_origin
from workbench.session.base import Floats, Record, Session
from workbench.signals import Signal

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["SimulationResult", "simulate"]

DEFAULT_POINTS = 500
MOST_USUAL_POINTS = 5000
MAX_POINTS = 10_000_000
WORRYING_CHANGE = 0.01
_JUMP = 1e-9  # relative: an input that moves by less stays where it is


@dataclass(frozen=True)
class SimulationResult(Reportable):
    """Time histories.

    Attributes:
        model, interface, solver: what ran.
        time: shape (n,) [s], never falling; a time given twice is an event (left, right limit).
        signals: name → shape (n,): the outputs, then the forced inputs as the model saw them.
        units: name → unit, None where the model declares none.
        notes: doubts about the result, e.g. a communication step that is too long.
        ended_at: when the run was cut short [s], by the FMU itself or by a failure; None: it came to its end.
        failed: why it failed; None: it did not. An FMU that ends its own run has not failed.
        operating_point: where the run begins.
    """

    model: str
    interface: str
    solver: str
    time: Floats
    signals: dict[str, Floats]
    units: dict[str, str | None]
    notes: tuple[str, ...] = ()
    ended_at: float | None = None
    failed: str | None = None
    operating_point: OperatingPoint | None = None

    def plot(self) -> Figure:
        """Return a picture with one panel per signal."""
        from workbench.plotting.time_history import time_history  # noqa: PLC0415  matplotlib is slow

        return time_history(self)

    def to_dict(self) -> dict[str, Any]:
        """Return plain lists, as the command line writes them to JSON."""
        return {
            "time": self.time.tolist(),
            "signals": {name: values.tolist() for name, values in self.signals.items()},
            "units": dict(self.units),
            "notes": list(self.notes),
            "ended_at": self.ended_at,
            "failed": self.failed,
            **point_in_json(self.operating_point),
        }

    def to_csv(self, path: str | Path | TextIO) -> None:
        """Write time [s] and every signal as columns with a heading line; a run cut short ends with a comment.

        Args:
            path: of the file, or an open text stream.

        Raises:
            InputError: the file cannot be written.
        """
        write_csv(path, [["time", *self.signals], *zip(*self._columns(), strict=True), *self._cut()])

    def _cut(self) -> list[list[str]]:
        if self.ended_at is None:
            return []
        return [[f"# ended at {self.ended_at:.9g} s: {self.failed or 'by the FMU itself'}"]]

    def _columns(self) -> list[list[float]]:
        return [self.time.tolist(), *(v.tolist() for v in self.signals.values())]


@with_origin()
def simulate(
    model: Model,
    *,
    stop: float | None = None,
    inputs: Mapping[str, Signal] | None = None,
    outputs: Sequence[str] | None = None,
    at: At | None = None,
    start_time: float | None = None,
    interval: float | None = None,
    points: Sequence[float] | Floats | None = None,
    verify_step: bool = True,
) -> SimulationResult:
    """Simulate a model.

    Args:
        model: what to run; it stays open.
        stop: final time [s], after `start_time`; None: that of the model's default experiment.
        inputs: forced inputs; the others keep their start value, or that of `at`.
        outputs: names of variables to record; None: all outputs; where there are none all states, else all locals.
        at: operating point to start at: a point, a result that has one, or the file of either; None: where the model
            starts. A forced input has the values of its signal, not those of the point.
        start_time: [s]; None: that of `at`, else of the model.
        interval: distance of the recorded points [s]; None: the step of the default experiment, doubled until there
            are at most 5000; in co-simulation a multiple of the communication step; else 1/500 of the run. Events are
            recorded besides.
        points: recorded points themselves, rising, in (start_time, stop] [s]; instead of `interval`.
        verify_step: co-simulation only: run again with half the communication step and note where
            the answer changes by more than 1 %.

    Raises:
        InputError: unknown name, an output forced, times or points out of order.
        FmuError: the FMU cannot be instantiated.
        SimulationError: the model failed while running; its `before` is the result up to then.
        DivergenceError: likewise, because something grew without bound: what, whether exponentially or to infinity
            in finite time, and when. Unless `points` names them, rows are added that show how, ever more densely.
    """
    inputs = dict(inputs or {})
    model, remarks = start_at(model, at)
    _check_inputs(model, inputs)
    names, instead = _names(model, outputs)
    start = model.start_time if start_time is None else start_time
    stop, told = _stop(model, stop)
    told = (*remarks, *told, *instead, *_jumps(model, inputs, start))
    interval = _usual_interval(model, stop - start) if interval is None else interval
    rows = _points(start, stop, interval, points, grid=model.grid)
    run = _Run(model, start, stop, inputs, names, rows, exactly=points is not None)
    try:
        found = run.once(None)
    except SimulationError as error:
        why = explained(model, error, start=start, signals=inputs, names=names)
        if isinstance(error.before, Record):
            why.before = run.result(_Once(error.before, None), told, failed=why)
        if why is error:
            raise
        raise why from error
    if found.step is not None and verify_step:
        told += run.doubts(found)
    return run.result(found, told)


def _jumps(model: Model, inputs: Mapping[str, Signal], start: float) -> tuple[str, ...]:
    """Return a note on each forced input that leaves the operating point at once."""
    held = {} if model.at is None else model.at.u
    begins = {name: signal(start) for name, signal in inputs.items() if name in held}
    return tuple(
        f"{name} is {held[name]:g} at the operating point, but its signal begins at {value:g}"
        for name, value in begins.items()
        if abs(value - held[name]) > _JUMP * max(abs(value), abs(held[name]))
    )


def _stop(model: Model, stop: float | None) -> tuple[float, tuple[str, ...]]:
    """Return when the run ends [s], and a note if the model decides it."""
    if stop is not None:
        return stop, ()
    if model.stop_time is None:
        raise InputError(f"{model.name} names no stop time of its own; say how long to simulate (stop, --stop)")
    return model.stop_time, (f"stop: {model.stop_time:g} s, the default experiment's; --stop sets it",)


def _usual_interval(model: Model, span: float) -> float | None:
    """Return the interval at which rows are recorded unless told otherwise [s]; None: a 500th of the run.

    Model exchange: the step of the default experiment, doubled where it gives too many points. Co-simulation: a
    multiple of the communication step, so that recording does not shorten the steps.
    """
    if not isinstance(model, FmuModel):
        return None
    is_cs = model.interface == "cs"
    step = (model.recipe.step if is_cs else None) or model.description.experiment.step
    if step is None or not step < span:
        return None
    if is_cs:
        return step * max(1, round(span / DEFAULT_POINTS / step))
    while span / step > MOST_USUAL_POINTS:
        step *= 2.0
    return step


def _growth(record: Record, units: Mapping[str, str | None]) -> tuple[str, ...]:
    """Return a note on what still grows without bound at the end, by more than a million times."""
    for name, values in record.values.items():
        found = divergence(record.time, values, variable=name, unit=units.get(name))
        if found is not None:
            return (found.words,)
    return ()


@dataclass(frozen=True)
class _Once:
    """What one run gave: rows, communication step (None: model exchange), and how the FMU ended it if it did."""

    record: Record
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
            ended = None
            try:
                record = session.advance(self.stop, signals=self.inputs, record=self.names, points=self.points)
                record = _with_end(session, record, self.inputs, self.names)
            except EndedError as error:
                if not isinstance(error.before, Record):
                    raise
                record, ended = error.before, error
            return _Once(record, session.communication_step, ended)

    def result(
        self, found: _Once, notes: tuple[str, ...], *, failed: SimulationError | None = None
    ) -> SimulationResult:
        """Return the result of a run, cut short or not."""
        model, end = self.model, found.ended or failed
        record = found.record
        if model.interface == "cs":
            record = _at_points(record, self.start, self.points, () if end is None else record.time[-1:])
        if isinstance(failed, DivergenceError) and not self.exactly:
            record = _with_rows(record, failed.followed)
        units = _units(model, [*self.names, *self.inputs])
        columns = {**record.values, **record.inputs}
        if found.ended is not None:
            notes += (f"{found.ended}, before {self.stop:g} s",)
        notes += (*_growth(record, units), *model.remarks())
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

    def doubts(self, found: _Once) -> tuple[str, ...]:
        """Repeat with half the communication step; return a note if the answer changes."""
        step = found.step or 0.0
        advice = f"use a step below {step:.3g} s, or interface me"
        try:
            finer = self.once(0.5 * step)
        except SimulationError as error:
            return (f"with half the communication step the run fails ({error}); {advice}",)
        except InputError:  # a constant step that cannot be halved
            return ()
        change, name = _largest_change(found.record, finer.record)
        if change <= WORRYING_CHANGE:
            return ()
        return (f"{name} changes by {100.0 * change:.3g} % with half the communication step; {advice}",)


def _largest_change(coarse: Record, fine: Record) -> tuple[float, str]:
    """Return the largest difference at common times relative to the signal's range, and its name."""
    worst, name = 0.0, ""
    for signal, values in coarse.values.items():
        last = np.searchsorted(fine.time, coarse.time, side="right") - 1
        other = fine.values[signal][last]
        right = np.append(coarse.time[1:] > coarse.time[:-1], True) & (coarse.time <= fine.time[-1])
        span = max(float(np.ptp(other)), 1e-9 * float(np.max(np.abs(other))), 1e-300)
        change = float(np.max(np.abs(values - other)[right])) / span
        if change > worst:
            worst, name = change, signal
    return worst, name


def _check_inputs(model: Model, inputs: Mapping[str, Signal]) -> None:
    known = [v.name for v in model.inputs]
    others = {v.name: v.causality for v in (*model.outputs, *model.parameters, *model.states)}
    for name in inputs:
        if name not in known:
            what = f"is {article(others[name])}" if name in others else "is unknown"
            raise InputError(f"'{name}' {what}, but an input is needed here; {suggest(name, known)}")


def _names(model: Model, outputs: Sequence[str] | None) -> tuple[list[str], tuple[str, ...]]:
    """Return what is recorded, and a note if it stands in for outputs that are not declared."""
    if outputs is not None:
        return list(dict.fromkeys(outputs)), ()
    variables = model.description.variables if isinstance(model, DescribedModel) else ()
    known = {v.name for v in variables} or {v.name for v in model.states}
    kinds = {
        "outputs": model.outputs,
        "states": tuple(v for v in model.states if v.name in known),  # FMI 1.0 does not name them
        "local variables": tuple(v for v in variables if v.causality == "local" and v.variability != "constant"),
    }
    for kind, found in kinds.items():
        names = [v.name for v in found if v.is_number]
        if names and kind == "outputs":
            return names, ()
        if names:
            return names, (f"no outputs are declared: the {kind} are recorded ({_some(names)}); --output names others",)
    return [], ("nothing is recorded: no outputs, states or local variables are declared",)


def _some(names: Sequence[str]) -> str:
    return ", ".join(names[:5]) + (f", … {len(names)} in all" if len(names) > 5 else "")


def _points(
    start: float,
    stop: float,
    interval: float | None,
    points: Sequence[float] | Floats | None,
    *,
    grid: float | None = None,
) -> Floats:
    """Return where values are recorded [s]; where nothing is asked for, on the `grid` of communication points."""
    if not (math.isfinite(start) and math.isfinite(stop) and stop > start):
        raise InputError(f"stop must lie after the start at {start:g} s, not at {stop:g} s")
    if points is not None:
        return np.asarray(points, dtype=np.float64)
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


def _with_end(session: Session, record: Record, inputs: Mapping[str, Signal], names: Sequence[str]) -> Record:
    """Append the right limit at the end if an event there changes something."""
    last = session.advance(session.time, signals=inputs, record=names)
    same = all(last.values[n][0] == record.values[n][-1] for n in record.values)
    if same and all(last.inputs[n][0] == record.inputs[n][-1] for n in record.inputs):
        return record
    return Record(
        time=np.append(record.time, last.time[:1]),
        values={n: np.append(v, last.values[n][:1]) for n, v in record.values.items()},
        inputs={n: np.append(v, last.inputs[n][:1]) for n, v in record.inputs.items()},
    )


def _at_points(record: Record, start: float, points: Floats, end: Sequence[float] | Floats) -> Record:
    """Keep the rows at the points (and the end) only; co-simulation records every communication point twice."""
    wanted = np.isin(record.time, np.concatenate([[start], points, end]))
    same_time = np.append(record.time[1:] == record.time[:-1], False)
    repeats = same_time.copy()
    for column in record.values.values():
        repeats &= np.append(column[1:] == column[:-1], False)
    keep = wanted & ~repeats
    return Record(
        time=record.time[keep],
        values={n: v[keep] for n, v in record.values.items()},
        inputs={n: v[keep] for n, v in record.inputs.items()},
    )


def _with_rows(record: Record, others: Record) -> Record:
    """Return a record with rows of another one between and after its own, in the order of time."""
    new = ~np.isin(others.time, record.time)
    time = np.append(record.time, others.time[new])
    order = np.argsort(time, kind="stable")  # two rows at one time are an event and keep their order
    return Record(
        time=time[order],
        values={n: np.append(v, others.values[n][new])[order] for n, v in record.values.items()},
        inputs={n: np.append(v, others.inputs[n][new])[order] for n, v in record.inputs.items()},
    )


def _units(model: Model, names: Sequence[str]) -> dict[str, str | None]:
    every = (*model.parameters, *model.states, *model.outputs, *model.inputs)
    known = {v.name: v.unit for v in every}
    return {name: known.get(name) for name in names}

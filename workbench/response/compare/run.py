"""Several models under the same signals, side by side: what is done."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from workbench.core.values.operating_point import At, OperatingPoint
from workbench.errors import InputError, SimulationError, suggest
from workbench.jobs.job import Job
from workbench.model.described_model import DescribedModel
from workbench.model.names import check_variables, forced_inputs
from workbench.model.operating_point import start_at
from workbench.response.compare.measures import measure
from workbench.response.compare.request import CompareMotions
from workbench.response.compare.result import Motion, MotionComparison, MotionFailed, MotionHistory
from workbench.response.compare.units import DisplayedUnit, shown_unit
from workbench.response.simulate.request import Simulate
from workbench.response.simulate.result import SimulationResult
from workbench.signals.kinds import Signal
from workbench.signals.text import signal_text

__all__ = ["run"]

_POINTS = 40_000
_BEFORE = 1.0 - 1e-6

Window = tuple[float, float]


def run(systems: Mapping[str, DescribedModel], request: CompareMotions, job: Job) -> MotionComparison:
    """Simulate several models; see `CompareMotions`."""
    systems = _labelled(systems, request.label)
    points = _points(list(systems), request.at or {})
    placed = {name: start_at(model, points.get(name)) for name, model in systems.items()}
    systems = {name: model for name, (model, _) in placed.items()}
    if not systems:
        raise InputError("compare: give at least one model")
    first = next(iter(systems.values()))
    signals = _signals(systems) if request.outputs is None else tuple(dict.fromkeys(request.outputs))
    if not signals:
        raise InputError("outputs: none given; leave it out for all that the models have in common")
    for model in systems.values():
        check_variables(model, signals, "variable", what="outputs")
    windows = [(float(begin), float(end)) for begin, end in request.windows] or [(0.0, _stop(first, request.stop))]
    forced = {name: forced_inputs(model, request.inputs) for name, model in systems.items()}
    units = {v.name: v.unit for v in first.description.variables if v.name in signals}
    shown = _shown({s: units.get(s) for s in signals}, request.unit)
    end = _end(windows, request.stop)
    simulation = Simulate(
        workers=request.place,
        stop=end,
        inputs=request.inputs,
        outputs=signals,
    )
    histories, failed = list[MotionHistory](), list[MotionFailed]()
    begins: dict[str, OperatingPoint | None] = {}
    notes: list[str] = []

    def found() -> MotionComparison:
        return MotionComparison(
            systems=tuple(systems),
            models=tuple(m.name for m in systems.values()),
            signals=signals,
            windows=tuple(windows),
            units={s: units.get(s) for s in signals},
            shown=shown,
            motions=tuple(m for h in histories for m in _motions(h, windows)),
            histories=tuple(histories),
            failed=tuple(failed),
            inputs={n: _text(s) for one in forced.values() for n, s in one.items()},
            stop=end,
            operating_points=begins,
            notes=(*(f"{n}: {text}" for n, (_, remarks) in placed.items() for text in remarks), *notes),
        )

    for number, (name, model) in enumerate(systems.items(), 1):
        history, why, told = _run(model, replace(simulation, interval=_interval(model, request, end)), job)
        notes += (f"{name}: {text}" for text in told)
        if why is not None:
            failed.append(MotionFailed(system=name, time=why.time, reason=str(why), kind=why.kind))
        if history is not None:
            histories.append(_history(name, history, signals))
            begins[name] = history.operating_point
        job.partial = found
        job.done(name, number, len(systems))
    return found()


def _labelled(systems: Mapping[str, DescribedModel], labels: Sequence[str]) -> dict[str, DescribedModel]:
    """Return the models by their labels, if there are any."""
    if labels and len(labels) != len(systems):
        raise InputError(f"label: {len(labels)} names for {len(systems)} models")
    for label in labels:
        if list(labels).count(label) > 1:
            raise InputError(f"label: '{label}' is given twice")
    return dict(zip(labels or systems, systems.values(), strict=True))


def _points(names: Sequence[str], at: Mapping[str, At] | Sequence[At]) -> Mapping[str, At]:
    """Return the operating points by the names of the models; one that is missing starts where it does by itself."""
    if isinstance(at, Mapping):
        for name in at:
            if name not in names:
                raise InputError(f"compare: at: there is no '{name}'; {suggest(name, names)}")
        return at
    if len(at) != len(names):
        raise InputError(f"at: {len(at)} operating points for {len(names)} models; give one for each, in their order")
    return dict(zip(names, at, strict=True))


def _signals(systems: Mapping[str, DescribedModel]) -> tuple[str, ...]:
    """Return the outputs that all models have, in the order of the first."""
    names = [[v.name for v in model.outputs] for model in systems.values()]
    common = tuple(name for name in names[0] if all(name in others for others in names[1:]))
    if not common:
        raise InputError("compare: the models have no output in common; name variables with `outputs`")
    return common


def _shown(units: Mapping[str, str | None], unit: str | None) -> dict[str, DisplayedUnit]:
    """Return how each signal is shown: in the unit that is asked for, where its own converts to it."""
    shown = {name: shown_unit(own, unit) for name, own in units.items()}
    if unit is not None and not any(u.unit == unit for u in shown.values()):
        known = ", ".join(sorted({u for u in units.values() if u})) or "none declared"
        raise InputError(f"compare: no signal can be shown in '{unit}'; their units: {known}")
    return shown


def _end(windows: Sequence[Window], stop: float | None) -> float:
    """Return where the runs end: no earlier than the last window does."""
    last = max(end for _, end in windows)
    if stop is not None and stop < last:
        raise InputError(f"compare: the run ends at {stop:g} s, before the last window does")
    return last if stop is None else stop


def _stop(first: DescribedModel, stop: float | None) -> float:
    """Return where runs without a window end."""
    end = first.stop_time if stop is None else stop
    if end is None:
        raise InputError(f"compare: {first.name} has no default experiment; give `stop` or `windows`")
    return end


def _interval(model: DescribedModel, request: CompareMotions, end: float) -> float:
    """Return the interval between rows [s]: of co-simulation a multiple of its step, as a row between would shorten it.

    So a model moves as it does when it is simulated alone.
    """
    if request.interval is not None:
        return request.interval
    finest = end / _POINTS
    step = (model.recipe.step or model.description.experiment.step or model.grid) if model.interface == "cs" else None
    return finest if step is None else step * max(1, math.ceil(finest / step))


def _run(
    model: DescribedModel, request: Simulate, job: Job
) -> tuple[SimulationResult | None, SimulationError | None, list[str]]:
    """Return what ran, why it ended early, and remarks; what came before a failure is run once more."""
    inner = Job()
    with job.ended_by(inner.stop):
        try:
            result = request.run(model, inner)
            return result, None, [*inner.notes, *result.notes]
        except SimulationError as error:
            if error.time is None or not error.time > 0.0:
                return None, error, inner.notes
            try:
                return replace(request, stop=error.time * _BEFORE).run(model, inner), error, inner.notes
            except SimulationError:
                return None, error, inner.notes


def _history(name: str, run: SimulationResult, signals: Sequence[str]) -> MotionHistory:
    return MotionHistory(
        system=name,
        time=np.asarray(run.time, dtype=np.float64),
        values={s: np.asarray(run.signals[s], dtype=np.float64) for s in signals},
    )


def _motions(history: MotionHistory, windows: Sequence[Window]) -> list[Motion]:
    result = []
    for signal, value in history.values.items():
        for number, window in enumerate(windows):
            if history.time[-1] < window[1] * _BEFORE:
                continue
            measured = measure(history.time, value, window)
            if measured is not None:
                result.append(Motion(system=history.system, signal=signal, window=number, measure=measured))
    return result


def _text(signal: Signal) -> str:
    """Return a signal as `--input` reads it, or what a class of another module says of itself."""
    try:
        return signal_text(signal)
    except InputError:
        return str(signal)

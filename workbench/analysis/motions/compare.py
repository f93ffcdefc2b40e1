"""The public function: several models under the same signals, side by side."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from workbench.analysis.motions.measures import measure
from workbench.analysis.motions.result import Motion, MotionComparison, MotionFailed, MotionHistory
from workbench.analysis.motions.units import shown_unit
from workbench.analysis.simulate.request import Simulate
from workbench.analysis.simulate.result import SimulationResult
from workbench.core.job import Job
from workbench.core.operating_point import At, OperatingPoint
from workbench.errors import InputError, SimulationError, suggest
from workbench.model.described import DescribedModel
from workbench.model.placing import start_at
from workbench.origin import with_origin
from workbench.signals import Signal
from workbench.workers import Workers

__all__ = ["compare_motions"]

_POINTS = 40_000
_BEFORE = 1.0 - 1e-6

Window = tuple[float, float]


@with_origin()
def compare_motions(
    systems: Mapping[str, DescribedModel],
    *,
    signals: Sequence[str],
    windows: Sequence[Window],
    inputs: Mapping[str, Signal] | None = None,
    at: Mapping[str, At] | None = None,
    stop: float | None = None,
    interval: float | None = None,
    unit: str | None = None,
    workers: Workers | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> MotionComparison:
    """Simulate several models under the same signals, and compare peak and rms of variables in windows of time.

    Not for statistics of random motions: a window is one record, its peak one value.

    Args:
        systems: name for tables and pictures → FMU or system; they stay open. The first is what the others are
            compared with.
        signals: variables that each of them has; of systems also "component.variable".
        windows: begin and end [s].
        inputs: forced inputs, which each of them has; the others keep their start values.
        at: name, as in `systems` → operating point at which it starts: a point, a result that has one, or the file of
            either; the others start where they do by themselves.
        stop: end of the runs [s]; None: that of the last window.
        interval: distance of the rows [s]; None: 1/40000 of the run.
        unit: peaks and rms are also told in it where the variable's unit allows; "g" is the standard gravity.
        workers: where the models run.
        progress: called with name, number done and number in all.

    Returns:
        A run that fails (an FMU that crashes, a motion that grows without bound) is reported, with what it recorded
        until then; the others count.

    Raises:
        InputError: unknown name, a window that is empty or outside the run, a unit that no signal has.

    Examples:
        The step responses 1 - exp(-t/tau) after 1 s, for tau = 1 s and 2 s.

        >>> with wb.load("fmu:FirstOrderLag") as fast, wb.load("fmu:FirstOrderLag", start_values={"tau": 2.0}) as slow:
        ...     found = wb.compare_motions(
        ...         {"fast": fast, "slow": slow}, signals=["y"], windows=[(0, 1)], inputs={"u": wb.Constant(1.0)}
        ...     )
        >>> print({motion.system: round(motion.measure.peak, 4) for motion in found.motions})
        {'fast': 0.6321, 'slow': 0.3935}
    """
    for name in at or {}:
        if name not in systems:
            raise InputError(f"compare: at: there is no '{name}'; {suggest(name, systems)}")
    placed = {name: start_at(model, (at or {}).get(name)) for name, model in systems.items()}
    systems = {name: model for name, (model, _) in placed.items()}
    _check(systems, signals, windows, inputs or {})
    first = next(iter(systems.values()))
    units = {v.name: v.unit for v in first.description.variables if v.name in signals}
    shown = {s: shown_unit(units.get(s), unit) for s in signals}
    if unit is not None and not any(u.unit == unit for u in shown.values()):
        known = ", ".join(sorted({u for u in units.values() if u})) or "none declared"
        raise InputError(f"compare: no signal can be shown in '{unit}'; their units: {known}")
    end = max(w[1] for w in windows) if stop is None else stop
    if end < max(w[1] for w in windows):
        raise InputError(f"compare: the run ends at {end:g} s, before the last window does")
    asked = Simulate(
        workers=workers or Workers(in_process=True),
        stop=end,
        inputs=dict(inputs or {}),
        outputs=tuple(signals),
        interval=end / _POINTS if interval is None else interval,
    )
    histories, failed = list[MotionHistory](), list[MotionFailed]()
    points: dict[str, OperatingPoint | None] = {}
    for number, (name, model) in enumerate(systems.items(), 1):
        run, why = _run(model, asked)
        if why is not None:
            failed.append(MotionFailed(system=name, time=why.time, reason=str(why)))
        if run is not None:
            histories.append(_history(name, run, signals))
            points[name] = run.operating_point
        if progress is not None:
            progress(name, number, len(systems))
    return MotionComparison(
        systems=tuple(systems),
        models=tuple(m.name for m in systems.values()),
        signals=tuple(signals),
        windows=tuple((float(a), float(b)) for a, b in windows),
        units={s: units.get(s) for s in signals},
        shown=shown,
        motions=tuple(m for h in histories for m in _motions(h, windows)),
        histories=tuple(histories),
        failed=tuple(failed),
        inputs={n: str(s) for n, s in (inputs or {}).items()},
        stop=end,
        operating_points=points,
        notes=tuple(f"{n}: {text}" for n, (_, remarks) in placed.items() for text in remarks),
    )


def _check(
    systems: Mapping[str, DescribedModel],
    signals: Sequence[str],
    windows: Sequence[Window],
    inputs: Mapping[str, Signal],
) -> None:
    if not systems or not signals or not windows:
        raise InputError("compare: give at least one system, one signal and one window")
    for begin, end in windows:
        if not (np.isfinite([begin, end]).all() and 0.0 <= begin < end):
            raise InputError(f"compare: the window {begin:g}:{end:g} s must rise, from 0 on")
    for name, model in systems.items():
        known = {v.name for v in model.description.variables} | {v.name for v in model.outputs}
        for signal in signals:
            if signal not in known:
                raise InputError(f"compare: {name} has no variable '{signal}'; {suggest(signal, known)}")
        open_to = [v.name for v in model.inputs]
        for given in inputs:
            if given not in open_to:
                raise InputError(f"compare: {name} has no input '{given}'; {suggest(given, open_to)}")


def _run(model: DescribedModel, asked: Simulate) -> tuple[SimulationResult | None, SimulationError | None]:
    """Return what ran, and why it ended early; what came before a failure is run once more."""
    try:
        return asked.run(model, Job()), None
    except SimulationError as error:
        if error.time is None or not error.time > 0.0:
            return None, error
        try:
            return replace(asked, stop=error.time * _BEFORE).run(model, Job()), error
        except SimulationError:
            return None, error


def _history(name: str, run: SimulationResult, signals: Sequence[str]) -> MotionHistory:
    return MotionHistory(
        system=name,
        time=np.asarray(run.time, dtype=np.float64),
        values={s: np.asarray(run.signals[s], dtype=np.float64) for s in signals},
    )


def _motions(history: MotionHistory, windows: Sequence[Window]) -> list[Motion]:
    found = []
    for signal, value in history.values.items():
        for number, window in enumerate(windows):
            if history.time[-1] < window[1] * _BEFORE:
                continue
            measured = measure(history.time, value, window)
            if measured is not None:
                found.append(Motion(system=history.system, signal=signal, window=number, measure=measured))
    return found

"""The nonlinear system with a control connected at some time: how it settles, or that it does not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from workbench.core.records.record import RecordPart, entry
from workbench.core.values.arrays import Floats
from workbench.core.values.linear import LinearPart
from workbench.errors import SimulationError
from workbench.limit_cycles.feed_forward.wiring import Loops, closed, reopen
from workbench.model.described_model import DescribedModel
from workbench.response.simulate.divergence import Divergence, DivergenceError
from workbench.response.simulate.request import simulate
from workbench.response.simulate.result import SimulationResult
from workbench.signals.kinds import Signal

__all__ = ["THRESHOLDS", "Trial", "TrialSettings", "run_trial", "settling"]

THRESHOLDS = (0.5, 0.1, 0.05, 0.01)
_WINDOW = 0.1  # of the time before closing, in which the amplitude is measured
_END = 0.05  # of the time after it, in which the rest is measured
_PER_RUN = 20_000  # recorded points
_NEAR = 1000  # points between closing and an escape
_BEFORE = (1e-4, 1e-2, 0.1, 0.5)  # of the time after closing: how long before a failure the record ends


@dataclass(frozen=True, eq=False, kw_only=True)
class Trial(RecordPart):
    """One simulation.

    Attributes:
        name: name of the control, such as "scalar feedback" or "feed-forward".
        limited: whether the actuator with its limits was in front of the target.
        closes_at: [s].
        time: shape (n,) [s].
        signals: variable → shape (n,): the block's input and output, the target, what else was asked for.
        units: variable → unit.
        before: largest magnitude of the block's input in the last tenth before closing.
        settling_seconds: part of `before` → time after closing from which on the block's input stays below it [s];
            None: it does not.
        rest: largest magnitude at the end over `before`; None: it did not get there.
        largest_target: magnitude of the control input after closing.
        largest_target_rate: largest rate of the target, from differences [per s].
        divergence: what grew without bound; None: nothing.
        failure: why the run stopped; "": it did not.
    """

    name: str
    limited: bool
    closes_at: float
    time: Floats = field(metadata=entry(dims=("time",), unit="s"))
    signals: Mapping[str, Floats] = field(metadata=entry(dims=("time",)))
    units: Mapping[str, str | None]
    before: float
    settling_seconds: Mapping[float, float | None]
    rest: float | None
    largest_target: float
    largest_target_rate: float
    divergence: Divergence | None = None
    failure: str = ""


@dataclass(frozen=True, kw_only=True)
class TrialSettings:
    """What all trials share.

    Attributes:
        inputs: forced inputs, which start the motion.
        outputs: variables to record besides those of the loop.
        stop: [s].
        closes_at: [s].
    """

    inputs: Mapping[str, Signal]
    outputs: tuple[str, ...]
    stop: float
    closes_at: float


def run_trial(model: DescribedModel, loops: Loops, part: LinearPart | None, run: TrialSettings, *, name: str) -> Trial:
    """Simulate a system with a control that is connected at `run.closes_at`.

    Args:
        model: the system; it stays open.
        loops: what is connected; without actuator there are no limits.
        part: the filter; None: feedback alone.
        run: how long, from which inputs.
        name: name of the trial.

    Raises:
        InputError: see `closed`.
    """
    loops = replace(loops, closes_at=run.closes_at if run.closes_at > 0.0 else None)
    names = list(dict.fromkeys([loops.ports.v, loops.ports.w, loops.target, *run.outputs]))
    points = np.linspace(0.0, run.stop, _PER_RUN + 1)[1:]
    result, failure = None, ""
    with reopen(model, closed(model, loops, part)) as system:
        used = {n: s for n, s in run.inputs.items() if n in {v.name for v in system.inputs}}
        try:
            record = simulate(system, stop=run.stop, inputs=used, outputs=names, points=points)
        except SimulationError as error:
            failure, result = str(error), error.divergence if isinstance(error, DivergenceError) else None
            record = _shorter(system, error, used, names, run)
        units = {v.name: v.unit for v in system.description.variables}
        record = replace(record, units={n: units.get(n) for n in record.units})
    return _trial(record, loops, run, name, result, failure)


def _shorter(
    system: DescribedModel,
    error: SimulationError,
    inputs: Mapping[str, Signal],
    names: Sequence[str],
    run: TrialSettings,
) -> SimulationResult:
    """Run again up to just before the failure, which need not come at the same time again."""
    if error.time is None or not error.time > 0.0:
        raise error
    begin = run.closes_at if run.closes_at < error.time else 0.0
    for part in _BEFORE:
        end = error.time - part * (error.time - begin)
        points = np.union1d(np.linspace(0.0, end, _PER_RUN + 1)[1:], np.linspace(begin, end, _NEAR + 1)[1:])
        try:
            return simulate(system, stop=end, inputs=inputs, outputs=names, points=points)
        except SimulationError:
            continue
    raise error


def _trial(  # noqa: PLR0917 - one row of facts
    record: SimulationResult, loops: Loops, run: TrialSettings, name: str, result: Divergence | None, failure: str
) -> Trial:
    time, v, u = record.time, record.signals[loops.ports.v], record.signals[loops.target]
    after, begin = time >= run.closes_at, run.closes_at * (1.0 - _WINDOW)
    start = (time >= begin) & ~after if run.closes_at > 0.0 else after
    before = float(np.max(np.abs(v[start]), initial=0.0))
    end = time >= run.stop - _END * (run.stop - run.closes_at)
    steps = np.diff(time[after])
    moving = steps > 0.0
    rates = np.abs(np.diff(u[after])[moving] / steps[moving])
    whole = not failure and before > 0.0
    return Trial(
        name=name,
        limited=loops.actuator is not None,
        closes_at=run.closes_at,
        time=time,
        signals={n: record.signals[n] for n in record.signals if n not in run.inputs},
        units=record.units,
        before=before,
        settling_seconds={
            part: settling(time, v, run.closes_at, part * before) if whole else None for part in THRESHOLDS
        },
        rest=float(np.max(np.abs(v[end]))) / before if whole else None,
        largest_target=float(np.max(np.abs(u[after]), initial=0.0)),
        largest_target_rate=float(np.max(rates, initial=0.0)),
        divergence=result,
        failure=failure,
    )


def settling(time: Floats, values: Floats, begin: float, level: float) -> float | None:
    """Return how long after `begin` a magnitude is above a level for the last time; None: up to the end.

    Args:
        time: shape (n,) [s].
        values: shape (n,).
        begin: [s].
        level: level of the magnitude.
    """
    above = np.flatnonzero((np.abs(values) > level) & (time >= begin))
    if not len(above):
        return 0.0
    # Less than one swing before the end nobody can tell whether it stays below.
    if time[above[-1]] > time[-1] - _END * (time[-1] - begin):
        return None
    return float(time[above[-1]] - begin)

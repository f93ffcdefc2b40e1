"""The nonlinear system with a control connected at some time: how it settles, or that it does not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from workbench.core.records.record import RecordPart, entry
from workbench.core.values.arrays import Floats
from workbench.errors import SimulationError
from workbench.limit_cycles.feedback.closed_system import ControlLaw, FeedbackPath
from workbench.loops.opened_system import Ports
from workbench.response.simulate.divergence import Divergence, DivergenceError
from workbench.response.simulate.request import simulate
from workbench.response.simulate.result import SimulationResult
from workbench.signals.kinds import Signal

__all__ = ["THRESHOLDS", "Trial", "run_trial", "settling"]

THRESHOLDS = (0.5, 0.1, 0.05, 0.01)
_WINDOW = 0.1  # of the time before closing, in which the amplitude is measured
_END = 0.05  # of the time after it, in which the rest is measured
_PER_RUN = 20_000  # recorded points


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


def run_trial(
    place: FeedbackPath,
    ports: Ports,
    law: ControlLaw,
    *,
    name: str,
    inputs: Mapping[str, Signal],
    outputs: Sequence[str] = (),
    closes_at: float,
    stop: float,
) -> Trial:
    """Simulate a system with a control that is connected late.

    Args:
        place: of the control.
        ports: of the block.
        law: what is connected; without actuator there are no limits.
        name: name of the trial.
        inputs: forced inputs, which start the motion.
        outputs: variables to record besides those of the loop.
        closes_at: when the control is connected [s].
        stop: end of the simulation [s].

    Raises:
        SimulationError: it fails before anything was recorded.
    """
    system, _ = place.closed(replace(law, closes_at=closes_at if closes_at > 0.0 else None))
    names = list(dict.fromkeys([ports.v, ports.w, place.target, *outputs]))
    result, failure = None, ""
    with place.opened(system, place.model.at) as model:
        try:
            record = simulate(model, stop=stop, inputs=place.inputs(inputs), outputs=names, interval=stop / _PER_RUN)
        except SimulationError as error:
            if not isinstance(error.before, SimulationResult):
                raise
            record, failure = error.before, str(error)
            result = error.divergence if isinstance(error, DivergenceError) else None
    units = {v.name: v.unit for v in place.model.description.variables}
    time, v, u = record.time, record.signals[ports.v], record.signals[place.target]
    after, begin = time >= closes_at, closes_at * (1.0 - _WINDOW)
    start = (time >= begin) & ~after if closes_at > 0.0 else after
    before = float(np.max(np.abs(v[start]), initial=0.0))
    end = time >= stop - _END * (stop - closes_at)
    steps = np.diff(time[after])
    moving = steps > 0.0
    rates = np.abs(np.diff(u[after])[moving] / steps[moving])
    whole = not failure and before > 0.0
    return Trial(
        name=name,
        limited=law.actuator is not None,
        closes_at=closes_at,
        time=time,
        signals={n: record.signals[n] for n in names},
        units={n: units.get(n) for n in names},
        before=before,
        settling_seconds={part: settling(time, v, closes_at, part * before) if whole else None for part in THRESHOLDS},
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

"""How fast a motion settles after a feedback closes, over its gain."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.errors import SimulationError
from workbench.jobs.job import Job
from workbench.jobs.options import Workers
from workbench.jobs.runner import Lost
from workbench.jobs.runner_choice import at_work
from workbench.limit_cycles.feedback.actuator import Actuator
from workbench.limit_cycles.feedback.closed_system import FeedbackPath, FeedbackSpec, find_place
from workbench.limit_cycles.feedback.initial_motion import PER_CYCLE, InitialMotion, mean_magnitude
from workbench.limit_cycles.feedback.optimum import optimum_of
from workbench.limit_cycles.feedback.result import GainRun, SettlingSettings, SettlingStudy
from workbench.model.described_model import DescribedModel
from workbench.session.base import Recorded, Session
from workbench.signals.kinds import Signal

__all__ = ["settling_study"]

_CHUNK = 10  # cycles
_FINE = 10  # times more points in the first cycle, in which the feedback engages
_GROWN = 100.0  # times the motion at the beginning: it does not settle
_AT_LIMIT = 0.98
_DRAWN = 400  # points kept of each run


def settling_study(
    place: FeedbackPath,
    start: InitialMotion,
    gains: Sequence[float],
    *,
    watch: str,
    y0: float,
    actuator: Actuator | None,
    settings: SettlingSettings,
    workers: Workers,
    job: Job,
) -> SettlingStudy:
    """Close the feedback with each gain on the same motion and measure how fast it settles.

    Args:
        place: place of the feedback.
        start: the motion.
        gains: rising.
        watch: variable whose magnitude decides, by the model's name.
        y0: value of the source at rest.
        actuator: between gain and target; None: none.
        settings: threshold, polynomial, patience.
        workers: where the motions run.
        job: is told each gain.

    Raises:
        InputError, FmuError: the system with feedback cannot be opened.
    """
    closes = start.closes if start.opens < start.closes else None
    wishes = [FeedbackSpec(gain, y0, actuator, closes) for gain in gains]
    jobs = [_Closing(path=place.shown, start=start, wish=wish, watch=watch, settings=settings) for wish in wishes]
    found: dict[float, GainRun] = {}
    with at_work(place.model, workers, job) as runner:
        for event in runner.run(_closed, deque(jobs)):
            gain = event.job.wish.gain
            if isinstance(event, Lost):
                raise event.error
            found[gain] = event.value
            job.done(f"gain {gain:.4g}", len(found), len(gains))
    runs = [found[gain] for gain in gains]
    units = {v.name: v.unit for v in place.model.description.variables}
    return SettlingStudy(
        variable=watch,
        unit=units.get(watch) or None,
        target=place.shown[1],
        target_unit=place.target_unit,
        settings=settings,
        start=start,
        actuator=actuator,
        runs=tuple(runs),
        optima=tuple(optimum_of(runs, threshold, settings.order) for threshold in settings.every),
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class _Closing:
    """A run of the study, for a worker."""

    path: tuple[str, str]
    start: InitialMotion
    wish: FeedbackSpec
    watch: str
    settings: SettlingSettings


def _closed(model: DescribedModel, job: _Closing) -> Iterator[GainRun]:
    """Do one run of the study; what a worker runs."""
    place = find_place(model, *job.path)
    with place.opened(place.closed(job.wish)) as system:
        yield _run(system, place, job.start, job.wish, job.watch, job.settings)


def _run(  # noqa: PLR0917 - one run of the study
    model: DescribedModel,
    place: FeedbackPath,
    start: InitialMotion,
    wish: FeedbackSpec,
    watch: str,
    settings: SettlingSettings,
) -> GainRun:
    command, handed, scale = place.command(wish)
    names = list(dict.fromkeys([place.full(watch), command, handed]))
    values = {place.full(n): v for n, v in start.values.items()}
    inputs = place.inputs({n: v for n, v in start.values.items() if n in {i.name for i in place.model.inputs}})
    signals = place.inputs(start.signals)
    with model.open_at(time=start.opens, values={**values, **inputs}, tolerance=settings.tolerance) as session:
        if start.opens < start.closes:
            session.advance(start.closes, signals=signals)
        time, columns, why = _watched(session, start, names, signals, settings)
    # In the first cycle the motion before the feedback closed counts along.
    earlier = start.time < start.closes - 1e-9
    every = np.concatenate([start.time[earlier] - start.closes, time])
    x = np.concatenate([start.motion[earlier], columns[names[0]]]) - start.centre
    size = (mean_magnitude(every, x, 1.0 / start.frequency) / start.magnitude)[-len(time) :]
    deflection, limited_d, limited_r, rate = _effort(time, scale * columns[handed], wish.actuator)
    thin = np.unique(np.linspace(0, len(time) - 1, _DRAWN).astype(int))
    return GainRun(
        gain=wish.gain,
        settled={t: _settled(time, size, t) for t in settings.every},
        seconds=float(time[-1]),
        left=float(size[-1]),
        peak_deflection=deflection,
        peak_rate=rate,
        deflection_limited=limited_d,
        rate_limited=limited_r,
        why=why,
        time=time[thin],
        magnitude=size[thin],
    )


def _watched(
    session: Session,
    start: InitialMotion,
    names: Sequence[str],
    signals: Mapping[str, Signal],
    settings: SettlingSettings,
) -> tuple[Floats, dict[str, Floats], str]:
    """Advance until the smallest threshold is passed, the motion grows, or patience ends; times from closing on."""
    period = 1.0 / start.frequency
    longest = settings.longest or 250.0 * period
    pieces: list[Recorded] = []
    why = "given up"
    begin = session.time
    while session.time < begin + longest * (1.0 - 1e-9):
        until = min(session.time + _CHUNK * period, begin + longest)
        points = _points(session.time, until, period, first=not pieces)
        try:
            pieces.append(session.advance(until, signals=signals, record=names, points=points))
        except SimulationError as error:
            why = f"the simulation failed: {error}"
            break
        last = pieces[-1].values[names[0]][-PER_CYCLE:] - start.centre
        left = float(np.mean(np.abs(last))) / start.magnitude
        if left < 0.5 * settings.every[-1] or left > _GROWN:
            why = "" if left < 1.0 else "the motion grows"
            break
    if not pieces:
        raise SimulationError(f"the feedback cannot be closed: {why}")
    time = np.concatenate([p.time for p in pieces]) - begin
    keep = np.append(time[1:] > time[:-1], True)
    return time[keep], {n: np.concatenate([p.values[n] for p in pieces])[keep] for n in names}, why


def _points(begin: float, until: float, period: float, *, first: bool) -> Floats:
    step = period / PER_CYCLE
    count = max(1, round((until - begin) / step))
    coarse = np.append(begin + (until - begin) * np.arange(1, count) / count, until)
    if not first:
        return coarse
    fine = begin + step / _FINE * np.arange(1, min(PER_CYCLE, count) * _FINE)
    return np.unique(np.concatenate([fine[fine < coarse[min(PER_CYCLE, count) - 1]], coarse]))


def _effort(time: Floats, handed: Floats, actuator: Actuator | None) -> tuple[float, float | None, float | None, float]:
    """Return peak deflection, seconds at the limit of deflection and of rate, and peak rate."""
    steps = np.diff(time)
    rate = np.abs(np.diff(handed)) / steps
    peak = float(np.abs(handed).max())
    if actuator is None or actuator.limit is None:
        limited_d = None
    else:
        limited_d = float(steps[np.abs(handed[1:]) >= _AT_LIMIT * actuator.limit].sum())
    if actuator is None or actuator.rate_limit is None:
        limited_r = None
    else:
        limited_r = float(steps[rate >= _AT_LIMIT * actuator.rate_limit].sum())
    return peak, limited_d, limited_r, float(rate.max(initial=0.0))


def _settled(time: Floats, size: Floats, threshold: float) -> float | None:
    """Return the time from which a magnitude stays below a threshold [s], interpolated in its logarithm."""
    above = np.flatnonzero(size >= threshold)
    if not len(above):
        return 0.0
    last = int(above[-1])
    if last == len(size) - 1:
        return None
    a, b = math.log(size[last]), math.log(max(size[last + 1], 1e-300))
    part = (a - math.log(threshold)) / (a - b) if a > b else 1.0
    return float(time[last] + part * (time[last + 1] - time[last]))

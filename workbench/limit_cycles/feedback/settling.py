"""How fast a motion settles after a feedback closes, over its gain."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial import Polynomial

from workbench.core.values.arrays import Floats
from workbench.errors import SimulationError
from workbench.jobs.job import Job
from workbench.jobs.runner import Lost, WorkItem, perform
from workbench.jobs.runner_choice import at_work
from workbench.limit_cycles.feedback.actuator import Actuator
from workbench.limit_cycles.feedback.closed_system import FeedbackPath, FeedbackSpec, find_place
from workbench.limit_cycles.feedback.initial_motion import PER_CYCLE, InitialMotion, mean_magnitude
from workbench.limit_cycles.feedback.request import Feedback
from workbench.limit_cycles.feedback.result import GainRun, SettlingStudy
from workbench.limit_cycles.limit_cycle.confirm import TOLERANCE
from workbench.model.base import Model
from workbench.session.base import Recorded, Session
from workbench.signals.kinds import Signal

__all__ = ["settling_study", "with_optimum"]

_CHUNK = 10  # cycles
_FINE = 10  # times more points in the first cycle, in which the feedback engages
_GROWN = 100.0  # times the motion at the beginning: it does not settle
_AT_LIMIT = 0.98
_DRAWN = 400  # points kept of each run
_ROUNDING = 1e-11  # of the largest coefficient of a slope


def settling_study(
    place: FeedbackPath, motion: InitialMotion, gains: Sequence[float], watch: str, *, y0: float,
    actuator: Actuator | None, asked: Feedback, job: Job,
) -> SettlingStudy:  # fmt: skip
    """Close the feedback with each gain on the same motion and measure how fast it settles.

    Args:
        place: place of the feedback.
        motion: before the feedback closes.
        gains: rising.
        watch: variable whose magnitude decides, by the model's name.
        y0: value of the source at rest.
        actuator: between gain and target; None: none.
        asked: threshold, order of the polynomial, longest run, where the motions run.
        job: is told each gain.

    Raises:
        InputError, FmuError: the system with feedback cannot be opened.
    """
    closes = motion.closes if motion.opens < motion.closes else None
    jobs = [
        _GainJob(place.shown, motion, FeedbackSpec(gain, y0, actuator, closes), watch, asked.threshold, asked.longest)
        for gain in gains
    ]
    result: dict[float, GainRun] = {}
    with at_work(place.model, asked.place.apart, job) as runner:
        for event in runner.run(perform, deque(jobs)):
            gain = event.job.law.gain
            if isinstance(event, Lost):
                raise event.error
            result[gain] = event.value
            job.done(f"gain {gain:.4g}", len(result), len(gains))
    return with_optimum(
        SettlingStudy(
            variable=watch,
            unit=next((v.unit for v in place.model.description.variables if v.name == watch), None) or None,
            target=place.shown[1],
            target_unit=place.target_unit,
            threshold=asked.threshold,
            polynomial_order=asked.order,
            motion=motion,
            actuator=actuator,
            runs=tuple(result[gain] for gain in gains),
        )
    )


def with_optimum(study: SettlingStudy) -> SettlingStudy:
    """Return a study with the gain at which a polynomial through its settling times is smallest.

    Args:
        study: with its runs; without an optimum where fewer gains settled than the polynomial has coefficients.
    """
    if len(study.settled) <= study.polynomial_order:
        return study
    g, t = np.array([(r.gain, r.settling_seconds) for r in study.settled]).T
    fit = Polynomial.fit(g, t, study.polynomial_order)
    slope = fit.deriv()
    # Over its domain scaled to −1 … 1 a coefficient so small is rounding; its far roots would spoil the near ones.
    slope = slope.trim(_ROUNDING * float(np.abs(slope.coef).max()))
    inner = [float(r.real) for r in slope.roots() if abs(r.imag) < 1e-9 and g[0] < r.real < g[-1]]
    best = min([float(g[0]), float(g[-1]), *inner], key=lambda x: float(fit(x)))
    return replace(
        study, optimum=best, optimum_seconds=float(fit(best)), optimum_at_end=best not in inner,
        coefficients=tuple(fit.convert().coef.tolist()),
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _GainJob(WorkItem):
    """The run with one gain, for a worker."""

    path: tuple[str, str]
    motion: InitialMotion
    law: FeedbackSpec
    watch: str
    threshold: float
    longest: float | None

    def run(self, model: Model) -> Iterator[GainRun]:
        """Close the feedback and yield what becomes of the motion."""
        place, motion = find_place(model, *self.path), self.motion
        command, handed, scale = place.command(self.law)
        names = list(dict.fromkeys([place.full(self.watch), command, handed]))
        with place.opened(place.closed(self.law)) as system:
            values = place.start_values(motion.values)
            with system.open_at(time=motion.opens, values=values, tolerance=TOLERANCE) as session:
                time, columns, why = self._decay(session, names, place.inputs(motion.signals))
        # In the first cycle the motion before the feedback closed counts along.
        earlier = motion.time < motion.closes - 1e-9
        every = np.concatenate([motion.time[earlier] - motion.closes, time])
        x = np.concatenate([motion.motion[earlier], columns[names[0]]]) - motion.centre
        size = (mean_magnitude(every, x, 1.0 / motion.frequency) / motion.magnitude)[-len(time) :]
        deflection, limited_d, limited_r, rate = _effort(time, scale * columns[handed], self.law.actuator)
        thin = np.unique(np.linspace(0, len(time) - 1, _DRAWN).astype(int))
        yield GainRun(
            gain=self.law.gain,
            settling_seconds=_settled(time, size, self.threshold),
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

    def _decay(
        self, session: Session, names: Sequence[str], signals: Mapping[str, Signal]
    ) -> tuple[Floats, dict[str, Floats], str]:
        """Advance until the threshold is passed, the motion grows, or patience ends; times from closing on."""
        motion, why = self.motion, "given up"
        if motion.opens < motion.closes:
            session.advance(motion.closes, signals=signals)
        period, begin = 1.0 / motion.frequency, session.time
        end = begin + (self.longest or 250.0 * period)
        pieces: list[Recorded] = []
        while session.time < end - 1e-9 * period:
            until = min(session.time + _CHUNK * period, end)
            points = _points(session.time, until, period, first=not pieces)
            try:
                pieces.append(session.advance(until, signals=signals, record=names, points=points))
            except SimulationError as error:
                why = f"the simulation failed: {error}"
                break
            last = pieces[-1].values[names[0]][-PER_CYCLE:] - motion.centre
            left = float(np.mean(np.abs(last))) / motion.magnitude
            if left < 0.5 * self.threshold or left > _GROWN:
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

"""How fast a motion settles after a feedback closes, over its gain."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial

from workbench.core.records.record import RecordPart, entry
from workbench.core.values.arrays import Floats
from workbench.errors import SimulationError
from workbench.jobs.job import Job
from workbench.jobs.options import Workers
from workbench.jobs.runner import Lost, WorkItem, perform
from workbench.jobs.runner_choice import at_work
from workbench.limit_cycles.feedback.actuator import Actuator
from workbench.limit_cycles.feedback.closed_system import ControlLaw, FeedbackPath, find_place
from workbench.limit_cycles.feedback.initial_motion import InitialMotion, closing, mean_magnitude
from workbench.limit_cycles.limit_cycle.confirm import CHUNK, PER_PERIOD
from workbench.model.base import Model
from workbench.session.base import Recorded, Session
from workbench.show.result import Result
from workbench.signals.kinds import Signal

__all__ = ["LONGEST", "GainRun", "SettlingStudy", "settling_study", "with_optimum"]

LONGEST = 250.0  # cycles that are simulated after closing, unless an end is asked for
_GROWN = 100.0  # times the motion at the beginning: it does not settle
_AT_LIMIT = 0.98
_DRAWN = 400  # points kept of each run
_ROUNDING = 1e-11  # of the largest coefficient of a slope


@dataclass(frozen=True, eq=False, kw_only=True)
class GainRun(RecordPart):
    """The motion after the feedback closed with one gain.

    Attributes:
        gain: g.
        settling_seconds: time after closing from which the mean magnitude over a cycle stays below the threshold [s];
            None: it did not come to that.
        seconds: how long was simulated.
        left: mean magnitude at the end over that at the beginning.
        peak_deflection: largest size of what is handed to the target [its unit], behind the actuator if there is one.
        peak_rate: largest rate of that [its unit / s]; without an actuator the jump at closing is left out.
        deflection_limited: how long the deflection was at its limit [s]; None: there is no known limit.
        rate_limited: how long the rate was at its limit [s]; None: likewise.
        why: why it ended early; "": it did not.
        time: after closing, thinned out, shape (k,) [s].
        magnitude: mean over a cycle there, over that at the beginning, shape (k,).
    """

    gain: float
    settling_seconds: float | None
    seconds: float
    left: float
    peak_deflection: float
    peak_rate: float
    deflection_limited: float | None
    rate_limited: float | None
    why: str
    time: Floats
    magnitude: Floats

    @property
    def limit_reached(self) -> bool:
        """Whether the actuator came to a limit."""
        return bool(self.deflection_limited) or bool(self.rate_limited)

    def derived(self) -> dict[str, Any]:
        """Return whether it came to a limit."""
        return {"limit_reached": self.limit_reached}


@dataclass(frozen=True, eq=False, kw_only=True)
class SettlingStudy(Result):
    """Settling times over the gain, and the gain at which a polynomial through them is smallest.

    Attributes:
        variable: the one whose magnitude decides that the motion has settled.
        unit: unit of the variable.
        target: what the feedback drives.
        target_unit: unit of the target.
        threshold: part of the magnitude at the beginning below which the motion has settled.
        polynomial_order: order of the polynomial.
        motion: the motion before the feedback closes.
        actuator: between gain and target; None: none.
        runs: one for each gain, rising.
        optimum: gain at which the polynomial is smallest, between the lowest and the highest gain; None: too few gains
            settled.
        optimum_seconds: the polynomial there [s].
        optimum_at_end: whether that is the lowest or highest gain: there is no smaller minimum inside.
        coefficients: of the polynomial in g, from g⁰ on.
    """

    _page = "workbench.limit_cycles.feedback.page:settling_page"
    _picture = "workbench.limit_cycles.feedback.picture_runs:plot_settling"

    variable: str
    unit: str | None
    target: str
    target_unit: str | None
    threshold: float
    polynomial_order: int
    motion: InitialMotion = field(metadata=entry(key="beginning"))
    actuator: Actuator | None
    runs: tuple[GainRun, ...]
    optimum: float | None = None
    optimum_seconds: float | None = None
    optimum_at_end: bool = False
    coefficients: tuple[float, ...] = ()

    @property
    def gains(self) -> tuple[float, ...]:
        """Rising."""
        return tuple(r.gain for r in self.runs)

    @property
    def settling_seconds(self) -> tuple[float | None, ...]:
        """For each gain [s]; None: it did not settle."""
        return tuple(r.settling_seconds for r in self.runs)

    @property
    def settled(self) -> tuple[GainRun, ...]:
        """The runs that came below the threshold."""
        return tuple(r for r in self.runs if r.settling_seconds is not None)

    def derived(self) -> dict[str, Any]:
        """Return the settling times, the fastest measured, and where the motion begins."""
        motion = self.motion
        fastest = min(self.settled, key=lambda r: r.settling_seconds or 0.0, default=None)
        return {
            "gains": self.gains,
            "settling_seconds": self.settling_seconds,
            "fastest_gain": None if fastest is None else fastest.gain,
            "start": motion.how,
            "closes_at": motion.closes,
            "frequency_hz": motion.frequency,
            "magnitude": motion.magnitude,
        }

    def rows(self) -> Iterator[Sequence[Any]]:
        """Yield one row for each gain."""
        names = ("gain", "settling_seconds", "left", "peak_deflection", "peak_rate", "limit_reached")
        yield names
        yield from ([getattr(run, name) for name in names] for run in self.runs)

    def remarks(self) -> list[str]:
        """Return what the user should know, one line each."""
        notes, below = [], f"{100.0 * self.threshold:g} %"
        if self.optimum_at_end:
            notes.append(
                f"settling to {below}: the polynomial still falls at the end of the measured gains, so the optimum is "
                f"that end, {self.optimum:.4g}"
            )
        if unsettled := len(self.runs) - len(self.settled):
            notes.append(f"{unsettled} of {len(self.runs)} gains did not settle to {below}")
        for what in ("deflection", "rate"):
            hit = [(r.gain, seconds) for r in self.runs if (seconds := getattr(r, f"{what}_limited"))]
            if hit:
                listed, longest = ", ".join(f"{g:.4g}" for g, _ in hit), max(seconds for _, seconds in hit)
                notes.append(f"the {what} reached its limit, for at most {longest:.3g} s, with gains {listed}")
        return notes


def settling_study(
    place: FeedbackPath,
    motion: InitialMotion,
    laws: Sequence[ControlLaw],
    watch: str,
    *,
    threshold: float,
    order: int,
    longest: float | None,
    where: Workers,
    job: Job,
) -> SettlingStudy:
    """Close the feedback with each gain on the same motion and measure how fast it settles.

    Args:
        place: place of the feedback.
        motion: before the feedback closes.
        laws: of one actuator, their gains rising.
        watch: variable whose magnitude decides, by the model's name.
        threshold: part of the magnitude at the beginning below which the motion has settled.
        order: of the polynomial.
        longest: duration of a run at most [s]; None: 250 cycles.
        where: the motions run.
        job: is told each gain.

    Raises:
        InputError, FmuError: the system with feedback cannot be opened.
    """
    closes = motion.closes if motion.opens < motion.closes else None
    jobs = [_GainJob(place.shown, motion, replace(law, closes_at=closes), watch, threshold, longest) for law in laws]
    result: dict[float, GainRun] = {}
    with at_work(place.model, where, job) as runner:
        for event in runner.run(perform, deque(jobs)):
            if isinstance(event, Lost):
                raise event.error
            result[event.value.gain] = event.value
            job.done(f"gain {event.value.gain:.4g}", len(result), len(laws))
    return with_optimum(
        SettlingStudy(
            variable=watch,
            unit=next((v.unit for v in place.model.description.variables if v.name == watch), None) or None,
            target=place.shown[1],
            target_unit=place.target_unit,
            threshold=threshold,
            polynomial_order=order,
            motion=motion,
            actuator=laws[0].actuator,
            runs=tuple(result[law.gain] for law in laws),
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
    law: ControlLaw
    watch: str
    threshold: float
    longest: float | None

    def run(self, model: Model) -> Iterator[GainRun]:
        """Close the feedback and yield what becomes of the motion."""
        place, motion, actuator = find_place(model, *self.path), self.motion, self.law.actuator
        watch = place.full(self.watch)
        with closing(place, self.law, motion) as (session, handed):
            time, columns, why = self._decay(session, watch, handed, place.inputs(motion.signals))
        # In the first cycle the motion before the feedback closed counts along.
        earlier = motion.time < motion.closes - 1e-9
        every = np.concatenate([motion.time[earlier] - motion.closes, time])
        x = np.concatenate([motion.motion[earlier], columns[watch]]) - motion.centre
        size = (mean_magnitude(every, x, 1.0 / motion.frequency) / motion.magnitude)[-len(time) :]
        thin = np.unique(np.linspace(0, len(time) - 1, _DRAWN).astype(int))
        deflection = np.abs(columns[handed]) * (1.0 if actuator is None else actuator.scale)
        steps = np.diff(time)
        rate = np.abs(np.diff(columns[handed])) * (1.0 if actuator is None else actuator.scale) / steps
        yield GainRun(
            gain=self.law.gain,
            settling_seconds=_settled(time, size, self.threshold),
            seconds=float(time[-1]),
            left=float(size[-1]),
            peak_deflection=float(deflection.max()),
            peak_rate=float(rate.max(initial=0.0)),
            deflection_limited=_limited(steps, deflection[1:], None if actuator is None else actuator.limit),
            rate_limited=_limited(steps, rate, None if actuator is None else actuator.rate_limit),
            why=why,
            time=time[thin],
            magnitude=size[thin],
        )

    def _decay(
        self, session: Session, watch: str, handed: str, signals: Mapping[str, Signal]
    ) -> tuple[Floats, dict[str, Floats], str]:
        """Advance until the threshold is passed, the motion grows, or patience ends; times from closing on."""
        motion, why = self.motion, "given up"
        if motion.opens < motion.closes:
            session.advance(motion.closes, signals=signals)
        period, begin = 1.0 / motion.frequency, session.time
        end = begin + (self.longest or LONGEST * period)
        pieces: list[Recorded] = []
        while session.time < end - 1e-9 * period:
            until = min(session.time + CHUNK * period, end)
            count = max(1, round(PER_PERIOD * (until - session.time) / period))
            points = np.linspace(session.time, until, count + 1)[1:]
            try:
                pieces.append(session.advance(until, signals=signals, record=[watch, handed], points=points))
            except SimulationError as error:
                why = f"the simulation failed: {error}"
                break
            left = float(np.mean(np.abs(pieces[-1].values[watch][-PER_PERIOD:] - motion.centre))) / motion.magnitude
            if left < 0.5 * self.threshold or left > _GROWN:
                why = "" if left < 1.0 else "the motion grows"
                break
        if not pieces:
            raise SimulationError(f"the feedback cannot be closed: {why}")
        time = np.concatenate([p.time for p in pieces]) - begin
        keep = np.append(time[1:] > time[:-1], True)
        return time[keep], {n: np.concatenate([p.values[n] for p in pieces])[keep] for n in (watch, handed)}, why


def _limited(steps: Floats, size: Floats, limit: float | None) -> float | None:
    """Return how long a size was at its limit [s]; None: there is no limit."""
    return None if limit is None else float(steps[size >= _AT_LIMIT * limit].sum())


def _settled(time: Floats, size: Floats, threshold: float) -> float | None:
    """Return the time from which a magnitude stays below a threshold [s], interpolated in its logarithm."""
    above = np.flatnonzero(size >= threshold)
    if not len(above):
        return 0.0
    if above[-1] == len(size) - 1:
        return None
    ends = [above[-1] + 1, above[-1]]
    return float(np.interp(math.log(threshold), np.log(np.maximum(size[ends], np.finfo(float).tiny)), time[ends]))

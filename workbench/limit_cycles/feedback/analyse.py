"""A scalar output feedback on a system, over its gain."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace

import numpy as np

from workbench.core.machine.blas import one_thread
from workbench.core.records.quantity import quantity
from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.conversion import named_conversion
from workbench.core.values.linear import LinearPart
from workbench.core.values.operating_point import OperatingPoint
from workbench.core.values.poles import natural_frequency_hz
from workbench.errors import InputError, WorkbenchError
from workbench.jobs.job import Job
from workbench.limit_cycles.feedback.actuator import Actuator, limited, wrapped
from workbench.limit_cycles.feedback.block import TwoPorts, cut_at, find_block
from workbench.limit_cycles.feedback.closed_system import SEEN, FeedbackPath, find_place
from workbench.limit_cycles.feedback.gains import Interval, count_poles, crossings, fixed_modes, intervals, stable_gains
from workbench.limit_cycles.feedback.initial_motion import InitialMotion, from_cycle, from_signals
from workbench.limit_cycles.feedback.locus import fastest
from workbench.limit_cycles.feedback.plant import Standing, linear, standing
from workbench.limit_cycles.feedback.request import Feedback, Range
from workbench.limit_cycles.feedback.result import FeedbackResult, SettlingStudy, interval_words
from workbench.limit_cycles.feedback.run import FeedbackRun, feedback_run
from workbench.limit_cycles.feedback.settling import settling_study
from workbench.loops.nyquist.grid import adaptive_grid
from workbench.loops.nyquist.nyquist import AMPLITUDES, BAND
from workbench.model import operating_point as placing
from workbench.model.described_model import DescribedModel
from workbench.model.names import forced_inputs
from workbench.point.lin.result import LinResult

__all__ = ["curve", "run"]

_INSIDE = 0.03  # of a stable interval, left out at its ends in a study
_REACH = 10.0  # times the finite end, where a stable interval has one only


def run(system: DescribedModel, request: Feedback, job: Job) -> FeedbackResult:
    """Investigate a feedback; see `Feedback`."""
    system, remarks = placing.start_at(system, request.at)
    time = system.start_time if request.time is None else request.time
    with one_thread(), ExitStack() as keep:
        place = find_place(system, request.source, request.target)
        watched = place.outer(place.inner(request.watch)) if request.watch is not None else None
        where = standing(place, at=system.at, time=time)
        between = _actuator(system, request)
        solution = linear(place, where, time=time, actuator=between, method=request.method)
        seen = solution.operating_point.y.get(SEEN, 0.0)
        work = _FeedbackAnalysis(place, where, seen, between, time, request, keep)
        result = work.linear_result(solution)
        job.partial = lambda: result  # what is known, should a run of the study fail or somebody end it
        chosen = work.study_gains(result) if request.settle else ()
        two, why = work.two_ports()
        result = work.with_cycles(result, two, why)
        notes = _told(system, where.point, time)
        result = replace(result, notes=(*remarks, *result.notes), operating_point=notes)
        if request.settle or request.gain is not None:
            first = watched or (two.loop.ports.v if two is not None else place.outer(place.source))
            start = work.start(two, first)
            result = work.with_run(result, start, first)
            result = work.with_study(result, start, chosen, first, job)
    return result


def _told(system: DescribedModel, point: OperatingPoint, time: float) -> OperatingPoint:
    """Return the point in full; a co-simulation that was given none stands where it starts."""
    if point.values:
        return placing.named(system, point)
    with system.open_session(start_time=time) as session:
        return placing.standing(system, session)


def _actuator(system: DescribedModel, request: Feedback) -> Actuator | None:
    if request.actuator is not None:
        return wrapped(request.actuator)
    unit = next((v.unit for v in system.description.variables if v.name == request.target), None)
    return limited(
        _size("limit", request.limit, request.target, unit, per=""),
        _size("rate_limit", request.rate_limit, request.target, unit, per="/s"),
    )


def _size(option: str, size: float | str | None, target: str, own: str | None, *, per: str) -> float | None:
    """Return a limit in the target's unit; a number alone is in that unit."""
    if size is None:
        return None
    value, unit = quantity(size)
    if not unit:
        return value
    factor = named_conversion(unit, f"{own}{per}") if own else None
    if factor is None:
        raise InputError(f"{option}: '{unit}' cannot be converted to {own or 'no unit'}{per}, that of {target}")
    return factor[0] * value


@dataclass(frozen=True, eq=False)
class _FeedbackAnalysis:
    """One analysis under way."""

    place: FeedbackPath
    where: Standing
    y0: float
    actuator: Actuator | None
    time: float
    asked: Feedback
    keep: ExitStack

    def linear_result(self, result: LinResult) -> FeedbackResult:
        plant = result.part().balanced()
        every = crossings(plant)
        parts = intervals(plant, [c.gain for c in every])
        middles = [0.5 * (i.low + i.high) for i in parts if math.isfinite(i.low) and math.isfinite(i.high)]
        ends = [2.0 * c.gain for c in every] or [1.0, -1.0]
        stable = stable_gains(parts, self.asked.gains)
        frequency, response = curve(plant, [c.frequency_hz for c in every])
        model = self.place.model
        return FeedbackResult(
            model=model.name,
            interface=model.interface,
            solver=model.solver,
            source=self.place.shown[0],
            target=self.place.shown[1],
            source_unit=self.place.source_unit,
            target_unit=self.place.target_unit,
            gains=self.asked.gains,
            plant=plant,
            lin_method=result.method,
            stable_gains=stable,
            crossings=every,
            unstable_open=count_poles(plant, 0.0)[0],
            fixed=fixed_modes(plant, [*middles, *ends]),
            fastest=tuple(fastest(plant, *_finite(pair)) for pair in stable),
            frequency_hz=frequency,
            response=response,
            notes=tuple(dict.fromkeys([*self.where.notes, *_notes(plant, result, self.actuator), *_doubts(parts)])),
        )

    def two_ports(self) -> tuple[TwoPorts | None, str]:
        """Return the system cut at its block as well, and in words why it is not."""
        block = self.asked.block
        name, why = (block, "") if block is not None else find_block(self.place.model)
        if name is None:
            return None, why
        try:
            return cut_at(self.place, self.where, name, time=self.time, actuator=self.actuator, keep=self.keep), ""
        except WorkbenchError as error:
            if block is not None:
                raise
            return None, f"the remaining cycles are not predicted: {name}: {error}"

    def with_cycles(self, result: FeedbackResult, two: TwoPorts | None, why: str) -> FeedbackResult:
        if two is None:
            return _noted(result, why)
        name = two.loop.ports.component
        result = replace(result, block=name)
        if two.block is None:
            return _noted(result, f"{name} has a memory of its own: the remaining cycles are not predicted")
        gains = [g for pair in result.stable_gains for g in _spread(_finite(pair), self.asked.count)]
        band, amplitudes = self.asked.band or BAND, self.asked.amplitudes or AMPLITUDES
        cycles = tuple(two.left(g, band=band, amplitudes=amplitudes) for g in gains)
        return replace(result, cycles=cycles)

    def study_gains(self, result: FeedbackResult) -> tuple[float, ...]:
        wanted = self.asked.settle_gains
        if wanted is not None:
            if not (wanted[0] < wanted[1] and all(map(math.isfinite, wanted))):
                raise InputError(f"settle_gains: {wanted[0]:g} … {wanted[1]:g} must rise and be finite")
            return tuple(np.linspace(*wanted, self.asked.count).tolist())
        if not result.stable_gains:
            raise InputError(
                f"{result.model}: {result.words}; there is no gain to settle with (without settle the crossings are "
                "shown)"
            )
        nearest = min(result.stable_gains, key=lambda p: 0.0 if p[0] <= 0.0 <= p[1] else min(abs(p[0]), abs(p[1])))
        return _spread(_finite(nearest), self.asked.count)

    def start(self, two: TwoPorts | None, watch: str) -> InitialMotion:
        centre = self._centre(watch)
        if self.asked.start_after is not None:
            return from_signals(
                self.place, self.where, watch, centre=centre,
                signals=forced_inputs(self.place.model, self.asked.signals or {}, what="signals"), time=self.time,
                start_after=self.asked.start_after,
            )  # fmt: skip
        if two is None:
            raise InputError(
                f"{self.place.model.name}: no nonlinear block is known, so no limit cycle is predicted; name it "
                "(block), or excite a motion (pulse, start_after)"
            )
        return from_cycle(self.place, self.where, two, watch, centre=centre, time=self.time)

    def _centre(self, watch: str) -> float:
        """Return the value of a variable at rest."""
        if watch == self.place.outer(self.place.source):
            return self.y0
        point = self.where.point
        known = {**point.y, **point.x}
        if watch in known:
            return known[watch]
        with self.place.model.open_at(time=self.time, values={**point.x, **point.discrete, **point.u}) as session:
            return session.values([watch])[watch]

    def with_study(
        self, result: FeedbackResult, start: InitialMotion, gains: Sequence[float], watch: str, job: Job
    ) -> FeedbackResult:
        if not gains:
            return result
        study = settling_study(
            self.place, start, gains, watch, y0=self.y0, actuator=self.actuator, asked=self.asked, job=job
        )
        return _noted(replace(result, settling=study), *_study_notes(study))

    def with_run(self, result: FeedbackResult, start: InitialMotion, watch: str) -> FeedbackResult:
        if self.asked.gain is None:
            return result
        run: FeedbackRun = feedback_run(
            self.place, start, self.asked.gain, begin=self.time, watch=watch, y0=self.y0, actuator=self.actuator,
            outputs=self.asked.outputs, stop=self.asked.stop,
        )  # fmt: skip
        return replace(result, run=run)


def _noted(result: FeedbackResult, *notes: str) -> FeedbackResult:
    return replace(result, notes=tuple(dict.fromkeys(filter(None, [*result.notes, *notes]))))


def _finite(pair: Range) -> Range:
    """Return an interval with finite ends: an open side reaches ten times as far as the other end."""
    low, high = pair
    if math.isinf(low) and math.isinf(high):
        return -1.0, 1.0
    if math.isinf(low):
        return high - _REACH * (abs(high) or 1.0), high
    if math.isinf(high):
        return low, low + _REACH * (abs(low) or 1.0)
    return low, high


def _spread(pair: Range, count: int) -> tuple[float, ...]:
    """Return gains spread evenly over an interval, without its ends."""
    margin = _INSIDE * (pair[1] - pair[0])
    if count == 1:
        return (0.5 * (pair[0] + pair[1]),)
    return tuple(np.linspace(pair[0] + margin, pair[1] - margin, count).tolist())


def _notes(plant: LinearPart, result: LinResult, actuator: Actuator | None) -> list[str]:
    notes = [*result.notes, *(f"doubtful: {d.row} by {d.column}: {d.reason}" for d in result.doubts)]
    if plant.dt > 0.0:
        notes.append(
            f"the linear model is sampled: the gains are those of a feedback that acts every {plant.dt:.6g} s and holds"
        )
    if actuator is not None:
        notes.append("the stable gains are those with the actuator in the loop, linear within its limits")
    if not np.any(plant.B) or not np.any(plant.C):
        notes.append("the target does not act on the source at this point (G is constant)")
    return notes


def _doubts(parts: Sequence[Interval]) -> list[str]:
    """Return a note for each interval in which not all places have as many unstable poles."""
    return [
        f"gains {interval_words((i.low, i.high))}: the number of unstable poles is not the same throughout; rounding "
        "hides a crossing"
        for i in parts
        if not i.certain
    ]


def _study_notes(study: SettlingStudy) -> list[str]:
    notes, below = [], f"{100.0 * study.threshold:g} %"
    if study.optimum_at_end:
        notes.append(
            f"settling to {below}: the polynomial still falls at the end of the measured gains, so the optimum is that "
            f"end, {study.optimum:.4g}"
        )
    if unsettled := len(study.runs) - len(study.settled):
        notes.append(f"{unsettled} of {len(study.runs)} gains did not settle to {below}")
    hit = [r.gain for r in study.runs if r.deflection_limited]
    if hit:
        notes.append(f"the deflection reached its limit with gains {', '.join(f'{g:.4g}' for g in hit)}")
    slow = [r for r in study.runs if r.rate_limited]
    if slow:
        longest = max(r.rate_limited or 0.0 for r in slow)
        notes.append(f"the rate reached its limit with {len(slow)} gains, for at most {longest:.3g} s")
    return notes


# -- G(jω) over frequencies dense enough for a picture ---------------------------------------------

_POINTS = 2000


def curve(plant: LinearPart, frequencies: Sequence[float]) -> tuple[Floats, Complex]:
    """Return frequencies [Hz] and G there; a gap where G is infinite.

    Args:
        plant: G.
        frequencies: that must lie inside [Hz].
    """
    sizes = natural_frequency_hz(plant.continuous_poles)
    every = np.array([f for f in (*sizes.tolist(), *frequencies) if 0.0 < f < np.inf])
    every = every[every > 1e-9 * every.max(initial=0.0)]
    if not len(every):
        every = np.array([1.0])
    if plant.dt > 0.0:
        f = np.linspace(0.0, plant.highest_hz, _POINTS + 1)[1:]
        return f, plant.response(f)
    band = (float(every.min()) * 0.1, float(every.max()) * 10.0)
    f, value = adaptive_grid(plant, band)
    between = 0.5 * (f[1:] + f[:-1])  # a picture shows angles of 3°
    order = np.argsort(np.concatenate([f, between]), kind="stable")
    return np.concatenate([f, between])[order], np.concatenate([value, plant.response(between)])[order]

"""A scalar output feedback on a system, over its gain."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace

import numpy as np

from workbench.core.machine.blas import one_thread
from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.linear import LinearPart
from workbench.core.values.operating_point import OperatingPoint
from workbench.core.values.poles import natural_frequency_hz
from workbench.errors import InputError, WorkbenchError
from workbench.jobs.job import Job
from workbench.limit_cycles.equilibrium import rest_of
from workbench.limit_cycles.feedback.actuator import Actuator, in_unit, limited, wrapped
from workbench.limit_cycles.feedback.block import TwoPorts, cut_at, find_block
from workbench.limit_cycles.feedback.closed_system import SEEN, ControlLaw, FeedbackPath, find_place
from workbench.limit_cycles.feedback.closing_run import feedback_run
from workbench.limit_cycles.feedback.gains import (
    Interval,
    count_poles,
    crossings,
    fixed_modes,
    intervals,
    stable_gains,
    with_delays,
)
from workbench.limit_cycles.feedback.initial_motion import InitialMotion, initial_motion
from workbench.limit_cycles.feedback.locus import fastest
from workbench.limit_cycles.feedback.request import Feedback, Range
from workbench.limit_cycles.feedback.result import FeedbackResult, interval_words
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
        watched = None if request.watch is None else place.outer(place.inner(request.watch))
        point, notes = system.at or OperatingPoint(x={}, u={}, time=time), list[str]()
        if system.at is None and system.interface == "me":
            point, notes = rest_of(system, time=time, what="the gains are looked for at")
        between = _actuator(system, request)
        linear = place.linear(point, time=time, actuator=between, method=request.method)
        work = _FeedbackAnalysis(place, point, linear.operating_point.y.get(SEEN, 0.0), between, time, request, keep)
        result = work.linear_result(linear, notes)
        job.partial = lambda: result  # what is known, should a run of the study fail or somebody end it
        chosen = work.study_gains(result) if request.settle else ()
        two, why = work.two_ports()
        result = work.with_cycles(result, two, why)
        told = _told(system, point, time)
        result = replace(result, notes=(*remarks, *result.notes), operating_point=told)
        if request.settle or request.gain is not None:
            first = watched or (two.loop.ports.v if two is not None else place.outer(place.source))
            result = work.with_runs(result, work.start(two, first), chosen, first, job)
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
        in_unit("limit", request.limit, request.target, unit),
        in_unit("rate_limit", request.rate_limit, request.target, unit, per="/s"),
    )


@dataclass(frozen=True, eq=False)
class _FeedbackAnalysis:
    """One analysis under way."""

    place: FeedbackPath
    point: OperatingPoint
    y0: float
    actuator: Actuator | None
    time: float
    asked: Feedback
    keep: ExitStack

    def linear_result(self, result: LinResult, notes: Sequence[str]) -> FeedbackResult:
        plant = result.part().balanced()
        every = crossings(plant)
        parts = intervals(plant, [c.gain for c in every])
        if result.delayed is not None:
            parts = with_delays(parts, result.delayed)
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
            notes=tuple(dict.fromkeys([*notes, *_notes(plant, result, self.actuator), *_doubts(parts)])),
        )

    def two_ports(self) -> tuple[TwoPorts | None, str]:
        """Return the system cut at its block as well, and in words why it is not."""
        block = self.asked.block
        name, why = (block, "") if block is not None else find_block(self.place.model)
        if name is None:
            return None, why
        try:
            return cut_at(self.place, self.point, name, time=self.time, actuator=self.actuator, keep=self.keep), ""
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
            return _noted(result, f"{name} is not static: the remaining cycles are not predicted")
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
        return initial_motion(
            self.place, self.point, watch, centre=self._centre(watch), time=self.time, two=two,
            signals=forced_inputs(self.place.model, self.asked.signals or {}, what="signals"),
            start_after=self.asked.start_after,
        )  # fmt: skip

    def _centre(self, watch: str) -> float:
        """Return the value of a variable at rest."""
        if watch == self.place.outer(self.place.source):
            return self.y0
        point = self.point
        known = {**point.y, **point.x}
        if watch in known:
            return known[watch]
        with self.place.model.open_at(time=self.time, values={**point.x, **point.discrete, **point.u}) as session:
            return session.values([watch])[watch]

    def with_runs(
        self, result: FeedbackResult, start: InitialMotion, gains: Sequence[float], watch: str, job: Job
    ) -> FeedbackResult:
        """Return the result with the one simulation and the settling study that are wanted."""
        request, law = self.asked, ControlLaw(gain=self.asked.gain or 0.0, y0=self.y0, actuator=self.actuator)
        if request.gain is not None:
            run = feedback_run(
                self.place, start, law, watch, begin=self.time, outputs=request.outputs, stop=request.stop
            )
            result = replace(result, run=run)
        if not gains:
            return result
        study = settling_study(
            self.place,
            start,
            [replace(law, gain=g) for g in gains],
            watch,
            threshold=request.threshold,
            order=request.order,
            longest=request.longest,
            where=request.place.apart,
            job=job,
        )
        return _noted(replace(result, settling=study), *study.remarks())


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

"""One point of a nonlinear frequency response: one sine, until the response has settled."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from workbench.core.records.record import RecordPart
from workbench.core.values.arrays import Floats
from workbench.errors import SimulationError, WorkbenchError
from workbench.response.nfr.beats import Beat
from workbench.response.nfr.certificate import Certificate, certify, finite
from workbench.response.nfr.error import Evidence
from workbench.response.nfr.own_motion import Apart
from workbench.response.nfr.prior_knowledge import LinearStart
from workbench.response.nfr.settling import PointResponse, Settling, SettlingOutcome
from workbench.response.periodic.fourier import ORDERS, Period, measure_period
from workbench.response.periodic.period_map import ROWS, PeriodRange, period_of
from workbench.session import Session
from workbench.session.compiled import CompiledMeSession, CompiledSession
from workbench.signals.kinds import Sine

__all__ = ["ROWS", "ArrivedError", "NfrPoint", "PointTask", "Watch", "change", "failed_point", "run_point"]

_REASONS = {
    SettlingOutcome.DIVERGED: (
        "grows from period to period: the model is unstable under this input, or on the way to another motion (look "
        "longer: `max_periods`)"
    ),
    SettlingOutcome.SCATTERED: (
        "does not follow the input: its periods differ by more than their mean. Probably a light or slow mode, or an "
        "integrator, still moves: wait longer (`max_periods`), or begin at rest (`at`); or it moves by itself"
    ),
}


# A delay's polynomial is good for 1e-7 of what went in (kernel/delay.c), wrong at most as an integration so exact.
_OF_DELAYS = 1e-8


def _never() -> bool:
    return False


@dataclass(frozen=True, kw_only=True)
class PointTask:
    """What is to be measured at one point.

    Attributes:
        input, output: names of the variables.
        frequency: [Hz].
        amplitude: [unit of the input].
        centre: value about which the sine moves, that of the operating point [unit of the input].
        errcrit: error criterion of `Settling`.
        max_periods: largest number of periods.
        rows: samples per period.
        fixed_step: whether the session's communication step is one row, and not the model's own.
        stopped: asked between periods; true ends the measurement by KeyboardInterrupt.
        linear: the linear model where the run starts; None: there is none.
        rates: sample periods of the model [s]; none: it is continuous, or does not show any.
        rtol: relative tolerance of the workbench's own integration; 0: nothing is integrated, or not by it.
        method: "auto": solved for where the model allows that; "settle": always waited for.
        moves: how far the output moves while the input is at rest [unit of the output]; 0: not at all, or not known.
        own_step: of a co-simulation, for how long the output stands still between its own steps [s]; 0: it does not.
    """

    input: str
    output: str
    frequency: float
    amplitude: float
    errcrit: float
    max_periods: int
    centre: float = 0.0
    rows: int = ROWS
    fixed_step: bool = False
    stopped: Callable[[], bool] = _never
    linear: LinearStart | None = None
    rates: tuple[float, ...] = ()
    rtol: float = 0.0
    method: str = "auto"
    moves: float = 0.0
    own_step: float = 0.0

    def evidence(self, start: Floats | None = None) -> Evidence:
        """Return what is known of the point before it is measured.

        Args:
            start: states of the linear model where the sine begins, from the operating point; None: 0.
        """
        twin = None if self.linear is None else self.linear.twin(self.frequency, self.amplitude, start)
        beat = Beat(self.frequency, self.rates[0]) if len(self.rates) == 1 else None
        return Evidence(twin=twin, beat=beat, sampled=bool(self.rates), rtol=self.rtol, rows=self.rows)

    @property
    def is_aliased(self) -> bool:
        """Whether the sine is at or above half the slowest rate at which the model samples."""
        return 2.0 * self.frequency * max(self.rates, default=0.0) >= 1.0

    @property
    def from_rest(self) -> PointTask:
        """The same for what the input does, apart from what the model does by itself."""
        return self if self.linear is None else replace(self, linear=self.linear.at_rest)

    @property
    def step(self) -> float | None:
        """Communication step to ask the session for [s]; None leaves it to the model."""
        return 1.0 / (self.frequency * self.rows) if self.fixed_step else None

    def span(self, sine: Sine, k: int) -> PeriodRange:
        """Return period number k of a sine."""
        return PeriodRange(sine.start, self.frequency, self.rows, k)

    def sine(self, start: float = 0.0) -> Sine:
        """Return what forces the input; at `start` [s] it is where the operating point has it."""
        return Sine(amplitude=self.amplitude, frequency=self.frequency, offset=self.centre, start=start)


@dataclass(frozen=True, kw_only=True)
class NfrPoint(RecordPart):
    """The response at one frequency and one amplitude.

    Attributes:
        frequency: [Hz].
        amplitude: [unit of the input].
        response: complex, output over input; None where the point failed.
        offset: mean of the output [unit of the output]; None where the point failed.
        periods: number of periods run (of the run that is reported).
        averaged: whether it never settled: it is the mean of the last half of the periods, or what they tend to,
            and known only as well as `error` says.
        error: of the response, relative to the true one, as a complex number's magnitude, with 95 % confidence; None
            where it is not known, or the point failed.
        stable: whether the periodic motion is stable; None where that is not known.
        resolved: whether the transient was identified and removed (see `Settling`).
        step: longest communication step of co-simulation [s]; None for model exchange, or where nothing ran.
        reason: why the point failed; None where it did not.
        kind: what went wrong, see `WorkbenchError.kind`; None where nothing did.
        certificate: what the point can be trusted for; None where nothing is known, as after a crash.
        warning: a remark on the point; None where there is none.
    """

    frequency: float
    amplitude: float
    response: complex | None = None
    offset: float | None = None
    periods: int = 0
    averaged: bool = False
    error: float | None = None
    stable: bool | None = None
    resolved: bool = False
    step: float | None = None
    reason: str | None = None
    kind: str | None = None
    certificate: Certificate | None = None
    warning: str | None = None

    def __str__(self) -> str:
        return f"amplitude {self.amplitude:.4g}, {self.frequency:.4g} Hz"

    @property
    def status(self) -> str:
        """How it ended: "settled", "averaged" or "failed"."""
        return "failed" if self.reason is not None else "averaged" if self.averaged else "settled"


class Watch(Protocol):
    """Says where the run of a point goes."""

    def add(self, session: CompiledMeSession, period: Period) -> bool:
        """Take one more period; return whether it is known where the run ends: it is then not needed any more."""

    def agrees(self, response: complex, error: float) -> bool:
        """Return whether a response is the one that is looked for, so that it can wait for `add` to know."""


class ArrivedError(Exception):
    """It is known where the run of a point ends, so that it need not be waited for."""


def run_point(
    session: Session,
    task: PointTask,
    evidence: Evidence | None = None,
    still: Session | None = None,
    watch: Watch | None = None,
) -> NfrPoint:
    """Measure a point in `session` from where it stands; the sine begins there with phase zero.

    Whole periods are run, each resumed from the last, so that the next point in the same session
    begins where this one's sine is zero again: the input of a carried sweep has no jump.
    After a failed point the session cannot be continued.

    Args:
        session: where to run.
        task: what to measure.
        evidence: what is known of the point; None: what `task` knows of a fresh start.
        still: where the same model stands at the same time, and is run with the input at rest, period by period: what
            it does by itself is subtracted, see `Apart`; None: nothing is.
        watch: says where the run goes; None: that is not asked.

    Raises:
        ArrivedError: `watch` knows where it ends.
    """
    evidence = task.evidence() if evidence is None else evidence
    if isinstance(session, CompiledSession) and session.instance.has_history:
        evidence = replace(evidence, rtol=max(evidence.rtol, _OF_DELAYS))
    settling = _settling(session, task, evidence, still)
    sine = task.sine(session.time)
    longest: float | None = None
    response: PointResponse | None = None
    try:
        # A response that runs away may overflow before it is recognised; that is an answer, not a warning.
        with np.errstate(over="ignore", invalid="ignore"):
            while response is None:
                if task.stopped():
                    raise KeyboardInterrupt
                k = len(settling.periods)
                if isinstance(session, CompiledSession):  # rows are not kept, their sums are made where they arise
                    result = session.harmonics(signals={task.input: sine}, **task.span(sine, k).asked(task.output))
                    period, longest = period_of(result), result.gap
                else:
                    period, longest = _recorded(session, task, sine, k)
                _check(period, task, time=session.time)
                response = settling.add(period)
                if watch is not None and isinstance(session, CompiledMeSession):
                    if watch.add(session, period):
                        raise ArrivedError
                    early = response is not None and len(settling.periods) < task.max_periods
                    if response is not None and early and watch.agrees(response.value, response.error):
                        response = None
    except SimulationError as error:
        point, response = _failed(task, len(settling.periods), error), None
    else:
        point = _point(task, response, len(settling.periods))
    warning = _remarks(task, point, settling)
    return replace(point, step=longest, certificate=certify(settling, response), warning=warning)


def _remarks(task: PointTask, point: NfrPoint, settling: Settling) -> str | None:
    words = [_aliasing(task.rates)] if task.is_aliased else []
    if point.reason is None and (drift := settling.drift):
        words.append(
            f"{point.frequency:.6g} Hz, amplitude {point.amplitude:g}: {task.output} drifts by {drift:.3g} in each "
            "period, which is no part of the response; `offset` is the mean of the last one"
        )
    return "; ".join(words) or None


def _settling(session: Session, task: PointTask, evidence: Evidence, still: Session | None) -> Settling:
    if still is None:
        return Settling(errcrit=task.errcrit, most=task.max_periods, evidence=evidence)
    zero = replace(task, amplitude=0.0).sine(session.time)

    def own(k: int) -> Period:
        if not isinstance(still, CompiledSession):
            return _recorded(still, task, zero, k)[0]
        return period_of(still.harmonics(signals={task.input: zero}, **task.span(zero, k).asked(task.output)))

    return Apart(errcrit=task.errcrit, most=task.max_periods, evidence=evidence, own=own)


def _aliasing(rates: tuple[float, ...]) -> str:
    which, are = ("", "are") if len(rates) == 1 else ("slowest ", "may be")
    return (
        f"points at or above {0.5 / max(rates):.6g} Hz, half the {which}rate at which the model samples, {are} "
        "aliased: each sine looks like one below that frequency to it, and exactly there the answer depends "
        "on when it samples"
    )


def _check(period: Period, task: PointTask, *, time: float) -> None:
    if not np.isfinite(period.harmonics).all():
        raise SimulationError(f"{task.output} is not finite", time=time)
    if period.drive == 0.0:
        words = f"{task.input} does not move under an amplitude of {task.amplitude:g}"
        raise SimulationError(words, time=time)


def _recorded(session: Session, task: PointTask, sine: Sine, k: int) -> tuple[Period, float]:
    """Run a period; return its harmonics and the largest distance of two rows [s]."""
    points = task.span(sine, k).points
    record = session.advance(float(points[-1]), signals={task.input: sine}, record=(task.output,), points=points)
    period = measure_period(
        record,
        input=task.input,
        output=task.output,
        begin=sine.start,
        frequency=task.frequency,
        orders=max(1, min(ORDERS, task.rows // 4)),
        points=points if session.communication_step is None else None,
    )
    return period, float(np.max(np.diff(record.time)))


def _point(task: PointTask, response: PointResponse, periods: int) -> NfrPoint:
    if response.outcome in _REASONS:
        failed = _failed(task, periods, SimulationError(f"{task.output} {_reason(task, response.outcome)}"))
        return replace(failed, stable=False if response.outcome is SettlingOutcome.DIVERGED else None)
    averaged = response.outcome is SettlingOutcome.AVERAGED
    return NfrPoint(
        frequency=task.frequency,
        amplitude=task.amplitude,
        response=response.value,
        offset=response.offset,
        periods=periods,
        averaged=averaged,
        error=finite(response.error),
        stable=None if averaged else True,
        resolved=response.outcome is SettlingOutcome.RESOLVED,
    )


def _reason(task: PointTask, outcome: SettlingOutcome) -> str:
    """Return why there is no value."""
    if outcome is SettlingOutcome.SCATTERED and task.is_aliased:
        return (
            f"does not follow the input: the model samples every {max(task.rates):.6g} s, and answers a sine above "
            f"half that rate at frequencies below it; measure below {0.5 / max(task.rates):.6g} Hz"
        )
    return _REASONS[outcome]


def _failed(task: PointTask, periods: int, why: WorkbenchError) -> NfrPoint:
    return replace(failed_point(task.frequency, task.amplitude, why), periods=periods)


def failed_point(frequency: float, amplitude: float, why: WorkbenchError) -> NfrPoint:
    """Return the point that was not measured because of an error."""
    return NfrPoint(frequency=frequency, amplitude=amplitude, reason=str(why), kind=why.kind)


def change(old: NfrPoint, new: NfrPoint) -> tuple[float, float]:
    """Return by how much two measurements of one point differ: gain [1, relative], phase [deg].

    A failed point differs from everything without bound.
    """
    if old.response is None or new.response is None:
        return math.inf, math.inf
    if old.response == 0.0 or new.response == 0.0:
        same = old.response == new.response
        return (0.0, 0.0) if same else (math.inf, math.inf)
    quotient = new.response / old.response
    return abs(abs(quotient) - 1.0), abs(math.degrees(math.atan2(quotient.imag, quotient.real)))

"""What one worker does for a nonlinear frequency response: a point, a carried amplitude, the zero input."""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, nullcontext, suppress
from dataclasses import dataclass, replace
from functools import partial

from workbench.core.machine.blas import one_thread
from workbench.core.values.arrays import Floats
from workbench.core.values.operating_point import OperatingPoint
from workbench.errors import InputError, WorkbenchError
from workbench.jobs import job as telling
from workbench.jobs.runner import Remark, WorkItem
from workbench.model import Model
from workbench.model.operating_point import standing
from workbench.response.branches.request import Branches
from workbench.response.branches.result import BranchesResult
from workbench.response.branches.run import run as follow_branches
from workbench.response.nfr.communication_step import (
    NOT_TIGHTER,
    OF_HALVING,
    at_own_step,
    at_step,
    checked,
    other_step,
    refine,
    shows,
    wider,
)
from workbench.response.nfr.error import Evidence, of_integration
from workbench.response.nfr.jumps import ANOTHER
from workbench.response.nfr.own_motion import OWN
from workbench.response.nfr.own_solver import hidden, own_step
from workbench.response.nfr.period_solver import NotSolvedError, Search, can_solve, solve_point
from workbench.response.nfr.point import ROWS, ArrivedError, NfrPoint, PointTask, run_point
from workbench.response.nfr.prior_knowledge import Surroundings, quick, surroundings
from workbench.response.nfr.reached import Approach, contracts
from workbench.response.nfr.settling import EDGES
from workbench.response.nfr.zero_input import ZeroInput, watch
from workbench.session.base import Session
from workbench.session.compiled import CompiledMeSession

__all__ = ["BranchesJob", "PointsJob", "StartJob", "SurroundingsJob"]

# The integration may take so much of the error that was asked for.
_SHARE = 0.2

_EVENTS_ONLY = "the input may change at events only, and follows the sine in steps"

# A check by the tolerance takes so much of the one that the model has.
_TIGHTER = 0.01
# Edges that the usual rows do not resolve are measured with so many times as many.
_MORE_ROWS = 8

_COARSE = "its error is larger than what was asked for: use a smaller `tolerance`, or a larger amplitude"


@dataclass(frozen=True, kw_only=True)
class StartJob(WorkItem):
    """Look where the model stands, watch it while the input is held, and how its own solver shows.

    Attributes:
        task: names, the lowest frequency and the smallest amplitude.
        watched: False: look only.
    """

    task: PointTask
    watched: bool

    def run(self, model: Model) -> Iterator[OperatingPoint | ZeroInput | Remark]:
        held = {self.task.input: replace(self.task, amplitude=0.0).sine(model.start_time)}
        with model.open_session(signals=held, step=self.task.step) as session:
            yield standing(model, session)
            if self.watched:
                yield watch(session, self.task)
        if self.watched and (words := hidden(model, self.task)):
            yield Remark(words)
        yield from map(Remark, model.remarks([self.task.input]))


@dataclass(frozen=True, kw_only=True)
class SurroundingsJob(WorkItem):
    """Find out what is known where the runs start.

    Attributes:
        task: names, the highest frequency and the smallest amplitude.
    """

    task: PointTask

    def run(self, model: Model) -> Iterator[Surroundings]:
        seen = quick(self.task.frequency, self.task.max_periods)
        with one_thread():
            result = surroundings(model, self.task.input, self.task.output, seen)
        yield replace(result, own_step=own_step(model, replace(self.task, rates=result.rates)))


@dataclass(frozen=True, kw_only=True)
class PointsJob(WorkItem):
    """Measure one point afresh, or several in one session.

    Attributes:
        tasks: the points, in the order to be measured.
        carry: whether one session serves all.
        step: communication step [s], checked once with half of it; None: found by halving.
        verify: model exchange: measure again with a hundredth of the tolerance.
    """

    tasks: tuple[PointTask, ...]
    carry: bool
    step: float | None
    verify: bool = False

    def streams(self, interface: str) -> bool:
        """Whether the points come one by one: after a crash it is known which one was at work."""
        return len(self.tasks) == 1 or (interface != "cs" and not self.verify)

    def run(self, model: Model) -> Iterator[NfrPoint]:
        if model.interface != "cs":
            if any(v.name == self.tasks[0].input and v.variability == "discrete" for v in model.inputs):
                return iter(refine(self.tasks, partial(self._held, model), _EVENTS_ONLY))
            return self._verified(model) if self.verify else self._sharp(model)

        measured = partial(self._finer, model)
        highest = max(t.frequency for t in self.tasks)
        way = model.way_out(other_step(model, self.step, highest))
        if self.step is not None:
            points = at_step(self.tasks, self.step, measured, way)
        else:
            points = refine(self.tasks, measured, way)
            if model.grid is not None and shows(model.grid, highest) and all(p.reason is not None for p in points):
                points = at_step(self.tasks, model.grid, measured, way)  # the FMU may take no other step
        return iter(at_own_step(points, self.tasks, self.tasks[0].own_step, measured))

    def _finer(self, model: Model, tasks: Sequence[PointTask], halvings: int) -> list[NfrPoint]:
        """Measure co-simulation; the tolerance falls with the step, as often as that was halved.

        What the parts' own solvers leave does not follow the step, and a controlled step does not follow the rows.
        """
        if not halvings or model.recipe is None:
            return list(self._pass(nullcontext(model), tasks))
        result = list(self._pass(model.recipe.tighter(OF_HALVING**halvings).open(), tasks))
        if model.controls_step() or all(p.reason is None for p in result):
            return result
        reason = next(p.reason for p in result if p.reason is not None)
        return [
            replace(p, warning=p.warning or f"{p.frequency:.6g} Hz, amplitude {p.amplitude:g}: {NOT_TIGHTER}: {reason}")
            for p in self._pass(nullcontext(model), tasks)
        ]

    def _held(self, model: Model, tasks: Sequence[PointTask], _: int) -> list[NfrPoint]:
        """Measure model exchange whose input changes at events only: at each row, so that rows are as steps are."""
        return list(self._pass(nullcontext(model), [replace(t, rtol=model.rtol) for t in tasks]))

    def _exact_enough(self, model: Model) -> tuple[AbstractContextManager[Model], list[PointTask]]:
        """Return what to measure model exchange with, near a resonance or a zero with a tighter tolerance."""
        tasks = [replace(t, rtol=model.rtol) for t in self.tasks]
        factor = min(map(_factor, tasks))
        if factor == 1.0 or model.recipe is None:
            return nullcontext(model), tasks
        exact = model.recipe.tighter(factor).open()
        return exact, [replace(t, rtol=exact.rtol) for t in tasks]

    def _sharp(self, model: Model) -> Iterator[NfrPoint]:
        opened, tasks = self._exact_enough(model)
        # A carried run ends where it fails, and has fewer points than tasks.
        return map(partial(self._sharper, model), self._pass(opened, tasks), tasks)

    def _sharper(self, model: Model, point: NfrPoint, task: PointTask) -> NfrPoint:
        """Measure again with a tighter tolerance and more rows where the error is larger than what was asked for.

        So it is where the output moves little beside its mean, which the linear model does not show.
        """
        if point.certificate is not None and point.certificate.why == EDGES and not self.carry:
            (point,) = self._pass(nullcontext(model), [replace(task, rows=_MORE_ROWS * ROWS)])
        allowed = task.errcrit / 10.0
        if point.status != "settled" or point.error is None or point.error <= allowed or not task.rtol:
            return point
        result = point
        if model.recipe is not None and not self.carry:
            factor = _in_tens(point.error / (_SHARE * allowed)) * task.rtol / model.rtol
            exact = model.recipe.tighter(factor).open()
            (again,) = self._pass(exact, [replace(task, rtol=exact.rtol, rows=_MORE_ROWS * ROWS)])
            result = again if again.status == "settled" else point
        return wider(result, 0.0, _COARSE)

    def _verified(self, model: Model) -> Iterator[NfrPoint]:
        opened, tasks = self._exact_enough(model)
        with opened as exact:
            if exact.recipe is None:
                raise InputError(f"verify: the tolerance of {model.name}, which is not a file, cannot be changed")
            points = list(self._pass(nullcontext(exact), tasks))
            finer = list(self._pass(exact.recipe.tighter(_TIGHTER).open(), tasks))
        words = f"{_TIGHTER:g} of the tolerance"
        why = f"{words} gives a different result; use a smaller `tolerance`"
        for point, other in zip(points, finer, strict=True):
            yield checked(point, other, by="tolerance", words=words, why=why)

    def _pass(self, opened: AbstractContextManager[Model], tasks: Sequence[PointTask]) -> Iterator[NfrPoint]:
        """Measure `tasks` once: each afresh, or all in one session; after a failed point the next has a new one.

        Raises:
            FmuError, SimulationError: a session cannot be opened; no other point would fare better.
        """
        with opened as model, one_thread(), ExitStack() as stack:
            session: Session | None = None
            still: Session | None = None
            known: Floats | None = None
            for i, task in enumerate(tasks):
                # One session serves all that follow; the rows of each divide its period and bound the step.
                steps = [t.step for t in (tasks[i:] if self.carry else [task]) if t.step is not None]
                first, step = {task.input: task.sine(model.start_time)}, max(steps, default=None)
                if session is None:
                    session = stack.enter_context(model.open_session(signals=first, step=step))
                    still = _beside(stack, model, task, step) if task.moves else None
                evidence = (task if still is None else task.from_rest).evidence(known)
                if not self.carry and can_solve(session, task):
                    origin = session.stand()
                    search = Search(session, task, evidence)
                    with search.trying():
                        while search.found is None:
                            search.add(search.periods.lap(**search.next))
                    point = self._solved(model, session, task, search, origin)
                else:
                    remarks = model.remarks()
                    point = run_point(session, task, evidence, still)
                    if point.reason is not None and model.remarks() != remarks:  # what lets it go on was learned
                        stack.close()
                        session = stack.enter_context(model.open_session(signals=first, step=step))
                        still = _beside(stack, model, task, step) if task.moves else None
                        point = run_point(session, task, evidence, still)
                    point = _unparted(point, task) if task.moves and still is None else point
                if self.carry and point.reason is None:
                    known = _standing(evidence, point)
                else:
                    stack.close()
                    session = still = known = None
                yield point if model.interface == "cs" else replace(point, step=None)

    def _solved(
        self, model: Model, session: CompiledMeSession, task: PointTask, search: Search, origin: Floats
    ) -> NfrPoint:
        """Return the motion that the model reaches from its operating point: what was solved for, or another one."""
        result = search.found
        stands = result is not None and len(result.x) == 0
        if result is not None and result.stable is not False and (stands or contracts(session, task, result, origin)):
            return result.point(task, reached="contracts")
        session.close()
        watch = Approach([] if result is None or result.stable is False else [result])
        with ExitStack() as stack:
            other = stack.enter_context(model.open_session(signals={task.input: task.sine(model.start_time)}))
            own = bool(task.moves) or search.timed
            still = _beside(stack, model, task, None) if own else None
            point = _follow(other, task, (task if still is None else task.from_rest).evidence(), watch, still)
            point = _unparted(point, task) if own and still is None else point
            ran = point.certificate is not None and point.certificate.reached is not None and point.stable is not False
            if ran and point.status != "settled" and not own and isinstance(other, CompiledMeSession):
                point = _further(other, task, watch, point)
        solved = [m.point(task) for m in ([] if result is None else [result]) + watch.motions]
        if point.stable and any(_same(point, other) for other in solved if other.stable is False):
            point = replace(point, stable=None)  # the run may not have left it yet
        return _with(point, solved)


def _beside(stack: ExitStack, model: Model, task: PointTask, step: float | None) -> Session | None:
    """Return a second session, whose input stays at rest; None: the FMU allows one at a time."""
    try:
        zero = replace(task, amplitude=0.0).sine(model.start_time)
        return stack.enter_context(model.open_session(signals={task.input: zero}, step=step))
    except WorkbenchError:
        return None


def _unparted(point: NfrPoint, task: PointTask) -> NfrPoint:
    """Return a point of whose error the model's own motion is part, since it could not be told apart."""
    if point.error is None or not point.response:
        return point
    return wider(point, (task.moves or math.inf) / (task.amplitude * abs(point.response)), OWN)


def _follow(
    session: Session, task: PointTask, evidence: Evidence, watch: Approach, still: Session | None = None
) -> NfrPoint:
    """Return the motion that is watched where the run reaches it, else what the run comes to."""
    try:
        ran = run_point(session, task, evidence, still, watch)
    except ArrivedError:
        return watch.reached(task)
    same = ran.status == "settled" and ran.response is not None and watch.agrees(ran.response, ran.error or 0.0)
    return watch.reached(task) if same else replace(ran, periods=max(ran.periods, len(watch.seen)))


def _further(session: CompiledMeSession, task: PointTask, watch: Approach, ran: NfrPoint) -> NfrPoint:
    """Return what a run that has not settled comes to: solved for where it stands, and followed as long again."""
    there = session.snapshot()
    with suppress(NotSolvedError, WorkbenchError):
        again = solve_point(session, task, task.evidence(), warm=1)
        if again.stable is False:
            return ran
        watch.motions.append(again)
        if watch.reaches(again):
            return watch.reached(task)
        session.restore(there)
        longer = _follow(session, task, replace(task.evidence(), twin=None), watch)
        return ran if longer.reason is not None else longer
    return ran


def _with(point: NfrPoint, solved: Sequence[NfrPoint]) -> NfrPoint:
    """Return what the model does, telling of a response that was solved for, and that it has not come to."""
    other = next((p for p in reversed(solved) if not _same(point, p)), None)
    if other is None:
        return point
    gain, phase = cmath.polar(other.response or 0.0)
    kind = "an unstable" if other.stable is False else ANOTHER if other.stable else "another"
    words = f"there is {kind} periodic response of gain {gain:.6g}"
    if other.stable is not False:
        known = point.error is not None and point.reason is None
        words += (
            ", which the model does not come to from its operating point"
            if known
            else "; whether the model comes to it from its operating point is not known: look longer (`max_periods`)"
        )
    if point.certificate is not None:
        certificate = replace(point.certificate, other_gain=gain, other_phase_deg=math.degrees(phase))
        point = replace(point, certificate=certificate)
    if point.reason is not None:
        return replace(point, reason=f"{point.reason}; {words}", stable=False if other.stable is False else None)
    words = f"{point.frequency:.6g} Hz, amplitude {point.amplitude:g}: {words}"
    return replace(point, warning="; ".join(filter(None, [point.warning, words])))


def _same(point: NfrPoint, other: NfrPoint) -> bool:
    """Whether two are the same response, as far as their errors tell."""
    if point.response is None or other.response is None or point.error is None:
        return False
    return abs(point.response - other.response) <= (point.error + (other.error or 0.0)) * abs(other.response)


def _standing(evidence: Evidence, point: NfrPoint) -> Floats | None:
    """Return where the linear model of a carried point stands at its end."""
    return None if evidence.twin is None else evidence.twin.end(point.periods)


def _factor(task: PointTask) -> float:
    """Return what of the tolerance a resonance or terms that cancel allow, by tens; see `error_of_limit`."""
    forced = None if task.linear is None else task.linear.forced(task.frequency)
    if forced is None or task.rtol == 0.0 or forced.vanishes:
        return 1.0
    slow, size = 1.0 + forced.sensitivity, task.amplitude * abs(forced.response)
    error = of_integration(forced, task.rtol, slow, drive=task.amplitude, size=size, largest=size)
    allowed = _SHARE * task.errcrit / 10.0
    return _in_tens(error / allowed)


def _in_tens(ratio: float) -> float:
    """Return by what to multiply a tolerance so that its error falls by a ratio, in powers of ten; 1: it is small."""
    return 1.0 if ratio <= 1.0 else 10.0 ** -math.ceil(math.log10(ratio))


@dataclass(frozen=True, kw_only=True)
class BranchesJob(WorkItem):
    """Follow all periodic responses of one amplitude.

    Attributes:
        asked: band, amplitude, frequencies.
        told: ends it where it runs in the process that stops it.
    """

    asked: Branches
    told: telling.Job | None = None

    def run(self, model: Model) -> Iterator[BranchesResult]:
        yield follow_branches(model, self.asked, self.told or telling.Job())

"""A nonlinear frequency response as a sweep of jobs: what is to be measured, where, and what is known already."""

from __future__ import annotations

import cmath
import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from workbench.core.records.forms import several
from workbench.core.records.option import with_options
from workbench.core.values.arrays import Complex
from workbench.core.values.operating_point import OperatingPoint
from workbench.errors import InputError, WorkbenchError
from workbench.jobs import job as telling
from workbench.jobs.options import Workers
from workbench.jobs.runner import InProcess, Lost, Remark, Reply, Runner, WorkItem, perform
from workbench.jobs.runner_choice import choose
from workbench.model import DescribedModel, Model
from workbench.model.names import check_variables
from workbench.model.operating_point import centre_of, start_at
from workbench.requests.decorator import with_origin
from workbench.response.branches.request import Branches
from workbench.response.branches.result import BranchesResult, Fold
from workbench.response.nfr.communication_step import other_step, rows_of_step
from workbench.response.nfr.curve import DROP_DB
from workbench.response.nfr.features import AmplitudeLimit, CurveFeatures, amplitude_limit, features_of
from workbench.response.nfr.frequency_grid import frequency_grid
from workbench.response.nfr.job import BranchesJob, PointsJob, StartJob, SurroundingsJob
from workbench.response.nfr.jumps import another, disagreements, jumps, may_jump, solved, stepped_over, unseen_peaks
from workbench.response.nfr.point import ROWS, NfrPoint, PointTask, failed_point
from workbench.response.nfr.prior_knowledge import Surroundings
from workbench.response.nfr.request import Nfr
from workbench.response.nfr.result import NfrResult, assemble
from workbench.response.nfr.store import Key, NfrStore, check_redo, from_result
from workbench.response.nfr.zero_input import ZeroInput, doubt

if TYPE_CHECKING:
    from concurrent.futures import Executor

__all__ = ["NfrSweep", "run"]


def run(model: Model, request: Nfr, job: telling.Job) -> NfrResult:
    """Measure a nonlinear frequency response."""
    sweep = Sweep(model, request)
    job.partial = lambda: sweep.result() if sweep.done else None
    sweep.notes[:0], job.notes = job.notes, sweep.notes
    with job.ended_by(sweep.stop), sweep.under_way() as points:
        for point in points:
            job.done(point, sweep.done, sweep.total)
    job.reached = sweep.done, sweep.total  # those from the store are not told
    sweep.notes += sweep.derived_step()
    return sweep.result()


class Sweep:
    """A nonlinear frequency response that can be stopped: what was measured until then is not lost.

    ```python
    sweep = NfrSweep(model, "u", "y", [1.0, 2.0], [1.0])
    try:
        for point in sweep.run():
            ...
    finally:
        result = sweep.result()      # points not reached are failed with that reason
    ```

    Raises:
        InputError: unknown variable, a value out of its range, a store that cannot be used.
    """

    def __init__(self, model: Model, asked: Nfr) -> None:
        check_variables(model, [asked.input], "input", what="input")
        check_variables(model, [asked.output], "output", "state", what="output")
        if asked.verify and model.recipe is None:
            raise InputError(f"verify: the tolerance of {model.name}, which is not a file, cannot be changed")
        placed, remarks = start_at(model, asked.at)
        self._model, self._asked = placed, asked
        self._centre = centre_of(placed, asked.input)
        self._frequencies = frequency_grid(asked.frequencies, asked.band, asked.ratio, falling=asked.carry)
        self._amplitudes = tuple(sorted(several(asked.amplitudes or ())))
        if asked.step is not None and model.interface == "cs":
            rows_of_step(max(self._frequencies), asked.step)
        self._workers = _with_executor(asked.place, asked.executor)
        if asked.branches:
            self._branches(1.0)  # said before anything is measured
        self._redo = check_redo(asked.redo)
        self.notes: list[str] = list(remarks)
        self._points: dict[Key, NfrPoint] = {}
        self._zero_input: ZeroInput | None = None
        self._standing: OperatingPoint | None = None
        self._surroundings = Surroundings()
        self._runner: Runner | None = None
        self._stopped = False
        self._told = telling.Job()
        self._followed: list[BranchesResult] = []
        self._second: dict[float, tuple[NfrPoint, ...]] = {}  # where it was looked for, by amplitude
        self._peaks: dict[float, list[NfrPoint]] = {}  # measured between the points, where the linear model has one
        self._between: dict[Key, NfrPoint] = {}  # measured for what `features` tells
        self._features: list[CurveFeatures] = []
        self._limit: AmplitudeLimit | None = None
        self._told_of: list[str] = []
        self._store = None if asked.store is None else self._open_store(asked.store)
        self._before: dict[Key, NfrPoint] = {}
        with ExitStack() as unless_well:
            if self._store is not None:
                unless_well.callback(self._store.close)
            self._recall(asked.previous)
            unless_well.pop_all()

    # -- what is known already -------------------------------------------------------------

    def _open_store(self, folder: str | Path) -> NfrStore:
        settings = {
            "input": self._asked.input,
            "output": self._asked.output,
            "rows": ROWS,
            "step": self._asked.step,
            "verify": self._asked.verify,
            "method": self._asked.method,
            # A carried point depends on those before it.
            "carry": list(self._frequencies) if self._asked.carry else None,
        }
        effort = {"errcrit": self._asked.errcrit, "max_periods": self._asked.max_periods}
        limits = self._workers.limits
        return NfrStore.open(folder, self._model, settings=settings, effort=effort, limits=limits)

    def _recall(self, previous: NfrResult | None) -> None:
        """Take over what an earlier run measured, as far as it is asked for and need not be done again."""
        if self._redo and previous is None and self._store is None:
            raise InputError("redo: give the store or the result of the earlier run")
        known: dict[Key, NfrPoint] = {}
        if previous is not None:
            self._check_previous(previous)
            self._before = from_result(previous, ())
            # A carried point depends on those before it, and the earlier result does not say which those were.
            known |= {} if self._asked.carry else from_result(previous, self._redo)
            self._standing = previous.operating_point
        if self._store is not None:
            known |= self._store.finished(self._redo)
            self._between = dict(known)
            self._zero_input = self._store.zero_input()
            self._standing = self._store.standing() or self._standing
            self._second = self._store.second(self._frequencies)
            self._told_of += self._store.store.remarks()
        for a in self._amplitudes:
            keys = [(a, f) for f in self._frequencies]
            if not self._asked.carry or all(k in known for k in keys):
                self._points |= {k: known[k] for k in keys if k in known}
        if self._points:
            self.notes.append(f"{len(self._points)} of {self.total} points were measured before and are kept")

    def _check_previous(self, previous: NfrResult) -> None:
        names = ("model", "interface", "solver", "input", "output")
        here = (self._model.name, self._model.interface, self._model.solver, self._asked.input, self._asked.output)
        for name, mine in zip(names, here, strict=True):
            if getattr(previous, name) != mine:
                raise InputError(f"previous: its {name} is {getattr(previous, name)}, not {mine}")

    # -- the sweep -------------------------------------------------------------------------

    @property
    def total(self) -> int:
        """Number of points."""
        return len(self._frequencies) * len(self._amplitudes)

    @property
    def done(self) -> int:
        """Number of points that have a result, those kept from an earlier run included."""
        return len(self._points)

    def run(self) -> Iterator[NfrPoint]:
        """Measure point by point, in the order in which they are finished; may be run once.

        Raises:
            FmuError, SimulationError: the FMU cannot be started.
            KeyboardInterrupt: after `stop`.
        """
        with self.under_way() as points:
            yield from points

    @contextmanager
    def under_way(self) -> Iterator[Iterator[NfrPoint]]:
        """Yield the points of `run`; the store and what measures are closed after it."""
        with ExitStack() as stack:
            if self._store is not None:
                stack.callback(self._store.close)
            if self.done == self.total and not self._afterwards_wanted():
                yield iter(())
                return
            runner, notes = choose(self._model, self._workers)
            stack.callback(lambda: self._told_of.extend(runner.remarks()))  # also of what was interrupted
            self._runner = stack.enter_context(runner)
            runner.numbers = _responses
            self.notes += notes
            if self._stopped:
                runner.stop()
            self._look(runner)
            jobs: deque[WorkItem] = deque(self._jobs())
            if isinstance(runner, InProcess):
                jobs = deque(map(self._stoppable, jobs))
            points = chain.from_iterable(map(partial(self._take, jobs), runner.run(perform, jobs)))
            yield chain(points, self._afterwards(runner))

    def _afterwards(self, runner: Runner) -> Iterator[NfrPoint]:
        """Look for second responses where there may be some, and follow the branches if they are asked for."""
        if self._asked.branches:
            jobs = [BranchesJob(asked=self._branches(a)) for a in self._amplitudes]
        else:
            unseen = [a for a in self._amplitudes if a not in self._second and solved(self._row(a))]
            peaks = self._at_peaks(runner, unseen)
            linear = self._surroundings.linear
            bent = [a for a in unseen if may_jump([*self._row(a), *(p for p in peaks if p.amplitude == a)], linear)]
            jobs = [BranchesJob(asked=replace(self._branches(a), order=1, seeds=0)) for a in bent]
            self._peaks = {a: [p for p in peaks if p.amplitude == a] for a in unseen}
            for a in unseen:
                if a not in bent:
                    self._keep_second(a, self._peaks[a])
        try:
            for event in self._run(runner, jobs):
                self._take_found(event)
        except WorkbenchError as error:  # what was measured is not lost for it
            if self._asked.branches:
                raise
            self._told_of.append(f"second responses could not be looked for: {error}")
        self._find_features(partial(self._measure, runner))
        yield from ()

    def _find_features(self, measure: Callable[[float, float], NfrPoint]) -> None:
        """Measure bandwidth and resonance at each amplitude, and the amplitude for a least bandwidth."""
        if self._drop_db is None:
            return
        rows = [[*self._row(a), *self._peaks.get(a, ())] for a in self._amplitudes]
        for row in rows:
            self._features.append(features_of(sorted(row, key=lambda p: p.frequency), self._drop_db, measure))
        if self._asked.least_bandwidth is not None:
            self._limit = amplitude_limit(rows, self._asked.least_bandwidth, self._drop_db, measure)

    def _measure(self, runner: Runner, frequency: float, amplitude: float) -> NfrPoint:
        """Return a point that need not be one of the grid; each is measured once."""
        for (a, f), point in (*self._points.items(), *self._between.items()):
            if math.isclose(a, amplitude, rel_tol=1e-12) and math.isclose(f, frequency, rel_tol=1e-12):
                return point
        events = self._run(runner, [self._points_job([self._task(frequency, amplitude)])])
        (result,) = (
            failed_point(frequency, amplitude, event.error) if isinstance(event, Lost) else event.value
            for event in events
            if isinstance(event, Lost) or isinstance(event.value, NfrPoint)
        )
        if self._store is not None:
            self._store.save(result)
        self._between[amplitude, frequency] = result
        return result

    @property
    def _drop_db(self) -> float | None:
        asked = self._asked
        return DROP_DB if asked.bandwidth is None and asked.least_bandwidth is not None else asked.bandwidth

    def _at_peaks(self, runner: Runner, amplitudes: Sequence[float]) -> list[NfrPoint]:
        """Return the responses at resonances that the sweep has stepped over."""
        peaks = unseen_peaks(self._frequencies, self._surroundings.linear) if len(self._frequencies) > 1 else []
        jobs = [self._points_job([self._task(f, a)]) for a in amplitudes for f in peaks]
        return [e.value for e in self._run(runner, jobs) if not isinstance(e, Lost) and isinstance(e.value, NfrPoint)]

    def _run(self, runner: Runner, jobs: Iterable[WorkItem]) -> Iterator[Reply | Lost]:
        """Run jobs; those in this process can be stopped."""
        return runner.run(perform, deque(map(self._stoppable, jobs) if isinstance(runner, InProcess) else jobs))

    def _take_found(self, event: Reply | Lost) -> None:
        if isinstance(event, Lost):
            what = "branches" if self._asked.branches else "second responses"
            self._told_of.append(f"{what} could not be looked for: {event.reason}")
        elif self._asked.branches:
            self._followed.append(event.value)
        else:
            (amplitude,) = several(event.job.asked.amplitudes)
            others = [p for f in self._frequencies for p in _stable_at(event.value, f, amplitude)]
            self._keep_second(amplitude, [*others, *self._peaks.get(amplitude, ())])

    def _row(self, amplitude: float) -> list[NfrPoint]:
        return [self._points[amplitude, f] for f in sorted(self._frequencies) if (amplitude, f) in self._points]

    def _afterwards_wanted(self) -> bool:
        """Whether something is to be done when all points are known."""
        seen = self._second
        return (
            self._asked.branches
            or self._drop_db is not None
            or any(solved(self._row(a)) for a in self._amplitudes if a not in seen)
        )

    def _keep_second(self, amplitude: float, result: Sequence[NfrPoint]) -> None:
        self._second[amplitude] = tuple(result)
        if self._store is not None:
            self._store.save_second(amplitude, self._frequencies, result)

    def _branches(self, amplitude: float) -> Branches:
        low, high = min(self._frequencies), max(self._frequencies)
        if low == high:
            raise InputError("branches: they are followed over a band of frequencies; give one with `band`")
        return Branches(
            input=self._asked.input,
            output=self._asked.output,
            amplitudes=[amplitude],
            band=(low, high),
            frequencies=self._frequencies[:: 1 if self._frequencies[0] == low else -1],
        )

    def _look(self, runner: Runner) -> None:
        """Find out what the model shows of itself, and does by itself, before anything is measured."""
        jobs: list[WorkItem] = [SurroundingsJob(task=self._task(max(self._frequencies), self._amplitudes[0]))]
        watched = self._asked.drift_check and self._zero_input is None
        if watched or self._standing is None:
            jobs.append(StartJob(task=self._task(min(self._frequencies), self._amplitudes[0]), watched=watched))
        for event in runner.run(perform, deque(jobs)):
            if isinstance(event, Lost) and isinstance(event.job, SurroundingsJob):
                self.notes.append(f"the linear model could not be found, so errors are larger: {event.reason}")
            elif not isinstance(event, Lost) and isinstance(event.value, Surroundings):
                self._surroundings = event.value
                self.notes += event.value.notes
            else:
                deque(self._take(deque(), event), maxlen=0)

    def stop(self) -> None:
        """Let `run` end with KeyboardInterrupt soon; may be called by a signal handler."""
        self._stopped = True
        self._told.stopped = True
        if self._runner is not None:
            self._runner.stop()

    def _jobs(self) -> Iterator[WorkItem]:
        for amplitude in self._amplitudes:
            tasks = [self._task(f, amplitude) for f in self._frequencies if (amplitude, f) not in self._points]
            if self._asked.carry and tasks:
                yield self._points_job(tasks)
            elif tasks:
                yield from (self._points_job([t]) for t in tasks)

    def _points_job(self, tasks: Sequence[PointTask]) -> PointsJob:
        return PointsJob(tasks=tuple(tasks), carry=self._asked.carry, step=self._asked.step, verify=self._asked.verify)

    def _task(self, frequency: float, amplitude: float) -> PointTask:
        rates, zero = self._surroundings.rates, self._zero_input or ZeroInput()
        moves = zero.told_apart(continuous=self._model.interface == "me" and not rates)
        return PointTask(
            input=self._asked.input,
            output=self._asked.output,
            frequency=frequency,
            amplitude=amplitude,
            errcrit=self._asked.errcrit,
            max_periods=self._asked.max_periods,
            linear=self._surroundings.linear,
            rates=rates,
            centre=self._centre,
            # What events move from outside is not seen in the equations.
            method="settle" if moves and zero.events else self._asked.method,
            moves=moves,
            own_step=self._surroundings.own_step,
        )

    def _stoppable(self, job: WorkItem) -> WorkItem:
        """Let a job that runs in this process ask between periods whether to stop."""
        if isinstance(job, BranchesJob):
            return replace(job, told=self._told)
        if isinstance(job, PointsJob):
            return replace(job, tasks=tuple(replace(t, stopped=lambda: self._stopped) for t in job.tasks))
        return job

    def _take(self, jobs: deque[WorkItem], event: Reply | Lost) -> Iterator[NfrPoint]:
        if isinstance(event, Lost):
            yield from self._lost(event, jobs)
        elif isinstance(event.value, OperatingPoint):
            self._keep_standing(event.value)
        elif isinstance(event.value, ZeroInput):
            self._keep_zero_input(event.value)
        elif isinstance(event.value, Remark):
            self.notes.append(event.value.text)
        elif isinstance(event.value, NfrPoint):
            yield self._keep(event.value)

    def _keep(self, point: NfrPoint, *, lost: bool = False) -> NfrPoint:
        if self._store is not None:
            self._store.save(point, lost=lost)
        self._points[point.amplitude, point.frequency] = point
        return point

    def _keep_standing(self, result: OperatingPoint) -> None:
        self._standing = result
        if self._store is not None:
            self._store.save_standing(result)

    def _keep_zero_input(self, result: ZeroInput) -> None:
        self._zero_input = result
        if self._store is not None and result.reason is None:
            self._store.save_zero_input(result)

    def _lost(self, event: Lost, jobs: deque[WorkItem]) -> Iterator[NfrPoint]:
        """The point at work fails; those after it go on in another process."""
        if isinstance(event.job, StartJob):
            if event.job.watched:
                self._keep_zero_input(ZeroInput(reason=event.reason))
            return
        if not isinstance(event.job, PointsJob):
            return
        missing = [t for t in event.job.tasks if (t.amplitude, t.frequency) not in self._points]
        if event.job.streams(self._model.interface):
            missing, rest = missing[:1], missing[1:]
            if rest:
                jobs.appendleft(replace(event.job, tasks=tuple(rest)))
        for t in missing:
            yield self._keep(failed_point(t.frequency, t.amplitude, event.error), lost=True)

    # -- the result ------------------------------------------------------------------------

    def derived_step(self) -> tuple[str, ...]:
        """Return in words the communication steps that the points have, where nobody names one."""
        if self._asked.step is not None or not isinstance(self._model, DescribedModel):
            return ()
        return self._model.derived_step(*(p.step for p in self._points.values()))

    @with_origin()
    def result(self) -> NfrResult:
        """Return what was measured so far."""
        points = list(self._points.values())
        zero = self._zero_input
        way = self._model.way_out(other_step(self._model, self._asked.step, max(self._frequencies)))
        warning = None if zero is None else doubt(zero, points, output=self._asked.output, way=way)
        looked = {*self._second, *(b.amplitude for traced in self._followed for b in traced.branches)}
        seen = [
            jumps(self._row(a), carried=self._asked.carry, interface=self._model.interface)
            for a in self._amplitudes
            if a not in looked
        ]
        warnings = [
            *chain.from_iterable(seen),
            *(words for a in self._amplitudes for words in stepped_over(self._row(a), self._second.get(a, ()))),
            *disagreements(self._points, self._before), *self._told_of,
            *(w for traced in self._second.values() for w in another(self._points, traced, self._asked.output)),
            *filter(None, [warning]),
        ]  # fmt: skip
        followed = sorted(self._followed, key=lambda traced: traced.branches[0].amplitude or 0.0)
        warnings += [text for traced in followed for text in traced.warnings]
        return assemble(
            self._model,
            input=self._asked.input,
            output=self._asked.output,
            frequencies=self._frequencies,
            amplitudes=self._amplitudes,
            points=points,
            warnings=warnings,
            zero_input=self._zero_input,
            branches=tuple(branch for traced in followed for branch in traced.branches),
            folds=tuple(_folds(followed)),
            operating_point=self._standing,
            features=tuple(self._features),
            amplitude_limit=self._limit,
        )


def _folds(followed: Sequence[BranchesResult]) -> Iterator[Fold]:
    """Yield the folds of several results, with the numbers that their branches have together."""
    before = 0
    for result in followed:
        yield from (replace(fold, branch=fold.branch + before) for fold in result.folds)
        before += len(result.branches)


def _stable_at(result: BranchesResult, frequency: float, amplitude: float) -> Iterator[NfrPoint]:
    """Yield the stable responses at a frequency."""
    for branch in result.branches:
        for i in np.flatnonzero(np.isclose(branch.frequency_hz, frequency, rtol=1e-9) & branch.stable).tolist():
            response = cmath.rect(branch.gain[i], math.radians(branch.phase_deg[i]))
            yield NfrPoint(frequency=frequency, amplitude=amplitude, response=response, stable=True)


def _with_executor(workers: Workers, executor: Executor | None) -> Workers:
    return workers if executor is None else replace(workers, executor=executor)


NfrSweep = with_options(
    Nfr,
    Sweep,
    name="NfrSweep",
    first=("model", "Model", "The model to analyse; it stays open."),
    words="Begin a sweep: `for point in sweep.run(): …`, then `sweep.result()`.",
)


def _responses(items: Sequence[object]) -> Complex:
    """Return what two worker processes must agree in: responses and means of points [of the output], shape (n,)."""
    result = [p for p in items if isinstance(p, NfrPoint) and p.response is not None]
    return np.array([x for p in result for x in (p.amplitude * (p.response or 0.0), p.offset or 0.0)], dtype=complex)

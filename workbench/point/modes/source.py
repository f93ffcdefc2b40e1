"""Poles of a model over one of its parameters, inputs or states."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace

from workbench.core.records.option import recast
from workbench.core.values.modal import Poles, poles_near, poles_of
from workbench.core.values.operating_point import OperatingPoint
from workbench.errors import SimulationError
from workbench.jobs.job import Job
from workbench.jobs.options import Workers
from workbench.jobs.runner import Lost
from workbench.jobs.runner_choice import at_work
from workbench.model import Model
from workbench.model.names import check_variables
from workbench.model.varied import with_parameters
from workbench.point.lin.grid import LinPoint
from workbench.point.lin.linearise import run
from workbench.point.lin.request import Lin, LinOver
from workbench.point.lin.result import LinResult
from workbench.point.lin.sweep import matrices_of, points_over
from workbench.point.lin.task import make_task
from workbench.point.trim.request import trim

__all__ = ["ModelSource", "check_parameter"]

_HERE = Workers(in_process=True)
_SPARE = 4  # modes beside the wanted ones, at least

# How accurate the entries of A are, relative to its size, by method; those not named: rounding.
_ACCURACY = {"difference": 1e-8, "kalman-bertram": 1e-8, "response": 1e-5}


def check_parameter(model: Model, name: str) -> None:
    """Refuse a name that cannot be varied.

    Args:
        model: whose it should be.
        name: of a parameter, input or state, or "component.parameter" of a system's block or gain.

    Raises:
        InputError: the model has no such name.
    """
    check_variables(model, [name], "parameter", "input", "state", what="vary", number=True)


@dataclass(frozen=True, eq=False, kw_only=True)
class _ModelFamily:
    """A value at which is linearised what `lin_over` does not: about an equilibrium of its own."""

    vary: str
    value: float
    lin: Lin
    trimmed: bool


def _linearised(model: Model, job: _ModelFamily) -> Iterator[LinPoint]:
    """Linearise at one value; what a worker process runs."""
    varied = {job.vary: job.value}
    try:
        with _set(model, job) as opened:
            point = _trimmed(opened, job) if job.trimmed else None
            lin = job.lin
            asked = lin if point is None else replace(lin, x0={**point.x, **point.discrete}, u0=point.u)
            yield LinPoint(varied, run(replace(make_task(opened, asked), explained=False), asked.method))
    except SimulationError as error:
        yield LinPoint(varied, None, str(error), error.kind)


def _set(model: Model, job: _ModelFamily) -> AbstractContextManager[Model]:
    varied = {job.vary: job.value} if job.vary in {v.name for v in model.parameters} else {}
    return nullcontext(with_parameters(model, varied))


def _trimmed(model: Model, job: _ModelFamily) -> OperatingPoint:
    x0, u0, states = job.lin.x0 or {}, job.lin.u0 or {}, {v.name for v in model.states}
    fixed = {job.vary: job.value} if job.vary in states else {}
    forced = {job.vary: job.value} if job.vary in {v.name for v in model.inputs} else {}
    begin = {n: v for n, v in x0.items() if n in states}
    found = trim(model, x0=begin, u0={**u0, **forced}, fix=fixed, time=job.lin.time)
    if not found.converged:
        raise SimulationError("no equilibrium was found there")
    return found.operating_point


@dataclass(frozen=True, eq=False)
class Known:
    """What is kept of a linear model; large matrices at many values would not fit into memory.

    Attributes:
        poles: of it.
        state_names, operating_point, notes: its own.
    """

    poles: Poles
    state_names: tuple[str, ...]
    operating_point: OperatingPoint
    notes: tuple[str, ...]


class ModelSource:
    """Linearises at each value that is asked for, once.

    Args:
        model: stays open.
        vary: parameter, input or state.
        lin: how, and about which operating point.
        trimmed: find the equilibrium at each value; the search begins at that point.
        count: so many modes are wanted; some more are found, which may take their places; None: all.
        about: frequency near which they lie [Hz].

    Attributes:
        results: value → what is known of the linear model.
        failed: value → reason.
    """

    def __init__(
        self, model: Model, vary: str, lin: Lin, *, trimmed: bool, count: int | None = None, about: float = 0.0
    ) -> None:
        self._model, self._vary, self._lin, self._trimmed = model, vary, lin, trimmed
        self._one_by_one = trimmed
        self._count, self._about = count, about
        self.results: dict[float, Known] = {}
        self.failed: dict[float, str] = {}

    def prepare(self, values: Sequence[float], workers: Workers, job: Job, *, label: str) -> None:
        """Linearise at many values, several at a time.

        Args:
            values: of the parameter.
            workers: where.
            job: is told each, and can end it.
            label: words for it.
        """
        for done, point in enumerate(self._points(values, workers, job), 1):
            self._take(point)
            job.done(label, done, len(values) + 1)  # they are still to be followed

    def __call__(self, value: float) -> Poles | None:
        """Return the poles at a value; None: there is no linear model.

        Args:
            value: of the parameter.
        """
        value = float(value)
        if value in self.failed:
            return None
        if value not in self.results:
            self._take(next(iter(self._points([value], _HERE, Job()))))
            if value in self.failed:
                return None
        return self.results[value].poles

    def _take(self, point: LinPoint) -> None:
        value = point.values[self._vary]
        if point.result is None:
            self.failed[value] = point.reason or "no linear model"
        else:
            found = point.result
            self.results[value] = Known(self._poles(found), found.state_names, found.operating_point, found.notes)

    def _poles(self, found: LinResult) -> Poles:
        accuracy = _ACCURACY.get(found.method, 0.0)
        if self._count is None:
            return poles_of(found.A, dt=found.dt, accuracy=accuracy)
        some = self._count + max(self._count // 2, _SPARE)
        return poles_near(found.A, some, self._about, dt=found.dt, accuracy=accuracy)

    def _points(self, values: Sequence[float], workers: Workers, job: Job) -> Iterator[LinPoint]:
        """Yield the linear models as they are finished."""
        if not self._one_by_one:
            over = recast(LinOver, self._lin, over={self._vary: values})
            yield from points_over(self._model, over, workers, job, explained=False)
            return
        jobs = deque(_ModelFamily(vary=self._vary, value=v, lin=self._lin, trimmed=self._trimmed) for v in values)
        with at_work(self._model, workers, job, numbers=matrices_of) as runner:
            for event in runner.run(_linearised, jobs):
                yield (
                    LinPoint({self._vary: event.job.value}, None, event.reason, event.kind)
                    if isinstance(event, Lost)
                    else event.value
                )

"""Linearise over a grid of parameters and inputs, or at several times of a simulation."""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from workbench.core.records.forms import several
from workbench.core.records.option import recast
from workbench.core.values.arrays import Floats
from workbench.errors import InputError, SimulationError
from workbench.jobs.job import Job
from workbench.jobs.options import Workers
from workbench.jobs.runner import Lost, Reply
from workbench.jobs.runner_choice import at_work
from workbench.jobs.store import Store
from workbench.jobs.version import stamp
from workbench.model import Model
from workbench.model.names import check_variables, forced_inputs
from workbench.model.varied import with_parameters
from workbench.point.lin.grid import LinGrid, LinPoint, _label
from workbench.point.lin.linearise import run
from workbench.point.lin.request import Lin, LinAlong, LinOver
from workbench.point.lin.result import LinResult
from workbench.point.lin.task import make_task, point_in_full
from workbench.point.trim.request import trim

__all__ = ["along", "check_varied", "linearise_one", "over", "points_at", "points_over"]

# To be raised whenever a change of the code changes a result: stored results of both are not mixed.
_ALGORITHM = 1

# What a stored result depends on besides the model and what is varied.
_DECIDING = ("method", "x0", "u0", "dx", "du", "inputs", "outputs", "time", "period")


@dataclass(frozen=True, kw_only=True)
class _LinJob:
    """One linearisation, for a worker process; `trimmed`: about the equilibrium that is found from its point."""

    varied: dict[str, float]
    parameters: dict[str, float]
    request: Lin
    explained: bool
    trimmed: bool


def over(model: Model, request: LinOver, job: Job) -> LinGrid:
    """Linearise at every combination; see `LinOver`."""
    grid = {name: several(values) for name, values in request.over.items()}
    every = [dict(zip(grid, values, strict=True)) for values in itertools.product(*grid.values())]
    solution: dict[str, LinPoint] = {}

    def result() -> LinGrid:
        points = (solution.get(_label(varied)) or LinPoint(varied, None, "not reached") for varied in every)
        return LinGrid(model.name, model.interface, model.solver, grid, tuple(points))

    job.partial = lambda: result() if solution else None
    for point in points_over(model, request, request.place.apart, job):
        solution[str(point)] = point
        job.done(point, len(solution), len(every))
    return result()


def points_over(
    model: Model, request: LinOver, workers: Workers, job: Job, *, explained: bool = True, trimmed: bool = False
) -> Iterator[LinPoint]:
    """Linearise at every combination; yield the models as they are finished.

    Args:
        model: stays open.
        request: see `LinOver`.
        workers: where.
        job: can end it.
        explained: see `LinTask`.
        trimmed: each about an equilibrium of its own; states that are varied stay.

    Raises:
        InputError, FmuError: see `LinOver`.
    """
    grid = {name: several(values) for name, values in request.over.items()}
    check_varied(model, grid, what="over")
    every = [dict(zip(grid, values, strict=True)) for values in itertools.product(*grid.values())]
    common = recast(Lin, request, at=None, progress=None, workers=None, **point_in_full(model, request)[0])
    yield from points_at(
        model, every, common, workers, job, explained=explained, trimmed=trimmed, store=request.store
    )  # fmt: skip


def points_at(
    model: Model, every: Iterable[dict[str, float]], common: Lin, workers: Workers, job: Job, *, explained: bool = True,
    trimmed: bool = False, store: str | Path | None = None,
) -> Iterator[LinPoint]:  # fmt: skip
    """Linearise at points that are given one by one; yield the models as they are finished.

    Args:
        model: stays open.
        every: parameters, inputs or states → value at each point.
        common: what all have in common.
        workers: where.
        job: can end it.
        explained: see `LinTask`.
        trimmed: see `points_over`.
        store: folder in which finished models are kept; None: they are not.

    Raises:
        InputError, FmuError: see `LinOver`.
    """
    todo = [_job(model, varied, common, explained=explained, trimmed=trimmed) for varied in every]
    with _open_store(store, model, common) as kept:
        yield from _all(model, todo, workers, kept, job)


def check_varied(model: Model, grid: Mapping[str, tuple[float, ...]], *, what: str) -> None:
    """Refuse names that cannot be varied.

    Args:
        model: that has them.
        grid: parameters, inputs or states, each with values.
        what: the option that names them, for the message.

    Raises:
        InputError: there are none, an unknown name, or parameters of a model that is not a file.
    """
    if not grid or not all(grid.values()):
        raise InputError(f"{what}: nothing to vary; give NAME=value,value,…")
    check_variables(model, grid, "parameter", "input", "state", what=what, number=True)
    if model.recipe is None and any(n in {p.name for p in model.parameters} for n in grid):
        raise InputError(f"{what}: the parameters of {model.name} cannot be set, as it is not a file")


def _job(model: Model, varied: dict[str, float], common: Lin, *, explained: bool, trimmed: bool) -> _LinJob:
    inputs, states = {v.name for v in model.inputs}, {v.name for v in model.states}
    request = replace(
        common,
        u0={**(common.u0 or {}), **{n: v for n, v in varied.items() if n in inputs}},
        x0={**(common.x0 or {}), **{n: v for n, v in varied.items() if n in states}},
    )
    parameters = {n: v for n, v in varied.items() if n not in inputs | states}
    return _LinJob(varied=varied, parameters=parameters, request=request, explained=explained, trimmed=trimmed)


def _all(model: Model, todo: Sequence[_LinJob], workers: Workers, kept: Store | None, job: Job) -> Iterator[LinPoint]:
    """Yield every point: those on disk, then those that are made now, each on disk before the next."""
    done = kept.load() if kept is not None else {}
    job.notes += kept.remarks() if kept is not None else []
    for one in todo:
        if kept is not None and _label(one.varied) in done:
            yield LinPoint(one.varied, _kept(kept, done[_label(one.varied)]))
    queue = deque(j for j in todo if _label(j.varied) not in done)
    with at_work(model, workers, job, numbers=matrices_of) as runner:
        for answer in runner.run(linearise_one, queue):
            point = _point(answer)
            if kept is not None and point.result is not None:
                kept.save(str(point), point.result.to_dict())
            yield point


def matrices_of(points: Sequence[LinPoint]) -> Floats:
    """Return all entries of the matrices of linear models, shape (n,).

    Args:
        points: those that failed have none.
    """
    result = [m.ravel() for p in points if (r := p.result) is not None for m in (r.A, r.B, r.C, r.D)]
    return np.concatenate(result) if result else np.zeros(0)


def _kept(kept: Store, value: Any) -> LinResult:  # noqa: ANN401 - whatever stands there
    with kept.taken_apart():
        return LinResult.from_dict(value)


def _point(answer: Reply | Lost) -> LinPoint:
    if isinstance(answer, Lost):
        return LinPoint(answer.job.varied, None, answer.reason, answer.kind)
    point: LinPoint = answer.value
    return point


def linearise_one(model: Model, job: _LinJob) -> Iterator[LinPoint]:
    """Linearise one point of a grid; what a worker process runs."""
    varied = with_parameters(model, job.parameters)
    try:
        request = _at_rest(varied, job) if job.trimmed else job.request
        task = replace(make_task(varied, request), explained=job.explained)
        yield LinPoint(job.varied, run(task, job.request.method))
    except SimulationError as error:
        yield LinPoint(job.varied, None, str(error), error.kind)


def _at_rest(model: Model, job: _LinJob) -> Lin:
    """Return the linearisation about the equilibrium that is found from its point."""
    request, states = job.request, {v.name for v in model.states}
    begin = {n: v for n, v in (request.x0 or {}).items() if n in states}
    fixed = {n: v for n, v in begin.items() if n in job.varied}
    result = trim(model, x0=begin, u0=request.u0, fix=fixed, time=request.time, in_process=True)  # where this runs
    if not result.converged:
        raise SimulationError("no equilibrium was found there")
    point = result.operating_point
    return replace(request, x0={**point.x, **point.discrete}, u0=point.u)


def _open_store(store: str | Path | None, model: Model, request: Lin) -> Store | nullcontext[None]:
    if store is None:
        return nullcontext()
    if model.recipe is None:
        raise InputError(f"store: {model.name} is not a file; its results cannot be distinguished from another model's")
    subject = {
        "analysis": "lin",
        "algorithm": _ALGORITHM,
        **stamp().in_store,
        "model": model.recipe.identity(),
        "interface": model.interface,
        **{name: getattr(request, name) for name in _DECIDING},
    }
    return Store(store, subject=subject, effort={})


def along(model: Model, request: LinAlong, job: Job) -> LinGrid:
    """Linearise along a simulation; see `LinAlong`."""
    times = several(request.times)
    if not times or times[0] < 0.0 or any(b <= a for a, b in itertools.pairwise(times)):
        raise InputError("snapshot: the times must rise from 0 on")
    forced = forced_inputs(model, request.signals or {}, what="signals")
    points: list[LinPoint] = []

    def result() -> LinGrid:
        return LinGrid(model.name, model.interface, model.solver, {"time": times[: len(points)]}, tuple(points))

    job.partial = lambda: result() if points else None
    with model.open_session(signals=forced) as session:
        names = _standing_names(model)
        for time in times:
            session.advance(time, signals=forced)
            session.advance(time, signals=forced)  # the right limit
            task = replace(make_task(model, recast(Lin, request, time=time)), values=session.values(names))
            points.append(LinPoint({"time": time}, run(task, request.method)))
            job.done(points[-1], len(points), len(times))
    return result()


def _standing_names(model: Model) -> list[str]:
    """Return what makes up where a model stands: states, discrete states, inputs."""
    discrete = list[str]()
    if model.interface == "me":
        with model.open_point() as point:
            discrete = list(point.discrete())
    numeric = [v.name for v in (*model.states, *model.inputs) if v.is_number]
    return list(dict.fromkeys([*numeric, *discrete]))

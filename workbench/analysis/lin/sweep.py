"""Linearise over a grid of parameters and inputs, or at several times of a simulation."""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from workbench import __version__
from workbench.analysis.lin.linearise import run
from workbench.analysis.lin.result import LinResult
from workbench.analysis.lin.task import Width, make_task
from workbench.core.operating_point import At, OperatingPoint
from workbench.errors import InputError, SimulationError, suggest
from workbench.model import DescribedModel, Model
from workbench.model.placing import find_point
from workbench.origin import Reportable, with_origin
from workbench.signals import Signal
from workbench.store import Store
from workbench.workers import Lost, Reply, Workers, choose

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["LinGrid", "LinPoint", "lin_along", "lin_over"]

# To be raised whenever a change of the code changes a result: stored results of both are not mixed.
_ALGORITHM = 1


@dataclass(frozen=True, eq=False)
class LinPoint:
    """One member of an array of linear models.

    Attributes:
        values: what was varied → value there.
        result: the linear model; None where it failed.
        reason: why it failed, one line; None where it did not.
    """

    values: dict[str, float]
    result: LinResult | None
    reason: str | None = None


@dataclass(frozen=True, eq=False)
class LinGrid(Reportable):
    """An array of linear models.

    Attributes:
        over: what was varied → values; the last one varies fastest in `points`.
        points: one for each combination.
    """

    over: dict[str, tuple[float, ...]]
    points: tuple[LinPoint, ...]

    @property
    def failed(self) -> tuple[LinPoint, ...]:
        """The points without a model."""
        return tuple(p for p in self.points if p.result is None)

    def plot(self, path: str | Path | None = None) -> Figure:
        """Return a Bode picture of the first input and output, one curve per model.

        Args:
            path: also write it here; png, svg or pdf by suffix.
        """
        from workbench.plotting.lin import plot_curves  # noqa: PLC0415  matplotlib is slow

        named = [(_label(p.values), p.result) for p in self.points if p.result is not None]
        return plot_curves(named, path)

    def to_dict(self) -> dict[str, Any]:
        """Return plain lists and numbers, ready for JSON."""
        return {
            "over": {name: list(values) for name, values in self.over.items()},
            "systems": [{"values": p.values, **(p.result.to_dict() if p.result else {})} for p in self.points],
            "failed": [{**p.values, "reason": p.reason} for p in self.failed],
        }


def _label(values: Mapping[str, float]) -> str:
    return ", ".join(f"{name} = {value:g}" for name, value in values.items())


@dataclass(frozen=True, kw_only=True)
class _Job:
    """One linearisation, for a worker process."""

    varied: dict[str, float]
    parameters: dict[str, float]
    method: str
    options: dict[str, Any]


@with_origin()
def lin_over(
    model: Model,
    over: Mapping[str, Sequence[float]],
    *,
    at: At | None = None,
    x0: Mapping[str, float] | None = None,
    u0: Mapping[str, float] | None = None,
    dx: Width = None,
    du: Width = None,
    method: str = "auto",
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
    time: float | None = None,
    period: float | None = None,
    jobs: int = 1,
    store: str | Path | None = None,
    progress: Callable[[LinPoint, int, int], None] | None = None,
) -> LinGrid:
    """Linearise at every combination of parameters, inputs or states.

    The point is not trimmed anew: where the equilibrium moves with what is varied, trim first and
    linearise each point with `lin`.

    Args:
        model: what to linearise; it stays open.
        over: parameter, input or state → values.
        at: see `lin`.
        x0: see `lin`.
        u0: see `lin`.
        dx: see `lin`.
        du: see `lin`.
        method: see `lin`.
        inputs: see `lin`.
        outputs: see `lin`.
        time: see `lin`.
        period: see `lin`.
        jobs: worker processes at a time; 1: in this process.
        store: folder for finished models; the same call continues where it was stopped.
        progress: called after each point with it, the number done and the number in all.

    Raises:
        InputError: nothing to vary, unknown name, or a store for a model that is not a file.
        FmuError: the model cannot be opened.
    """
    grid = {name: tuple(float(v) for v in values) for name, values in over.items()}
    _check(model, grid)
    begin = find_point(model, at)[0] or OperatingPoint(x={}, u={}, time=model.start_time)
    settings: dict[str, Any] = {
        "x0": {**begin.x, **begin.discrete, **(x0 or {})}, "u0": {**begin.u, **(u0 or {})}, "dx": dx, "du": du,
        "inputs": inputs, "outputs": outputs, "time": begin.time if time is None else time, "period": period,
    }  # fmt: skip
    jobs_todo = [_job(model, dict(zip(grid, values, strict=True)), method, settings)
                 for values in itertools.product(*grid.values())]  # fmt: skip
    found: dict[str, LinPoint] = {}
    with _open_store(store, model, method, settings) as kept:
        for point in _all(model, jobs_todo, jobs, kept):
            found[_label(point.values)] = point
            if progress is not None:
                progress(point, len(found), len(jobs_todo))
    return LinGrid(grid, tuple(found[_label(j.varied)] for j in jobs_todo))


def _check(model: Model, grid: Mapping[str, tuple[float, ...]]) -> None:
    known = [v.name for v in (*model.parameters, *model.inputs, *model.states) if v.is_number]
    if not grid or not all(grid.values()):
        raise InputError("over: nothing to vary; give NAME=value,value,…")
    for name in grid:
        if name not in known:
            raise InputError(f"over: '{name}' is no parameter, input or state; {suggest(name, known)}")
    if model.recipe is None and any(n in {p.name for p in model.parameters} for n in grid):
        raise InputError(f"over: the parameters of {model.name} cannot be set, it is not a file")


def _job(model: Model, varied: dict[str, float], method: str, settings: Mapping[str, Any]) -> _Job:
    inputs, states = {v.name for v in model.inputs}, {v.name for v in model.states}
    options = dict(settings)
    options["u0"] = {**settings["u0"], **{n: v for n, v in varied.items() if n in inputs}}
    options["x0"] = {**settings["x0"], **{n: v for n, v in varied.items() if n in states}}
    parameters = {n: v for n, v in varied.items() if n not in inputs | states}
    return _Job(varied=varied, parameters=parameters, method=method, options=options)


def _all(model: Model, todo: Sequence[_Job], jobs: int, kept: Store | None) -> Iterator[LinPoint]:
    """Yield every point: those on disk, then those that are made now, each on disk before the next."""
    done = kept.load() if kept is not None else {}
    for job in todo:
        if _label(job.varied) in done:
            yield LinPoint(job.varied, LinResult.from_dict(done[_label(job.varied)]))
    queue = deque(j for j in todo if _label(j.varied) not in done)
    workers = Workers(in_process=True) if jobs == 1 else Workers(jobs=jobs)
    runner, _ = choose(model, workers)
    with runner:
        for answer in runner.run(linearise_one, queue):
            point = _point(answer)
            if kept is not None and point.result is not None:
                kept.save(_label(point.values), point.result.to_dict())
            yield point


def _point(answer: Reply | Lost) -> LinPoint:
    if isinstance(answer, Lost):
        return LinPoint(answer.job.varied, None, answer.reason)
    point: LinPoint = answer.value
    return point


def linearise_one(model: Model, job: _Job) -> Iterator[LinPoint]:
    """Linearise one point of a grid; what a worker process runs."""
    with with_parameters(model, job.parameters) as varied:
        try:
            yield LinPoint(job.varied, run(make_task(varied, at=None, **job.options), job.method))
        except SimulationError as error:
            yield LinPoint(job.varied, None, str(error))


def with_parameters(model: Model, parameters: Mapping[str, float]) -> AbstractContextManager[Model]:
    """Return the model with other parameters, a new one if there are any.

    Raises:
        InputError: the model is no file.
    """
    if not parameters:
        return nullcontext(model)
    if not isinstance(model, DescribedModel):
        raise InputError(f"over: the parameters of {model.name} cannot be set")
    return replace(model.recipe, start_values={**model.recipe.start_values, **parameters}).open()


def _open_store(
    store: str | Path | None, model: Model, method: str, settings: Mapping[str, Any]
) -> Store | nullcontext[None]:
    if store is None:
        return nullcontext()
    if model.recipe is None:
        raise InputError(f"store: {model.name} is no file; its results cannot be told from another model's")
    subject = {
        "analysis": "lin",
        "algorithm": _ALGORITHM,
        "workbench": __version__,
        "model": model.recipe.identity(),
        "interface": model.interface,
        "method": method,
        **settings,
    }
    return Store(store, subject=subject, effort={})


@with_origin()
def lin_along(
    model: Model,
    times: Sequence[float],
    *,
    signals: Mapping[str, Signal] | None = None,
    dx: Width = None,
    du: Width = None,
    method: str = "auto",
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
    period: float | None = None,
) -> LinGrid:
    """Linearise along a simulation: at each time about the states and inputs the model has then.

    The models describe small deviations from the path, not from an equilibrium. Integer and Boolean modes of
    the model are carried over as far as the FMU lets them be started elsewhere.

    Args:
        model: what to simulate and linearise; it stays open.
        times: rising [s].
        signals: forced inputs; the others keep their start values.
        dx: see `lin`.
        du: see `lin`.
        method: see `lin`.
        inputs: see `lin`.
        outputs: see `lin`.
        period: see `lin`.

    Raises:
        InputError: times that do not rise, unknown input.
        FmuError, SimulationError: the model cannot be run or evaluated.
    """
    listed = [float(t) for t in times]
    if not listed or listed[0] < 0.0 or any(b <= a for a, b in itertools.pairwise(listed)):
        raise InputError("snapshot: the times must rise from 0 on")
    forced = dict(signals or {})
    points = []
    with model.open_session(signals=forced) as session:
        names = _standing_names(model)
        for time in listed:
            session.advance(time, signals=forced)
            session.advance(time, signals=forced)  # the right limit
            values = session.values(names)
            task = make_task(
                model, at=None, x0=None, u0=None, inputs=inputs, outputs=outputs, time=time, dx=dx, du=du, period=period
            )
            points.append(LinPoint({"time": time}, run(replace(task, values=values), method)))
    return LinGrid({"time": tuple(listed)}, tuple(points))


def _standing_names(model: Model) -> list[str]:
    """Return what makes up where a model stands: states, discrete states, inputs."""
    discrete = list[str]()
    if model.interface == "me":
        with model.open_point() as point:
            discrete = list(point.discrete())
    numeric = [v.name for v in (*model.states, *model.inputs) if v.is_number]
    return list(dict.fromkeys([*numeric, *discrete]))

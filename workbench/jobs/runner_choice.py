"""Which runner an analysis gets: one table."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from workbench.errors import InputError
from workbench.jobs.confine import confined
from workbench.jobs.job import Job
from workbench.jobs.limits import cores, memory_limit_works
from workbench.jobs.options import Limits, Workers
from workbench.jobs.pool import Pool
from workbench.jobs.runner import InProcess, Runner
from workbench.model.base import Recipe

if TYPE_CHECKING:
    from workbench.model.base import Model

__all__ = ["at_work", "choose", "runner_for"]

_ALONE = "a confined process begins no others: the parts of this analysis ran one after the other, whatever `jobs` says"


@contextmanager
def at_work(
    model: Model, workers: Workers, job: Job, *, numbers: Callable[[Sequence[Any]], Any] | None = None
) -> Iterator[Runner]:
    """Enter what runs the tasks; the job ends them, and gets what the user should know of how they ran.

    Args:
        model: what the tasks get.
        workers: what was asked for.
        job: whose tasks they are.
        numbers: of the items of a task: where several worker processes do ten or more, one task is done in two of them,
            and the job notes if these differ.

    Raises:
        InputError: the cluster cannot be reached; the model cannot be confined.
    """
    runner, notes = choose(model, workers)
    job.notes += notes
    runner.numbers = numbers
    try:
        with runner, job.ended_by(runner.stop):
            yield runner
    finally:
        job.notes += runner.remarks()


def choose(model: Model, workers: Workers) -> tuple[Runner, tuple[str, ...]]:
    """Return what runs the tasks, and remarks for the user.

    | asked for                         | model with a recipe (an FMU)   | without one (Python, only in this process) |
    |-----------------------------------|--------------------------------|--------------------------------------------|
    | nothing, or a number of jobs      | `Pool` of worker processes     | `InProcess`                                |
    | `in_process`, or in a confined one | `InProcess`                   | `InProcess`                                |
    | an executor                       | `OnExecutor`                   | `InProcess`, with a remark                 |
    | a scheduler                       | `OnCluster`                    | `InProcess`, with a remark                 |

    Args:
        model: what the tasks get.
        workers: what was asked for.

    Raises:
        InputError: the cluster cannot be reached; the model cannot be confined.
    """
    place = _place(workers)
    if model.recipe is None or not model.recipe.portable:
        if workers.confine:
            raise InputError(f"confine: not possible: {model.name} exists only in this process")
        return InProcess(model), _without_recipe(model, place, workers)
    if place == "here":
        alone = confined() and (workers.jobs or 1) > 1
        return InProcess(model), (_ALONE,) if alone else ()
    notes = _memory_note(workers) if place == "workers" else ()
    return _MAKE[place](model.recipe, workers), notes


def runner_for(workers: Workers) -> Runner:
    """Return what runs tasks that have no model.

    Args:
        workers: what was asked for.

    Raises:
        InputError: the cluster cannot be reached.
    """
    place = _place(workers)
    return InProcess(None) if place == "here" else _MAKE[place](None, workers)


def _place(workers: Workers) -> str:
    here = workers.in_process or confined()  # such a process cannot begin another
    places = {"here": here, "executor": workers.executor, "scheduler": workers.scheduler}
    return next((place for place, wanted in places.items() if wanted), "workers")


def _pool(recipe: Recipe | None, workers: Workers) -> Runner:
    return Pool(recipe, jobs=workers.jobs or cores(), limits=workers.limits)


def _on_executor(recipe: Recipe | None, workers: Workers) -> Runner:
    from workbench.jobs.executor import OnExecutor  # noqa: PLC0415 - seldom needed

    if workers.executor is None:
        raise InputError("executor: none given")
    return OnExecutor(workers.executor, recipe)


def _on_cluster(recipe: Recipe | None, workers: Workers) -> Runner:
    from workbench.jobs.cluster import Cluster, OnCluster  # noqa: PLC0415 - seldom needed

    return OnCluster(Cluster.at(workers), recipe, limits=workers.limits)


_MAKE: dict[str, Callable[[Recipe | None, Workers], Runner]] = {
    "executor": _on_executor,
    "scheduler": _on_cluster,
    "workers": _pool,
}


def _without_recipe(model: Model, place: str, workers: Workers) -> tuple[str, ...]:
    if place in ("executor", "scheduler"):
        return (f"{model.name} exists only in this process and runs here, not on the {place}",)
    if place == "workers" and workers.limits != Limits():
        return (f"{model.name} exists only in this process: time and memory limits do not apply",)
    return ()


def _memory_note(workers: Workers) -> tuple[str, ...]:
    if workers.limits.memory is None or memory_limit_works():
        return ()
    return ("this platform enforces no memory limit; `memory_limit` has no effect",)

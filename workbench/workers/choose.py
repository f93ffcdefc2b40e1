"""Which runner an analysis gets: one table."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import TYPE_CHECKING

from workbench.errors import InputError
from workbench.model.recipe import Recipe
from workbench.workers.limits import DEFAULT_TIMEOUT, Limits, memory_limit_works
from workbench.workers.pool import Pool
from workbench.workers.runner import InProcess, Runner

if TYPE_CHECKING:
    from workbench.model.base import Model

__all__ = ["Workers", "choose", "cores"]


@dataclass(frozen=True, kw_only=True)
class Workers:
    """Where and under which limits an analysis runs its FMU.

    Attributes:
        jobs: most worker processes at a time; None: as many as cores.
        in_process: run in this process, one after the other: for debugging, and for FMUs that are trusted.
        timeout: longest time for one result [s]; None: any. For worker processes only.
        memory_limit: how much an FMU may allocate [MB]; None: any. For worker processes only.
        executor: anything that is a `concurrent.futures.Executor`, in place of worker processes.
        scheduler: address of a Dask scheduler, in place of worker processes.

    Raises:
        InputError: fewer than one job, or two places at once.
    """

    jobs: int | None = None
    in_process: bool = False
    timeout: float | None = DEFAULT_TIMEOUT
    memory_limit: float | None = None
    executor: Executor | None = None
    scheduler: str | None = None

    @property
    def limits(self) -> Limits:
        """Time and memory limit together."""
        return Limits(timeout=self.timeout, memory=self.memory_limit)

    def __post_init__(self) -> None:
        if self.jobs is not None and self.jobs < 1:
            raise InputError(f"jobs: {self.jobs} is too few; take at least 1")
        if self.in_process and (self.jobs or 1) > 1:
            raise InputError(f"in process runs one point after the other; it cannot have {self.jobs} jobs")
        places = {"in process": self.in_process, "an executor": self.executor, "a scheduler": self.scheduler}
        asked = [name for name, wanted in places.items() if wanted]
        if len(asked) > 1:
            raise InputError(f"{' and '.join(asked)}: only one place can run the points")
        limits = self.limits
        if asked and limits != Limits():
            raise InputError(f"{asked[0]}: time and memory limits need the workbench's own worker processes")


def choose(model: Model, workers: Workers) -> tuple[Runner, tuple[str, ...]]:
    """Return what runs the tasks, and remarks for the user.

    | asked for                         | model with a recipe (an FMU)   | without one (Python, only in this process) |
    |-----------------------------------|--------------------------------|--------------------------------------------|
    | nothing, or a number of jobs      | `Pool` of worker processes     | `InProcess`                                |
    | `in_process`                      | `InProcess`                    | `InProcess`                                |
    | an executor                       | `OnExecutor`                   | `InProcess`, with a remark                 |
    | a scheduler                       | `OnCluster`                    | `InProcess`, with a remark                 |

    Args:
        model: what the tasks get.
        workers: what was asked for.

    Raises:
        InputError: the cluster cannot be reached.
    """
    place = _place(workers)
    if model.recipe is None or not model.recipe.portable:
        return InProcess(model), _without_recipe(model, place, workers)
    if place == "here":
        return InProcess(model), ()
    notes = _memory_note(workers) if place == "workers" else ()
    return _MAKE[place](model.recipe, workers), notes


def _place(workers: Workers) -> str:
    asked = {"here": workers.in_process, "executor": workers.executor, "scheduler": workers.scheduler}
    return next((place for place, wanted in asked.items() if wanted), "workers")


def _pool(recipe: Recipe, workers: Workers) -> Runner:
    return Pool(recipe, jobs=workers.jobs or cores(), limits=workers.limits)


def _on_executor(recipe: Recipe, workers: Workers) -> Runner:
    from workbench.workers.executor import OnExecutor  # noqa: PLC0415 - seldom needed

    if workers.executor is None:
        raise InputError("executor: none given")
    return OnExecutor(workers.executor, recipe)


def _on_cluster(recipe: Recipe, workers: Workers) -> Runner:
    from workbench.workers.cluster import OnCluster  # noqa: PLC0415 - seldom needed

    return OnCluster(workers.scheduler or "", recipe)


_MAKE: dict[str, Callable[[Recipe, Workers], Runner]] = {
    "executor": _on_executor,
    "scheduler": _on_cluster,
    "workers": _pool,
}


def _without_recipe(model: Model, place: str, workers: Workers) -> tuple[str, ...]:
    if place in ("executor", "scheduler"):
        return (f"{model.name} lives in this process only and runs here, not on the {place}",)
    if place == "workers" and workers.limits != Limits():
        return (f"{model.name} lives in this process only: time and memory limits do not apply",)
    return ()


def _memory_note(workers: Workers) -> tuple[str, ...]:
    if workers.limits.memory is None or memory_limit_works():
        return ()
    return ("this platform enforces no memory limit; --memory-limit has no effect",)


def cores() -> int:
    """Return the number of cores that this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not on macOS and Windows
        return os.cpu_count() or 1

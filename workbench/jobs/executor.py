"""Tasks on any `concurrent.futures.Executor`: threads, processes, MPI, a cluster."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from typing import TYPE_CHECKING, Any

from workbench.errors import LostError, OutOfMemoryError, WorkbenchError
from workbench.jobs.runner import Lost, Reply, Runner
from workbench.jobs.worker_main import Task

if TYPE_CHECKING:
    from workbench.model.base import Model, Recipe

__all__ = ["OnExecutor", "run_to_end"]

_PATIENCE = 0.1

# As many tasks are with the executor at a time: enough for its workers, few enough to stop soon.
_AHEAD = 64

_opened = threading.local()


def run_to_end(recipe: Recipe | None, task: Task, job: Any) -> list[Any]:  # noqa: ANN401 - any task's
    """Do one task wherever this is called; the model stays open for the next call in the same thread."""
    return list(task(None if recipe is None else _model(recipe), job))


def _model(recipe: Recipe) -> Model:
    kept: tuple[Recipe, Model] | None = getattr(_opened, "kept", None)
    if kept is not None and kept[0] == recipe:
        return kept[1]
    if kept is not None:
        kept[1].close()
    _opened.kept = None
    model = recipe.open()
    _opened.kept = (recipe, model)
    return model


class OnExecutor(Runner):
    """Runs tasks on an executor that somebody else owns.

    The executor must be able to read the FMU's unpacked folder (same machine or shared file system)
    unless the recipe is packed. It decides about crashes: after one, a `ProcessPoolExecutor` is broken
    and all further points fail with that reason. There is no time limit. The items of a job come
    together, at its end.

    Args:
        executor: it stays open.
        recipe: of the model; None: the tasks have none.
    """

    def __init__(self, executor: Executor, recipe: Recipe | None) -> None:
        self._executor, self._recipe = executor, recipe
        self._pending: dict[Future[list[Any]], Any] = {}

    def run(self, task: Task, jobs: deque[Any]) -> Iterator[Reply | Lost]:
        try:
            while jobs or self._pending:
                yield from self._submit(task, jobs)
                for future in self._finished():
                    job = self._pending.pop(future)
                    yield from _outcome(future, job)
        finally:
            self.close()

    def _submit(self, task: Task, jobs: deque[Any]) -> Iterator[Lost]:
        while jobs and len(self._pending) < _AHEAD:
            job = jobs.popleft()
            try:
                self._pending[self._executor.submit(run_to_end, self._recipe, task, job)] = job
            except BrokenExecutor as error:
                yield Lost(job, _broken(error))

    def _finished(self) -> list[Future[list[Any]]]:
        while self._pending:
            done = [f for f in self._pending if f.done()] or list(_wait(self._pending))
            if self.stopped:
                raise KeyboardInterrupt
            if done:
                return done
        return []

    def close(self) -> None:
        for future in self._pending:
            future.cancel()
        self._pending = {}


def _wait(pending: dict[Future[list[Any]], Any]) -> set[Future[list[Any]]]:
    if all(isinstance(f, Future) for f in pending):
        return wait(pending, timeout=_PATIENCE, return_when=FIRST_COMPLETED).done
    time.sleep(_PATIENCE)  # an executor with futures of its own kind
    return set()


def _outcome(future: Future[list[Any]], job: Any) -> Iterator[Reply | Lost]:  # noqa: ANN401 - any task's
    try:
        values = future.result()
    except WorkbenchError:
        raise
    except BrokenExecutor as error:
        yield Lost(job, _broken(error))
    except MemoryError:
        yield Lost(job, OutOfMemoryError("out of memory on the executor"))
    except Exception as error:  # noqa: BLE001 - what an executor raises for a dead worker is its own affair
        yield Lost(job, LostError(f"the executor lost the task: {type(error).__name__}: {error}"))
    else:
        yield from (Reply(job, value) for value in values)


def _broken(error: BaseException) -> LostError:
    return LostError(f"the executor is broken, perhaps by a crash of the FMU: {error}")

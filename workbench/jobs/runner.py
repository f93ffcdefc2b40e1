"""Pieces of work on a model, and what runs them, here or elsewhere."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, get_args, get_type_hints

from workbench.core.machine.closable import Closable
from workbench.errors import LostError
from workbench.jobs.worker_main import Task

if TYPE_CHECKING:
    from workbench.model.base import Model

__all__ = ["InProcess", "Lost", "Remark", "Reply", "Runner", "WorkItem", "perform", "yielded"]


@dataclass(frozen=True)
class Remark:
    """Something found out on the way that the user should know."""

    text: str


class WorkItem(ABC):
    """A piece of work on a model that knows how to be done; picklable, as are its results."""

    @abstractmethod
    def run(self, model: Model) -> Iterator[Any]:
        """Yield the results as they are finished."""


def perform(model: Model, job: WorkItem) -> Iterator[Any]:
    """Do a job: the task that is handed to a `Runner` with a queue of jobs."""
    return job.run(model)


def yielded(task: Task, job: object) -> Any:  # noqa: ANN401 - a type
    """Return the type of the items that a task declares to yield for a job."""
    return _declared(type(job).run if isinstance(job, WorkItem) else task)


@lru_cache
def _declared(function: Callable[..., Iterator[Any]]) -> Any:  # noqa: ANN401 - as above
    (item,) = get_args(get_type_hints(function)["return"])
    return item


@dataclass(frozen=True)
class Reply:
    """One item that a task yielded.

    Attributes:
        job: the task's argument, the very object.
        value: the item.
    """

    job: Any
    value: Any


@dataclass(frozen=True)
class Lost:
    """A task that did not come to its end: its process crashed, hung, or ran out of memory.

    Attributes:
        job: the task's argument, the very object; items may have come before.
        error: how.
    """

    job: Any
    error: LostError

    @property
    def reason(self) -> str:
        """How, in one line."""
        return str(self.error)

    @property
    def kind(self) -> str:
        """What went wrong, see `WorkbenchError.kind`."""
        return self.error.kind


class Runner(Closable):
    """Runs one function on a model for many arguments.

    Obligations of a subclass:
      1. `run` begins the jobs in their order, gives the items of one job in order, and takes jobs
         that the caller appends to the queue meanwhile.
      2. An exception of the task ends `run` and is raised by it; a crash is a `Lost` and the next job is done.
      3. The next job is begun only after the caller has taken the items before it: what the caller
         writes to disk is there before that.
      4. After `stop` (which a signal handler may call) `run` raises KeyboardInterrupt soon.
      5. `close` ends everything that runs; any number of times.
    """

    stopped = False
    printed = ""  # by the FMU itself, besides the log that FMI has
    stray = 0  # bytes that it wrote into what is not its own
    afterwards: Sequence[str] = ()  # what went wrong when all was told
    numbers: Callable[[Sequence[Any]], Any] | None = None  # of the items of a job: what two processes must agree in

    def remarks(self) -> list[str]:
        """Return what went wrong when all was told, and what the FMU printed, in a line."""
        lines = ["".join(c if c.isprintable() else " " for c in line).strip() for line in self.printed.splitlines()]
        lines = [line for line in lines if line]
        many = f"the FMU printed {len(lines)} lines; the last: " if lines[1:] else "the FMU printed: "
        stray = [f"the FMU wrote {self.stray} bytes into a file that is not its own"] if self.stray else []
        return [*dict.fromkeys(self.afterwards), *stray, *(many + line for line in lines[-1:])]

    @abstractmethod
    def run(self, task: Task, jobs: deque[Any]) -> Iterator[Reply | Lost]:
        """Do `task(model, job)` for all jobs.

        Args:
            task: a generator function of a model and a job; picklable, so a module's.
            jobs: arguments; taken from the left.

        Raises:
            WorkbenchError: raised by the task, or the model cannot be opened.
            KeyboardInterrupt: after `stop`.
        """

    def stop(self) -> None:
        """Let `run` end."""
        self.stopped = True

    def end_soon(self) -> None:
        """Let the jobs under way end with what they have, where they can, then `run`; a signal handler may call it."""
        self.stop()


class InProcess(Runner):
    """Runs tasks one after the other in this process: nothing survives a crash.

    Args:
        model: what the tasks get; it stays open; None: they need none.
    """

    def __init__(self, model: Model | None) -> None:
        self._model = model

    def run(self, task: Task, jobs: deque[Any]) -> Iterator[Reply | Lost]:
        while jobs:
            job = jobs.popleft()
            for value in task(self._model, job):
                yield Reply(job, value)
            if self.stopped:
                raise KeyboardInterrupt

    def close(self) -> None:
        return

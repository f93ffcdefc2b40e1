"""A piece of work that knows how to be done."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from workbench.model.base import Model

__all__ = ["Job", "Remark", "perform"]


@dataclass(frozen=True)
class Remark:
    """Something found out on the way that the user should know."""

    text: str


class Job(ABC):
    """A piece of work on a model; picklable, as are its results."""

    @abstractmethod
    def run(self, model: Model) -> Iterator[Any]:
        """Yield the results as they are finished."""


def perform(model: Model, job: Job) -> Iterator[Any]:
    """Do a job: the task that is handed to a `Runner` with a queue of jobs."""
    return job.run(model)

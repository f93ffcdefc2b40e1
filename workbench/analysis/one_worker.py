"""A request that runs as a whole in one worker process."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, TypeVar

from workbench.analysis.request import Analysis
from workbench.core import job as telling
from workbench.core.option import values_of
from workbench.core.where import Worker, Workers
from workbench.errors import SimulationError
from workbench.model import Model
from workbench.workers import Job, Reply, choose, perform

__all__ = ["in_worker"]

_Record = TypeVar("_Record")


@dataclass(frozen=True, kw_only=True)
class _Whole(Job):
    """A request for a worker."""

    asked: Analysis[Any]

    def run(self, model: Model) -> Iterator[Any]:
        yield self.asked.run(model, telling.Job())


def in_worker(model: Model, asked: Analysis[_Record], where: Worker, job: telling.Job) -> _Record:
    """Run a request where a crash of the FMU ends in an error.

    Args:
        model: what is analysed.
        asked: the analysis.
        where: under which limits.
        job: can stop it.

    Raises:
        WorkbenchError: what the analysis raises.
        SimulationError: the worker crashed or met a limit.
    """
    runner, _ = choose(model, Workers(**{**values_of(where), "jobs": 1}))
    try:
        with runner, job.ended_by(runner.stop):
            event = next(iter(runner.run(perform, deque([_Whole(asked=asked)]))))
    except SimulationError as error:
        before = error.before  # nothing is lost
        job.partial = lambda: before
        raise
    if not isinstance(event, Reply):
        raise SimulationError(event.reason)
    record: _Record = event.value
    return record

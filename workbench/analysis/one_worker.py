"""A request that runs as a whole in one worker process: what it tells comes back as if it ran here."""

from __future__ import annotations

import time
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
from workbench.session.pauses import at_pauses
from workbench.workers import InProcess, Job, Reply, choose, perform
from workbench.workers.child import tell, wanted_stop

__all__ = ["in_worker"]

_OFTEN = 0.1  # [s]: progress is told no more often

_Record = TypeVar("_Record")


@dataclass(frozen=True)
class _Told:
    """What a job tells on its way."""

    what: str
    done: int
    total: int


@dataclass(frozen=True)
class _Stopped:
    """What there was when a job was stopped."""

    partial: object


@dataclass(frozen=True, kw_only=True)
class _Whole(Job):
    """A request for a worker."""

    asked: Analysis[Any]

    def run(self, model: Model) -> Iterator[Any]:
        last = time.monotonic()

        def progress(what: object, done: int, total: int) -> None:
            nonlocal last
            if done == total or time.monotonic() > last + _OFTEN:
                last = time.monotonic()
                tell(_Told(str(what), done, total))

        job = telling.Job(progress)
        try:
            with at_pauses(_stop_if_wanted):
                record = self.asked.run(model, job)
        except KeyboardInterrupt:
            record = _Stopped(job.partial())
        except SimulationError as error:
            error.before = job.partial()  # nothing is lost
            raise
        yield record


def _stop_if_wanted(_: float) -> None:
    if wanted_stop():
        raise KeyboardInterrupt


def in_worker(model: Model, asked: Analysis[_Record], where: Worker, job: telling.Job) -> _Record:
    """Run a request where a crash of the FMU ends in an error.

    Args:
        model: what is analysed.
        asked: the analysis.
        where: under which limits.
        job: is told what is finished, and has what there is if the request ends early.

    Raises:
        WorkbenchError: what the analysis raises.
        SimulationError: the worker crashed or met a limit.
        KeyboardInterrupt: the job was stopped.
    """
    runner, _ = choose(model, Workers(**{**values_of(where), "jobs": 1}))
    if isinstance(runner, InProcess):
        return asked.run(model, job)
    try:
        with runner, job.ended_by(runner.end_soon):
            found = _heard(runner.run(perform, deque([_Whole(asked=asked)])), job)
    except SimulationError as error:
        before = error.before
        job.partial = lambda: before
        raise
    if isinstance(found, _Stopped):
        job.partial = lambda: found.partial
        raise KeyboardInterrupt
    record: _Record = found
    return record


def _heard(events: Iterator[Any], job: telling.Job) -> Any:  # noqa: ANN401 - the record, or what there was
    """Pass on what the worker tells until it has a result."""
    for event in events:
        if not isinstance(event, Reply):
            raise SimulationError(event.reason)
        if not isinstance(event.value, _Told):
            return event.value
        job.done(event.value.what, event.value.done, event.value.total)
    raise SimulationError("the worker ended without a result")

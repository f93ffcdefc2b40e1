"""A request that runs as a whole in one worker process: what it tells comes back as if it ran here."""

from __future__ import annotations

import pickle
import time
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, TypeVar

from workbench.core.records.named import named
from workbench.errors import InputError, LostError, SimulationError
from workbench.jobs import job as telling
from workbench.jobs.options import InWorker, Worker
from workbench.jobs.pool import Pool
from workbench.jobs.runner import Reply
from workbench.jobs.worker_main import inside, tell, wanted_stop
from workbench.model import Model
from workbench.model.base import Recipe
from workbench.requests.kept import origin_of, remember
from workbench.requests.origin import Origin
from workbench.requests.request import Request, record_of
from workbench.session.pauses import at_pauses

__all__ = ["in_worker"]

_OFTEN = 0.1  # [s]: progress is told no more often
_WORTH = 0.05  # of its time a worker spends on telling what there is so far

_Record = TypeVar("_Record")


@dataclass(frozen=True)
class _Told:
    """What a job tells on its way.

    Attributes:
        what, done, total: see `Job.done`.
        partial: what there is so far, should the worker be lost; None: nothing, or nothing new.
        checking: what is still done once that is the whole answer, see `Job.checking`.
    """

    what: str
    done: int
    total: int
    partial: object
    checking: str = ""


@dataclass(frozen=True)
class _Said:
    """What is of use only while a job runs, see `Job.say`."""

    words: str


@dataclass(frozen=True)
class _RequestEnded:
    """What a request gave, or what there was when it was stopped.

    Attributes:
        record: of the request.
        origin: that the algorithm gave it.
        notes: on how it ran.
        stopped: whether it was.
    """

    record: object
    origin: Origin | None
    notes: tuple[str, ...]
    stopped: bool = False


@dataclass(frozen=True)
class _WholeRequest:
    """A request for a worker.

    Attributes:
        asked: what is asked for.
        subject: what it is run on; None: the worker's model.
    """

    asked: Request[Any, Any]
    subject: object

    def __reduce__(self) -> tuple[Any, ...]:
        return _whole, (self.asked, self.subject)


def _whole(request: Request[Any, Any], subject: object) -> _WholeRequest:
    """Read a request in a worker, with what it takes to do it: that is not on the FMU's time."""
    named(request.algorithm)
    return _WholeRequest(request, subject)


def _perform(model: Model | None, whole: _WholeRequest) -> Iterator[_RequestEnded | _Told | _Said]:
    """Run a request in a worker."""
    begun = last = time.monotonic()
    most, spent = 0, 0.0

    def progress(what: object, done: int, total: int) -> None:
        nonlocal last, most, spent
        now = time.monotonic()
        if done == total or now > last + _OFTEN:
            worth = bool(job.checking) or (done > most and spent < _WORTH * (now - begun))
            event = _Told(str(what), done, total, job.partial() if worth else None, job.checking)
            tell(event, finished=done > most and not whole.asked.undivided)
            last, most = time.monotonic(), done
            spent += last - now
            stop_if_wanted()

    def stop_if_wanted(_: float = 0.0) -> None:
        if wanted_stop():
            job.stop()

    job, stopped = telling.Job(progress), False
    job.say = lambda words: tell(_Said(words), finished=False)
    try:
        with at_pauses(stop_if_wanted):
            record = _here(model if whole.subject is None else whole.subject, whole.asked, job)
            stopped = job.stopped
    except KeyboardInterrupt:
        record, stopped = job.partial(), True
    except SimulationError as error:
        error.before = job.partial()  # nothing is lost
        raise
    yield _RequestEnded(record, origin_of(record), tuple(job.notes), stopped)


def in_worker(subject: Any, request: Request[Any, _Record], job: telling.Job) -> _Record:  # noqa: ANN401 - the request's
    """Run a request where a crash of the FMU ends in an error.

    Args:
        subject: model, or what else the request is run on.
        request: what is asked for.
        job: is told what is finished, and has what there is if the request ends early.

    Raises:
        WorkbenchError: what the request raises.
        LostError: the worker crashed or met a limit.
        InputError: it is to be confined, which is not possible.
        KeyboardInterrupt: the job was stopped.
    """
    place = request.place if isinstance(request, InWorker) else Worker()
    if place.in_process or inside(place.limits):
        return _here(subject, request, job)
    recipe = subject.recipe if isinstance(subject, Model) else None
    if isinstance(subject, Model) and (recipe is None or not recipe.portable):
        _refuse_if(place, f"{subject.name} exists only in this process")
        job.notes.append(f"{subject.name} exists only in this process and runs here, behind no wall")
        return _here(subject, request, job)
    if getattr(request, "store", None) is not None:
        _refuse_if(place, "the process that is confined would have to write the store; leave store out")
    whole = _WholeRequest(replace(request, progress=None), None if recipe is not None else subject)
    if why := _unknown_elsewhere(whole):
        _refuse_if(place, why)
        job.notes.append(f"{why}: the FMU runs in this process, behind no wall")
        return _here(subject, request, job)
    record: _Record = _run(recipe, whole, place, job)
    return record


def _told_by(events: Iterator[Any], whole: _WholeRequest) -> Iterator[Any]:
    """Yield what a worker tells, as long as its records are of the kind that was asked for.

    Raises:
        LostError: the FMU, which shares the worker's memory, told of another.
    """
    kinds = (type(None).__name__, *record_of(type(whole.asked)).split(" | "))
    for event in events:
        value = event.value if isinstance(event, Reply) else None
        record = value.record if isinstance(value, _RequestEnded) else getattr(value, "partial", None)
        if (kind := type(record).__name__) not in kinds:
            raise LostError(f"its worker's answer cannot be read: it is a {kind}, not a {' or '.join(kinds[1:])}")
        yield event


def _refuse_if(place: Worker, why: str) -> None:
    if place.confine:
        raise InputError(f"confine: not possible: {why}")


def _unknown_elsewhere(whole: _WholeRequest) -> str:
    """Return why a request cannot be sent to another process; empty: it can."""
    try:
        pickle.dumps(whole)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        return f"what is asked for cannot be sent to a worker process ({error})"
    return ""


def _run(recipe: Recipe | None, whole: _WholeRequest, place: Worker, job: telling.Job) -> Any:  # noqa: ANN401
    with Pool(recipe, jobs=1, limits=place.limits) as pool, job.ended_by(pool.end_soon):
        try:
            result = _heard(_told_by(pool.run(_perform, deque([whole])), whole), job)
        except SimulationError as error:
            if error.before is not None:
                job.partial = partial(_same, error.before)
            raise
        finally:
            job.notes += pool.remarks()
    job.notes += result.notes
    if result.origin is not None:
        remember(result.record, result.origin)
    if result.stopped:
        job.partial = partial(_same, result.record)
        raise KeyboardInterrupt
    return result.record


def _here(subject: Any, request: Request[Any, _Record], job: telling.Job) -> _Record:  # noqa: ANN401
    """Run a request in this process; once more where its failure showed what lets the FMU go on."""
    run, models = named(request.algorithm), [subject] if isinstance(subject, Model) else []
    known, before = [model.remarks() for model in models], len(job.notes)
    try:
        record: _Record = run(subject, request, job)
    except SimulationError:
        if known == [model.remarks() for model in models]:
            raise
        del job.notes[before:]  # of the run that failed
        record = run(subject, request, job)
    return record


def _same(record: object) -> object:
    return record


def _heard(events: Iterator[Any], job: telling.Job) -> _RequestEnded:
    """Pass on what the worker tells until it has a result and is ready again."""
    result: _RequestEnded | None = None
    whole: _Told | None = None
    for event in events:
        if isinstance(event, Reply) and isinstance(event.value, _RequestEnded):
            result = event.value
        elif isinstance(event, Reply) and isinstance(event.value, _Said):
            job.say(event.value.words)
        elif isinstance(event, Reply):
            progress = event.value
            whole = progress if progress.checking else whole
            if progress.partial is not None:
                job.partial = partial(_same, progress.partial)
            job.done(progress.what, progress.done, progress.total)
        elif result is None and whole is not None:
            result = _RequestEnded(whole.partial, None, (f"{whole.checking} did not finish: {event.reason}",))
        elif result is None:
            raise event.error
        else:
            job.notes.append(f"after the result was there: {event.reason}")
    if result is None:
        raise LostError("the worker ended without a result")
    return result

"""Requests that run for a browser: each in a thread, its FMU in worker processes; what they tell, and their records."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import Any

from workbench.commands import request_of
from workbench.core.records.option import asked_in_json, options_of, values_of
from workbench.core.records.record import plain
from workbench.errors import InputError, WorkbenchError, suggest
from workbench.jobs.job import Job
from workbench.model.loading import Loading
from workbench.requests.origin import Origin
from workbench.requests.request import Request, command_line_of, function
from workbench.ui.forms import OFFERED, in_the_form, request_of_form, without_flags
from workbench.ui.root import ServedFolder

__all__ = ["Desk", "Work"]

_ELSEWHERE = {"workers", "progress"}  # where it runs, and who is told: not what is asked for
_AT_ONCE = 3  # so many run; others wait
_KEPT = 20_000  # events that a browser which comes back is told
_PATIENCE = 2.0  # so long is waited for those that are told to stop [s]

WAITING, RUNNING, DONE, STOPPED, FAILED = "waiting", "running", "done", "stopped", "failed"


class Work:
    """One request, from when it is asked for until its record is there.

    Attributes:
        number: by which the browser knows it.
        asked: the request.
        subject: what it is run on, as the browser names it.
        aside: whether a page asked it beside what a person measures: no list shows it, and no study has it.
        line: the command that does the same.
        state: "waiting", "running", "done", "stopped" or "failed".
        done, total: how far it is.
        points: that were told, ready for JSON.
        notes: remarks.
        failure: what went wrong, `kind`, `message`, and the `field` that it is about, if any; empty: nothing.
        record: what it gave; also what there was when it ended early.
        origin: how the record was made; None: there is none.
        well: whether the record is what was asked for.
        seconds: that it took.
    """

    def __init__(
        self, number: int, asked: Request[Any, Any], loading: Loading, subject: Sequence[str], paths: Sequence[str], *,
        aside: bool = False,
    ) -> None:  # fmt: skip
        self.number, self.asked, self.subject = number, asked, tuple(subject)
        self.aside = aside
        self.state, self.done, self.total = WAITING, 0, 0
        self.points: list[dict[str, Any]] = []
        self.notes: list[str] = []
        self.failure: dict[str, str] = {}
        self.record: Any = None
        self.origin: Origin | None = None
        self.well = True
        self.seconds = 0.0
        self.line = command_line_of(asked, " ".join(subject), loading) if len(subject) == 1 else ""
        self._loading, self._paths = loading, paths
        self._job = Job(self._told)
        self._job.say = lambda text: self._tell("note", text=text)
        self._tell: Callable[..., None] = lambda *_, **__: None

    @property
    def command(self) -> str:
        """Name of the command."""
        return self.asked.command

    @property
    def open(self) -> bool:
        """Whether it has not ended."""
        return self.state in {WAITING, RUNNING}

    @property
    def remarks(self) -> list[str]:
        """What is to be said beside the record, in the words of the form."""
        said = [*(getattr(self.record, "warnings", None) or ()), *self.notes]
        return [without_flags(type(self.asked), text) for text in dict.fromkeys(map(str, said))]

    def listen(self, tell: Callable[..., None]) -> None:
        """Let a function hear what happens: a kind of event, and its facts by name."""
        self._tell = tell

    def keep(self) -> None:
        """Let it be something that a person measured: its record was kept."""
        self.aside = False
        self._change(self.state)

    def stop(self) -> None:
        """Let it end soon, with what there is."""
        if self.state == WAITING:
            self.state = STOPPED
            self._tell("state", state=self.state)
            return
        self._job.stopped = True  # where nothing else ends it, the next thing that it tells does
        with suppress(KeyboardInterrupt):
            self._job.stop()

    def run(self) -> None:
        """Do it, and tell how it ended."""
        if self.state != WAITING:
            return
        from workbench.requests.call import origin_of_call  # noqa: PLC0415 - opens FMUs, which the first page does not

        begin = time.monotonic()
        self._change(RUNNING)
        kind = type(self.asked)
        try:
            given = list(self._paths) if kind.subject.several else self._paths[0]
            with kind.opened(given, self._loading) as (subject, notes):
                self.notes += notes
                self.record = self.asked.run(subject, self._job)
                self.origin = origin_of_call(
                    function(kind), (subject,), self._chosen(), seconds=0.0, result=self.record
                )
            self.well = self.asked.went_well(self.record)
            state = DONE
        except KeyboardInterrupt:
            state = STOPPED
        except WorkbenchError as error:
            field, words = in_the_form(kind, str(error))
            self.failure, state = {"kind": error.kind, "message": words, "field": field}, FAILED
        except Exception as error:  # noqa: BLE001 - a bug of the workbench is told, and ends nothing else
            words = f"{type(error).__name__}: {error}; this is a bug of the workbench"
            self.failure, state = {"kind": "failed", "message": words}, FAILED
        if self.record is None:
            with suppress(WorkbenchError):
                self.record = self._job.partial()
        self.notes += self._job.notes
        self.seconds = round(time.monotonic() - begin, 3)
        self._change(state)

    def _chosen(self) -> dict[str, Any]:
        """Return the options that are not as they are by default."""
        usual = {d.name: d.default for d in options_of(type(self.asked))}
        chosen = {n: v for n, v in values_of(self.asked).items() if not _same(v, usual[n])}
        return {n: v for n, v in chosen.items() if n not in _ELSEWHERE}

    def _change(self, state: str) -> None:
        self.state = state
        self._tell("state", **self.to_dict())

    def _told(self, what: object, done: int, total: int) -> None:
        self.done, self.total = done, total
        to_dict = getattr(what, "to_dict", None)
        point = plain(to_dict()) if to_dict is not None else None
        if point is not None:
            self.points.append(point)
        words, index = (str(what), None) if point is None else ("", len(self.points) - 1)
        self._tell("progress", done=done, total=total, words=words, point=point, index=index)
        if self._job.stopped and done < total:  # else the answer comes at once
            raise KeyboardInterrupt

    def to_dict(self) -> dict[str, Any]:
        """Return what a list shows of it, ready for JSON."""
        return {
            "number": self.number,
            "command": self.command,
            "subject": list(self.subject),
            "aside": self.aside,
            "asked": asked_in_json(self.asked),
            "line": self.line,
            "call": "" if self.origin is None else self.origin.call,
            "state": self.state,
            "done": self.done,
            "total": self.total,
            "counts": self.asked.counts,
            "remarks": self.remarks,
            "failure": self.failure,
            "well": self.well,
            "has_record": self.record is not None,
            "seconds": self.seconds,
        }


def _same(value: object, default: object) -> bool:
    if default is None and isinstance(value, dict):
        default = {}
    return value is default or (isinstance(value, str | int | float | tuple | dict) and value == default)


class Desk:
    """All the work of one server.

    Args:
        root: the folder from which is opened.
    """

    def __init__(self, root: ServedFolder) -> None:
        self.root = root
        self.works: dict[int, Work] = {}
        # What a page asks does not wait for what a person measures.
        self._threads = {a: ThreadPoolExecutor(_AT_ONCE, thread_name_prefix="work") for a in (False, True)}
        self._lock = threading.Lock()
        self._events: deque[dict[str, Any]] = deque(maxlen=_KEPT)
        self._last = 0
        self._listeners: set[Callable[[], None]] = set()

    def begin(self, command: str, subject: Sequence[str], given: Mapping[str, Any], *, aside: bool = False) -> Work:
        """Begin a request.

        Args:
            command: its name.
            subject: models and files, as the browser names them.
            given: what was filled in, see `request_of_form`.
            aside: see `Work`.

        Raises:
            FormError: fields that cannot be used.
            InputError: nothing, or too much, to run it on.
            NotHereError: a file that is not in the folder.
        """
        if command not in OFFERED:
            raise InputError(f"command '{command}' is not offered here; {suggest(command, OFFERED)}")
        kind = request_of(command).subject
        if (not subject and not kind.optional) or (len(subject) > 1 and not kind.several):
            raise InputError(f"{command} takes {'some' if kind.several else 'one'} {kind.metavar}")
        paths = [self.root.find(name) for name in subject]
        request, loading = request_of_form(command, given, self.root)
        with self._lock:
            number = len(self.works) + 1
            work = self.works[number] = Work(number, request, loading, subject, paths, aside=aside)
        work.listen(lambda event, **facts: self._tell(number, event, facts))
        self._tell(number, "state", work.to_dict())
        self._threads[aside].submit(work.run)
        return work

    def _tell(self, number: int, event: str, facts: Mapping[str, Any]) -> None:
        with self._lock:
            self._last += 1
            self._events.append({"id": self._last, "work": number, "event": event, **facts})
            listeners = list(self._listeners)
        for hear in listeners:
            hear()

    @property
    def last(self) -> int:
        """Number of the last event."""
        return self._last

    def since(self, last: int) -> list[dict[str, Any]] | None:
        """Return the events after one; None: some of them are forgotten.

        Args:
            last: its number.
        """
        with self._lock:
            if self._events and last < self._events[0]["id"] - 1:
                return None
            return [event for event in self._events if event["id"] > last]

    def hear(self, listener: Callable[[], None]) -> Callable[[], None]:
        """Let a function, called in any thread, hear of events; return what ends that."""
        with self._lock:
            self._listeners.add(listener)
        return lambda: self._listeners.discard(listener)

    def close(self) -> None:
        """End all that runs."""
        running = [work for work in self.works.values() if work.open]
        for work in running:
            work.stop()
        for threads in self._threads.values():
            threads.shutdown(wait=False, cancel_futures=True)
        until = time.monotonic() + _PATIENCE
        while any(work.state == RUNNING for work in running) and time.monotonic() < until:
            time.sleep(0.02)

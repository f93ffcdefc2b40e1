"""Requests that run for a browser: each in a thread, its FMU in worker processes; what they tell, and their records."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from workbench.core.records.option import asked_in_json, options_of, values_of
from workbench.core.records.record import plain
from workbench.errors import InputError, WorkbenchError, suggest
from workbench.jobs.job import Job
from workbench.model.loading import Loading
from workbench.requests.request import Request, command_line_of, function
from workbench.ui.forms import OFFERED, in_the_form, kind_named, request_of_form
from workbench.ui.kept import Drawer, Shelf, restorable
from workbench.ui.page import headline_of
from workbench.ui.reports import Drawings
from workbench.ui.root import ServedFolder
from workbench.ui.work import DONE, FAILED, RUNNING, STOPPED, WAITING, Work

__all__ = ["Desk", "Task"]

_ELSEWHERE = {"workers", "progress"}  # where it runs, and who is told: not what is asked for
_AT_ONCE = 3  # so many run; others wait
_KEPT = 20_000  # events that a browser which comes back is told
_PATIENCE = 2.0  # so long is waited for those that are told to stop [s]


class Task(Work):
    """Work that this server runs.

    Args:
        number: by which the browser knows it.
        command: its name.
        asked: the request, and how its model is opened.
        subject: what it is run on, as the browser names it.
        paths: the same as a command in the folder would be given.
        store: folder of finished measurements, where the request has none of its own; None: none.
    """

    def __init__(
        self, number: int, command: str, asked: tuple[Request[Any, Any], Loading], subject: Sequence[str], *,
        paths: Sequence[str], store: Path | None = None,
    ) -> None:  # fmt: skip
        super().__init__(number, command, subject)
        self._request, self._loading = asked
        self.asked = asked_in_json(self._request)
        if len(subject) == 1:
            self.line = command_line_of(self._request, subject[0], self._loading)
        self._points = []
        self._paths, self._store = paths, store
        self._job = Job(self._told)
        self._job.say = lambda text: self._tell("note", text=text)

    def stop(self) -> None:
        """Let it end soon, with what there is."""
        if self.state == WAITING:
            self._change(STOPPED)
            return
        self._job.stopped = True  # where nothing else ends it, the next thing that it tells does
        with suppress(KeyboardInterrupt):
            self._job.stop()

    def run(self) -> None:
        """Do it, and tell how it ended."""
        if self.state != WAITING:
            return
        begin = time.monotonic()
        self._change(RUNNING)
        try:
            self._record = self._made(begin)
            self.well = self._request.went_well(self._record)
            state = DONE
        except KeyboardInterrupt:
            state = STOPPED
        except WorkbenchError as error:
            field, words = in_the_form(self.kind, str(error))
            self.failure, state = {"kind": error.kind, "message": words, "field": field}, FAILED
        except Exception as error:  # noqa: BLE001 - a bug of the workbench is told, and ends nothing else
            words = f"{type(error).__name__}: {error}; this is a bug of the workbench"
            self.failure, state = {"kind": "failed", "message": words}, FAILED
        if self._record is None:
            with suppress(WorkbenchError):
                self._record = self._job.partial()
        self.notes += self._job.notes
        self.seconds = round(time.monotonic() - begin, 3)
        if self._record is not None:
            self.headline = headline_of(self._record)
        self._put_away(state)
        self._change(state)

    def _made(self, begin: float) -> Any:  # noqa: ANN401 - any record
        """Return the record, and remember how it was made."""
        from workbench.requests.call import origin_of_call  # noqa: PLC0415 - opens FMUs, which the first page does not

        given = list(self._paths) if self.kind.subject.several else self._paths[0]
        request = self._request if self._store is None else replace(self._request, store=self._store)  # type: ignore[call-arg]
        with self.kind.opened(given, self._loading) as (subject, notes):
            self.notes += notes
            record = request.run(subject, self._job)
            seconds = time.monotonic() - begin
            self.origin = origin_of_call(
                function(self.kind), (subject,), self._chosen(), seconds=seconds, result=record
            )
        self.call = self.origin.call
        return record

    def _put_away(self, state: str) -> None:
        """Keep what it gave; that it cannot be kept is a remark."""
        if self.drawer is None:
            return
        try:
            if self._record is not None:
                self.drawer.write_result(plain(self._record.to_dict()), type(self._record).__name__, self.points)
            self.drawer.write({**self.facts(), "state": state})
        except InputError as error:
            self.notes.append(f"this ends with the server: {error}")

    def _chosen(self) -> dict[str, Any]:
        """Return the options that are not as they are by default."""
        usual = {d.name: d.default for d in options_of(self.kind)}
        chosen = {n: v for n, v in values_of(self._request).items() if not _same(v, usual[n])}
        return {n: v for n, v in chosen.items() if n not in _ELSEWHERE}

    def _told(self, what: object, done: int, total: int) -> None:
        first = total and not self.total
        self.done, self.total = done, total
        if first:  # a server that is killed leaves how much there is
            self._keep_facts()
        to_dict = getattr(what, "to_dict", None)
        point = plain(to_dict()) if to_dict is not None else None
        if point is not None:
            self.points.append(point)
        words, index = (str(what), None) if point is None else ("", len(self.points) - 1)
        self._tell("progress", done=done, total=total, words=words, point=point, index=index)
        if self._job.stopped and done < total:  # else the answer comes at once
            raise KeyboardInterrupt


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
        self.drawings = Drawings()
        self._shelf = Shelf(root.folder)
        earlier = (Work.kept(drawer) for drawer in self._shelf.drawers())
        self.works: dict[int, Work] = {work.number: work for work in earlier if work is not None}
        for work in self.works.values():
            self._listen(work)
        self._newest = max(self.works, default=0)  # of a work that may have been removed: its events are still told
        # What a page asks does not wait for what a person measures.
        self._threads = {a: ThreadPoolExecutor(_AT_ONCE, thread_name_prefix="work") for a in (False, True)}
        self._lock = threading.Lock()
        self._events: deque[dict[str, Any]] = deque(maxlen=_KEPT)
        self._last = 0
        self._listeners: set[Callable[[], None]] = set()

    def begin(
        self, command: str, subject: Sequence[str], given: Mapping[str, Any], *, aside: bool = False,
        paths: Sequence[str] = (),
    ) -> Work:  # fmt: skip
        """Begin a request.

        Args:
            command: its name.
            subject: models and files, as the browser names them.
            given: what was filled in, see `request_of_form`.
            aside: see `Work`.
            paths: drafts of the subject; empty: itself.

        Raises:
            FormError: fields that cannot be used.
            InputError: nothing, or too much, to run it on.
            NotHereError: a file that is not in the folder.
        """
        if command not in OFFERED:
            raise InputError(f"command '{command}' is not offered here; {suggest(command, OFFERED)}")
        kind = kind_named(command).subject
        if (not subject and not kind.optional) or (len(subject) > 1 and not kind.several):
            raise InputError(f"{command} takes {'some' if kind.several else 'one'} {kind.metavar}")
        found = [self.root.find(name) for name in subject]
        asked = request_of_form(command, given, self.root)
        return self._begun(command, asked, subject, paths or found, given, aside=aside)

    def go_on(self, earlier: Work) -> Work:
        """Begin a work that was stopped again: what it has finished is not measured again.

        Args:
            earlier: see `Work.goes_on`.

        Raises:
            InputError: nothing of it was kept, or as `begin`.
        """
        if not earlier.goes_on or earlier.drawer is None:
            raise InputError(f"{earlier.command} {earlier.number} cannot go on: nothing of it was kept")
        paths = [self.root.find(name) for name in earlier.subject]
        asked = request_of_form(earlier.command, earlier.given, self.root)
        work = self._begun(earlier.command, asked, earlier.subject, paths, earlier.given, after=earlier)
        earlier.went_on(work.number)
        return work

    def remove(self, work: Work) -> None:
        """Throw away a work and what was kept of it.

        Raises:
            InputError: it still runs.
        """
        if work.open:
            raise InputError(f"{work.command} {work.number} still runs; stop it first")
        with self._lock:
            self.works.pop(work.number, None)
        if work.drawer is not None:
            work.drawer.remove()
        self._tell(work.number, "removed", {})

    def _begun(
        self, command: str, asked: tuple[Request[Any, Any], Loading], subject: Sequence[str], paths: Sequence[str],
        given: Mapping[str, Any], *, aside: bool = False, after: Work | None = None,
    ) -> Work:  # fmt: skip
        with self._lock:
            number = self._newest + 1
            drawer, why = (None, "") if aside else self._drawer(number)
            self._newest = number = number if drawer is None else drawer.number
            store = drawer.store if drawer is not None and getattr(asked[0], "store", "") is None else None
            if store is not None and after is not None and after.drawer is not None:
                after.drawer.store.rename(store)
            work = self.works[number] = Task(number, command, asked, subject, paths=paths, store=store)
        work.aside, work.given, work.drawer = aside, dict(given), drawer
        work.notes += [why] if why else []
        work.points.extend([] if after is None else after.points)
        if drawer is not None:
            drawer.write(work.facts())
        self._listen(work)
        self._tell(number, "state", work.to_dict())
        self._threads[aside].submit(self._run, work)
        return work

    def _listen(self, work: Work) -> None:
        work.listen(lambda event, **facts: self._tell(work.number, event, facts))

    def _run(self, work: Task) -> None:
        work.run()
        if work.drawer is not None and work.record is not None and not restorable(work.record):
            work.sections(self.drawings)  # while the record is there

    def _drawer(self, number: int) -> tuple[Drawer | None, str]:
        try:
            return self._shelf.new(number), ""
        except InputError as error:
            return None, f"this ends with the server: {error}"

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

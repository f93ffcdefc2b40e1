"""One piece of work of the browser workbench: what was asked, how far it is, and what it gave."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from typing import Any

from workbench.core.machine.scratch import scratch
from workbench.core.records.record import plain
from workbench.errors import InputError, WorkbenchError, is_choice
from workbench.requests.origin import Origin
from workbench.show.result import write_report
from workbench.ui.forms import kind_named, without_flags
from workbench.ui.kept import Drawer, origin_from_json, origin_to_json, restorable
from workbench.ui.page import sections_told
from workbench.ui.reports import Drawings

__all__ = ["DONE", "FAILED", "RUNNING", "STOPPED", "WAITING", "Work"]

# Facts of a work that are kept as they are.
_KEPT_FACTS = (
    "name", "given", "asked", "line", "call", "state", "done", "total", "notes", "failure", "headline", "well",
    "seconds", "later",
)  # fmt: skip

_NEWER = {"name", "later"}  # an older version has not kept them

WAITING, RUNNING, DONE, STOPPED, FAILED = "waiting", "running", "done", "stopped", "failed"


class Work:
    """One request, from when it is asked for until its record is there; also one that an earlier server has run.

    Attributes:
        number: by which the browser knows it.
        command: its name, as of `REQUESTS`.
        kind: class of the request.
        subject: what it is run on, as the browser names it.
        given: what was filled in.
        aside: whether a page asked it beside what a person measures: no list shows it, and no study has it.
        asked: option → text, as a record's file tells it.
        line: the command that does the same.
        call: the same in Python; empty: not known yet.
        state: "waiting", "running", "done", "stopped" or "failed".
        done, total: how far it is.
        points: that were told, ready for JSON.
        notes: remarks.
        failure: what went wrong, `kind`, `message`, and the `field` that it is about, if any; empty: nothing.
        headline: what the page of its record says first, see `headline_of`; empty: there is no record.
        origin: how the record was made; None: there is none.
        name: that a person gave it; empty: none.
        well: whether the record is what was asked for.
        seconds: that it took.
        later: number of the work that went on with what this has finished; 0: none.
        drawer: where it is kept; None: nowhere.
    """

    def __init__(self, number: int, command: str, subject: Sequence[str]) -> None:
        self.number, self.command, self.subject = number, command, tuple(subject)
        self.kind = kind_named(command)
        self.name = ""
        self.given: Mapping[str, Any] = {}
        self.aside = False
        self.asked: Mapping[str, Any] = {}
        self.line, self.call = "", ""
        self.state, self.done, self.total = WAITING, 0, 0
        self.notes: list[str] = []
        self.failure: dict[str, str] = {}
        self.headline: dict[str, Any] = {}
        self.origin: Origin | None = None
        self.well = True
        self.seconds = 0.0
        self.later = 0
        self.drawer: Drawer | None = None
        self._record: Any = None
        self._points: list[dict[str, Any]] | None = None
        self._report: Future[bytes] | None = None
        self._sections: Future[bytes] | None = None
        self._tell: Callable[..., None] = lambda *_, **__: None

    @classmethod
    def kept(cls, drawer: Drawer) -> Work | None:
        """Return what an earlier server has run; None: nothing can be read of it.

        Args:
            drawer: where it is kept.
        """
        facts = drawer.facts()
        try:
            if facts is None:
                return None
            work = cls(drawer.number, facts["command"], facts["subject"])
            for name in _KEPT_FACTS:
                setattr(work, name, facts.get(name, getattr(work, name)) if name in _NEWER else facts[name])
            work.origin = origin_from_json(facts["origin"]) if facts["origin"] else None
        except (WorkbenchError, KeyError, TypeError, ValueError):  # another version's
            return None
        work.drawer = drawer
        if work.open:  # the server ended before
            work.state = STOPPED
            work.notes = [*work.notes, "the server ended while this ran"]
            work.done = drawer.finished()
        return work

    @property
    def open(self) -> bool:
        """Whether it has not ended."""
        return self.state in {WAITING, RUNNING}

    @property
    def record(self) -> Any:  # noqa: ANN401 - any record
        """What it gave; also what there was when it ended early; None: nothing."""
        if self._record is None and self.drawer is not None and not self.open:
            self._record = self.drawer.record()
        return self._record

    @property
    def told(self) -> dict[str, Any] | None:
        """The record ready for JSON, also where it cannot be read back; None: there is none."""
        record = self.record
        if record is not None:
            return dict(plain(record.to_dict()))
        return None if self.drawer is None or self.open else self.drawer.told()

    @property
    def points(self) -> list[dict[str, Any]]:
        """Points that were told, ready for JSON."""
        if self._points is None:
            self._points = [] if self.drawer is None else self.drawer.points()
        return self._points

    @property
    def remarks(self) -> list[str]:
        """What is to be said beside the record, in the words of the form."""
        return [without_flags(self.kind, text) for text in self._said() if not is_choice(text)]

    def _said(self) -> list[str]:
        said = [*self.headline.get("notes", ()), *(getattr(self._record, "warnings", None) or ()), *self.notes]
        return list(dict.fromkeys(map(str, said)))

    @property
    def goes_on(self) -> bool:
        """Whether its finished points were kept, so that the rest of it can be measured."""
        return self.state in {STOPPED, FAILED} and self.drawer is not None and self.drawer.store.is_dir()

    def listen(self, tell: Callable[..., None]) -> None:
        """Let a function hear what happens: a kind of event, and its facts by name."""
        self._tell = tell

    def keep(self) -> None:
        """Let it be something that a person measured: its record was kept."""
        self.aside = False
        self._change(self.state)

    def stop(self) -> None:
        """Let it end soon, with what there is."""

    def report(self, drawings: Drawings) -> Future[bytes]:
        """Return what will hold its report; it is made once.

        Args:
            drawings: makes it.
        """
        if self._report is None:
            self._report = drawings.ask(self._written)
        return self._report

    def _written(self) -> bytes:
        kept = None if self.drawer is None else self.drawer.report()
        if kept is not None:
            return kept
        with scratch("ui") as folder:
            write_report(self.record, folder / "report.html", self.origin)
            page = (folder / "report.html").read_bytes()
        if self.drawer is not None:
            self.drawer.write_report(page)
        return page

    def sections(self, drawings: Drawings) -> Future[bytes]:
        """Return what will hold the sections of its page as JSON, see `sections_told`; made once, then its report.

        Args:
            drawings: makes them.
        """
        if self._sections is None:
            self._sections = drawings.ask(self._told_sections)
            self.report(drawings)  # whoever looks at the one may want the other
        return self._sections

    def _told_sections(self) -> bytes:
        kept = None if self.drawer is None else self.drawer.sections()
        if kept is not None:
            return kept
        page = json.dumps(sections_told(self.record)).encode()
        if self.drawer is not None and not restorable(self.record):
            self.drawer.write_sections(page)
        return page

    def rename(self, name: str) -> None:
        """Give it a name.

        Raises:
            InputError: it cannot be kept.
        """
        self.name = name
        if self.drawer is not None:
            self.drawer.write(self.facts())
        self._change(self.state)

    def went_on(self, later: int) -> None:
        """Remember which work goes on with what this one has finished; that it cannot be kept is a remark.

        Args:
            later: its number.
        """
        self.later = later
        self._keep_facts()
        self._change(self.state)

    def _keep_facts(self) -> None:
        try:
            if self.drawer is not None:
                self.drawer.write(self.facts())
        except InputError as error:
            self.notes.append(f"this ends with the server: {error}")

    def _change(self, state: str) -> None:
        self.state = state
        self._tell("state", **self.to_dict())

    def facts(self) -> dict[str, Any]:
        """Return what is kept of it beside its record, ready for JSON."""
        origin = None if self.origin is None else plain(origin_to_json(self.origin))
        return {
            "command": self.command,
            "subject": list(self.subject),
            **{name: getattr(self, name) for name in _KEPT_FACTS},
            "origin": origin,
        }

    def to_dict(self) -> dict[str, Any]:
        """Return what a list shows of it, ready for JSON."""
        return {
            "number": self.number,
            "command": self.command,
            "subject": list(self.subject),
            "name": self.name,
            "aside": self.aside,
            "asked": self.asked,
            "line": self.line,
            "call": self.call,
            "state": self.state,
            "done": self.done,
            "total": self.total,
            "counts": self.kind.counts,
            "brief": self.headline.get("brief", ""),
            "lead": self.headline.get("lead", ""),
            "verdicts": self.headline.get("verdicts", []),
            "remarks": self.remarks,
            "chosen": [text for text in self._said() if is_choice(text)],
            "failure": self.failure,
            "well": self.well,
            "has_record": bool(self.headline),
            "goes_on": self.goes_on,
            "seconds": self.seconds,
            "later": self.later,
        }

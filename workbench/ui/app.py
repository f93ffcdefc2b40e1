"""What the server answers: the page, its forms, work that is begun and watched, and what records give."""

from __future__ import annotations

import asyncio
import json
import math
import os
from collections.abc import AsyncIterator, Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, PlainTextResponse, Response, StreamingResponse
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from workbench import __version__
from workbench.core.machine.files import replacing
from workbench.core.machine.scratch import scratch
from workbench.core.records.record import plain
from workbench.errors import InputError, WorkbenchError
from workbench.show.result import picture_of
from workbench.ui.curves import curves_of, signals_of, stored_curves
from workbench.ui.diagram import PALETTE, drawn, edited
from workbench.ui.forms import FILED, MEASURED, FormError, form_of
from workbench.ui.jobs import Desk
from workbench.ui.recorded import Recordings
from workbench.ui.root import NotHereError, has_envelope, kind_of
from workbench.ui.studies import checked_study, with_limit
from workbench.ui.study import study_of
from workbench.ui.tune import Tuning
from workbench.ui.work import Work

__all__ = ["app_of"]

STATIC = Path(__file__).parent / "static"

# A report is a page of its own, with its style and script inside; it can reach nothing else.
_REPORT = {"Content-Security-Policy": "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; "
           "img-src data:; frame-ancestors 'self'; sandbox allow-scripts"}  # fmt: skip
_PICTURES = {".png": "image/png", ".svg": "image/svg+xml", ".pdf": "application/pdf"}
_ALIVE = 15.0  # a stream says so often that it is there [s]
_LARGEST = 1 << 20  # of what is sent here [byte]
_NAME = 80  # of a work, at most [characters]
_DIGITS = 18  # of the number of a work or an event, at most


class _Server:
    """The answers, and what they are about."""

    def __init__(self, desk: Desk) -> None:
        self.desk = desk
        self.tuning = Tuning(desk.root)
        self.recordings = Recordings()

    # -- what there is ------------------------------------------------------------------------

    async def index(self, request: Request) -> Response:
        return FileResponse(STATIC / "index.html")

    def start(self, request: Request) -> Response:
        """Answer with everything that a page needs to begin."""
        root = self.desk.root
        return JSONResponse(
            {
                "version": __version__,
                "folder": root.folder.name or str(root.folder),
                "files": root.listing(),
                "forms": [form_of(command) for command in MEASURED],
                "file_forms": [form_of(command) for command in FILED],
                "palette": [[group, kinds] for group, kinds in PALETTE.items()],
                "works": [work.to_dict() for work in list(self.desk.works.values())],
                "last": self.desk.last,
            }
        )

    def files(self, request: Request) -> Response:
        """Answer with what can be opened."""
        return JSONResponse({"files": self.desk.root.listing()})

    # -- work ---------------------------------------------------------------------------------

    async def begin(self, request: Request) -> Response:
        asked = await _sent(request)
        try:
            work = await run_in_threadpool(
                self.desk.begin, str(asked.get("command")), list(asked.get("subject") or []),
                dict(asked.get("values") or {}), aside=bool(asked.get("aside")),
            )  # fmt: skip
        except FormError as error:
            return JSONResponse({"fields": error.fields}, 422)
        return JSONResponse(work.to_dict(), 201)

    def work(self, request: Request) -> Response:
        """Answer with all that is known of one work: its points so far, and what its record gives."""
        work = self._work(request)
        return JSONResponse(
            {
                **work.to_dict(),
                "points": list(work.points),
                "last": self.desk.last,
                "record": work.told,
                "curves": [] if work.record is None else curves_of(work.record),
                "signals": None if work.record is None else signals_of(work.record),
            }
        )

    def stop(self, request: Request) -> Response:
        self._work(request).stop()
        return JSONResponse({})

    def go_on(self, request: Request) -> Response:
        """Begin a stopped work again, after what it has finished."""
        return JSONResponse(self.desk.go_on(self._work(request)).to_dict(), 201)

    async def rename(self, request: Request) -> Response:
        """Give a work a name."""
        name = str((await _sent(request)).get("name", "")).strip()
        self._work(request).rename(name[:_NAME])
        return JSONResponse({})

    def remove(self, request: Request) -> Response:
        """Throw away a work that has ended."""
        self.desk.remove(self._work(request))
        return JSONResponse({})

    async def events(self, request: Request) -> Response:
        """Answer with what happens, as server-sent events; a browser that comes back is told what it missed."""
        given = request.headers.get("last-event-id") or request.query_params.get("last") or "0"
        last = _number(given) or 0
        headers = {"X-Accel-Buffering": "no"}
        return StreamingResponse(self._stream(last), media_type="text/event-stream", headers=headers)

    async def _stream(self, last: int) -> AsyncIterator[str]:
        loop, news = asyncio.get_running_loop(), asyncio.Event()

        def heard() -> None:
            loop.call_soon_threadsafe(news.set)

        silence = self.desk.hear(heard)
        try:
            while True:
                news.clear()
                events = self.desk.since(last)
                if events is None:
                    yield "event: forgotten\ndata: {}\n\n"
                    return
                for event in events:
                    last = event["id"]
                    yield f"id: {last}\ndata: {json.dumps(event)}\n\n"
                if not events:
                    yield ": \n\n"
                try:
                    await asyncio.wait_for(news.wait(), _ALIVE)
                except TimeoutError:
                    continue
        finally:
            silence()

    # -- what records give ------------------------------------------------------------------------

    def report(self, request: Request) -> Response:
        page = self._with_told(request).report(self.desk.drawings).result()
        return Response(page, media_type="text/html", headers=_REPORT)

    def page(self, request: Request) -> Response:
        """Answer with the sections of the record's page, and with the modes of a linear model."""
        work = self._with_told(request)
        return Response(work.sections(self.desk.drawings).result(), media_type="application/json")

    def picture(self, request: Request) -> Response:
        _, record = self._with_record(request)
        suffix = "." + request.path_params["kind"]
        if suffix not in _PICTURES:
            raise HTTPException(404, f"no picture ends in {suffix}")

        def draw() -> bytes:
            with scratch("ui") as folder:
                picture_of(record, folder / f"picture{suffix}")
                return (folder / f"picture{suffix}").read_bytes()

        return Response(self.desk.drawings.ask(draw).result(), media_type=_PICTURES[suffix])

    def data(self, request: Request) -> Response:
        if request.path_params["kind"] == "json":
            return Response(json.dumps(self._with_told(request).told, indent=2), media_type="application/json")
        _, record = self._with_record(request)
        with scratch("ui") as folder:
            record.to_csv(folder / "data.csv")
            return Response((folder / "data.csv").read_bytes(), media_type="text/csv")

    # -- loops that are tuned -----------------------------------------------------------------------

    async def tune(self, request: Request) -> Response:
        """Answer with the parameters of a loop, with what becomes of it at other values, or measure it there."""
        sent = await _sent(request)
        name, where, values = str(sent.get("name", "")), str(sent.get("open", "")), sent.get("values")
        if values is None:
            return JSONResponse(await run_in_threadpool(self.tuning.begin, name, where))
        given = {str(key): _finite(key, value) for key, value in dict(values).items()}
        measured = sent.get("measure")
        if isinstance(measured, dict):
            path = await run_in_threadpool(self.tuning.draft, name, given)
            command = "limit-cycle" if "block" in measured else "loop"
            begin = partial(self.desk.begin, command, [name], measured, aside=True, paths=[str(path)])
            return JSONResponse((await run_in_threadpool(begin)).to_dict(), 201)
        found = await run_in_threadpool(self.tuning.at, name, where, given, locus=bool(sent.get("locus")))
        return JSONResponse(found)

    # -- systems and studies ------------------------------------------------------------------------

    def store(self, request: Request) -> Response:
        """Answer with the frequency responses of a store."""
        name = request.query_params.get("name", "")
        curves, notes = stored_curves(self.desk.root.path(name))
        return JSONResponse({"name": name, "curves": curves, "notes": notes})

    def text(self, request: Request) -> Response:
        """Answer with the text of a system or a study, and whether it has an envelope."""
        name = request.query_params.get("name", "")
        text = self.desk.root.text_of(name)
        return JSONResponse({"name": name, "text": text, "envelope": has_envelope(text)})

    async def recorded(self, request: Request) -> Response:
        """Answer with what a file of recorded data holds, and with some of its signals over a stretch of time."""
        sent = await _sent(request)
        path = self.desk.root.path(str(sent.get("name", "")))
        dt, begin, end = (
            None if sent.get(key) is None else _finite(key, sent[key]) for key in ("dt", "begin", "end")
        )  # fmt: skip
        channels = [str(name) for name in list(sent.get("channels") or ())]
        told = partial(self.recordings.told, path, dt=dt, channels=channels, begin=begin, end=end)
        return JSONResponse(await run_in_threadpool(told))

    async def checked(self, request: Request) -> Response:
        """Answer with what the draft of a study says, and with its mistakes; after a change if one is asked for."""
        sent = await _sent(request)
        name, text, change = str(sent.get("name", "")), str(sent.get("text", "")), sent.get("change")
        if isinstance(change, dict):
            number, key = _number(str(change.get("number"))), str(change.get("key"))
            if number is None or key not in {"min", "max"}:
                raise InputError("a change has the number of a requirement, and the key min or max")
            text = with_limit(text, number, key, _finite(key, change.get("value")))
        told = await run_in_threadpool(checked_study, text, self.desk.root, name)
        return JSONResponse({**told, "text": text})

    def schema(self, request: Request) -> Response:
        """Answer with the schema of study files, from which an editor completes them."""
        from workbench.study.schema import schema  # noqa: PLC0415 - of all commands: it takes a while

        return JSONResponse(schema("study"))

    async def diagram(self, request: Request) -> Response:
        """Answer with what the text of a system says, after a change if one is asked for."""
        sent = await _sent(request)
        name, text, change = str(sent.get("name", "")), str(sent.get("text", "")), sent.get("change")
        if isinstance(change, list) and change:
            text = edited(text, *map(str, change))
        return JSONResponse({"text": text, **await run_in_threadpool(drawn, text, self.desk.root, name)})

    async def keep(self, request: Request) -> Response:
        """Write the text of a system or a study into the folder."""
        sent = await _sent(request)
        name, text = str(sent.get("name", "")), str(sent.get("text", ""))
        if not name.endswith(".toml"):
            raise InputError(f"{name}: the name of a system or study ends in .toml")
        path = self.desk.root.path(name, new=True)
        if path.exists():
            kind = kind_of(path)
            if kind not in {"system", "study"}:
                message = f"{name} exists and is neither a system nor a study; choose another name"
                return JSONResponse({"message": message}, 422)
            was = sent.get("was")  # what the page has read
            if was is not None and was != self.desk.root.text_of(name):
                return JSONResponse({"message": f"{name} was changed meanwhile", "kind": kind}, 409)
            if was is None and not sent.get("replace"):
                return JSONResponse({"message": f"{name} exists already: a {kind}", "kind": kind}, 409)
        with replacing(path) as new:
            new.write_text(text, encoding="utf-8")
        return JSONResponse({"name": self.desk.root.name_of(path)})

    async def keep_record(self, request: Request) -> Response:
        """Write a record into the folder as JSON, as `--at` and others take it."""
        work, record = self._with_record(request)
        name = str((await _sent(request)).get("name", ""))
        if not name.endswith(".json"):
            raise InputError(f"{name}: the name of a record's file ends in .json")
        path = self.desk.root.path(name, new=True)
        if path.exists():
            return JSONResponse({"message": f"{name} exists already; choose another name"}, 409)
        with replacing(path) as new:
            new.write_text(
                json.dumps({"command": work.kind.command, **plain(record.to_dict())}, indent=2), encoding="utf-8"
            )
        work.keep()
        return JSONResponse({"name": self.desk.root.name_of(path)})

    def study(self, request: Request) -> Response:
        works = [w for w in list(self.desk.works.values()) if not w.aside and not w.open]
        return PlainTextResponse(study_of(works))

    # -- parts --------------------------------------------------------------------------------------

    def _work(self, request: Request) -> Work:
        number = _number(request.path_params["number"])
        work = None if number is None else self.desk.works.get(number)
        if work is None:
            raise HTTPException(404, "there is no such work; the server was started anew, perhaps")
        return work

    def _with_told(self, request: Request) -> Work:
        work = self._work(request)
        if work.record is None and work.told is None:
            raise HTTPException(404, "there is no record")
        return work

    def _with_record(self, request: Request) -> tuple[Work, Any]:
        work = self._work(request)
        if work.record is None:
            raise HTTPException(404, "there is no record")
        return work, work.record


def _finite(name: object, value: object) -> float:
    """Return the value of a parameter."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(f"{name}: {value!r} is not a number")
    return float(value)


def _number(text: str) -> int | None:
    """Return a number of a work or an event; None: it is none, as Python reads no number of thousands of digits."""
    return int(text) if text.isascii() and text.isdigit() and len(text) <= _DIGITS else None


async def _sent(request: Request) -> Mapping[str, Any]:
    """Return what a page has sent."""
    body = bytearray()
    async for piece in request.stream():
        body += piece
        if len(body) > _LARGEST:
            raise HTTPException(413, "too long")
    try:
        result = json.loads(body)
    except (ValueError, RecursionError):
        result = None
    if not isinstance(result, dict):
        raise InputError("what was sent is not a JSON object")
    return result


def _told(status: int) -> Callable[[Request, Exception], Response]:
    def answer(_: Request, error: Exception) -> Response:
        return JSONResponse(
            {"message": str(getattr(error, "detail", "") or error)}, getattr(error, "status_code", status)
        )

    return answer


class _Static(StaticFiles):
    """The page's own files."""

    def lookup_path(self, path: str) -> tuple[str, os.stat_result | None]:
        """Older versions hand such a name to the system, which takes it for a fault of the program."""
        return ("", None) if "\0" in path else super().lookup_path(path)


def app_of(desk: Desk) -> Starlette:
    """Return the application that answers for a desk; `Guard` stands before it.

    Args:
        desk: its work.
    """
    server = _Server(desk)
    routes = [
        Route("/", server.index),
        Route("/api/start", server.start),
        Route("/api/files", server.files),
        Route("/api/events", server.events),
        Route("/api/works", server.begin, methods=["POST"]),
        Route("/api/works/{number}", server.work),
        Route("/api/works/{number}/stop", server.stop, methods=["POST"]),
        Route("/api/works/{number}/go-on", server.go_on, methods=["POST"]),
        Route("/api/works/{number}/name", server.rename, methods=["POST"]),
        Route("/api/works/{number}/remove", server.remove, methods=["POST"]),
        Route("/api/works/{number}/keep", server.keep_record, methods=["POST"]),
        Route("/api/works/{number}/page", server.page),
        Route("/api/works/{number}/report.html", server.report),
        Route("/api/works/{number}/picture.{kind}", server.picture),
        Route("/api/works/{number}/data.{kind}", server.data),
        Route("/api/store", server.store),
        Route("/api/text", server.text),
        Route("/api/text", server.keep, methods=["POST"]),
        Route("/api/diagram", server.diagram, methods=["POST"]),
        Route("/api/tune", server.tune, methods=["POST"]),
        Route("/api/data", server.recorded, methods=["POST"]),
        Route("/api/study", server.checked, methods=["POST"]),
        Route("/api/study/schema", server.schema),
        Route("/api/study.toml", server.study),
        Mount("/static", _Static(directory=STATIC)),
    ]
    errors: Mapping[Any, Any] = {NotHereError: _told(404), WorkbenchError: _told(422), HTTPException: _told(500)}
    return Starlette(routes=routes, exception_handlers=errors)

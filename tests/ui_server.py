"""A browser workbench as a process of its own, and somebody who speaks to it."""

from __future__ import annotations

import http.client
import json
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from subprocess import Popen
from typing import Any
from urllib.parse import urlsplit

import matplotlib as mpl

from tests.programs import start

__all__ = ["POINTS", "REST_STUDY", "ROOT", "Answer", "Ui", "browser_workbench"]

ROOT = Path(__file__).resolve().parents[1]
POINTS = {"input": "delC", "output": "del", "frequencies": "1,2,4", "amplitudes": "1"}  # of the rudder, soon measured

# A study of one analysis and one requirement, which is met.
REST_STUDY = """models.lag = "fmu:FirstOrderLag"

[analyses.rest]
command = "trim"
model = "lag"
u0 = {u = 2.0}

[[requirements]]
name = "gain"
analysis = "rest"
kind = "value"
path = "y.y"
max = 2.5
"""


@dataclass(frozen=True)
class Answer:
    """What the server answered."""

    status: int
    headers: Mapping[str, str]
    body: bytes

    @property
    def json(self) -> Any:  # noqa: ANN401 - whatever it is
        return json.loads(self.body)


@dataclass
class Ui:
    """A server that runs, and the cookie of one page."""

    process: Popen[str]
    address: str
    folder: Path
    cookie: str = field(default="")

    @property
    def base(self) -> str:
        parts = urlsplit(self.address)
        return f"{parts.scheme}://{parts.netloc}"

    @property
    def host(self) -> str:
        return urlsplit(self.address).netloc

    def ask(self, method: str, path: str, body: object = None, **headers: str) -> Answer:
        """Send a request as a page of the server does; `headers` are in place of its own."""
        sent = {"Host": self.host, "Cookie": self.cookie, **({"Origin": self.base} if method != "GET" else {})}
        sent |= {name.replace("_", "-"): value for name, value in headers.items()}
        link = http.client.HTTPConnection(self.host, timeout=120)
        try:
            link.putrequest(method, path, skip_host=True)
            content = b"" if body is None else json.dumps(body).encode() if not isinstance(body, bytes) else body
            for name, value in {**sent, "Content-Length": str(len(content))}.items():
                if value:
                    link.putheader(name, value)
            link.endheaders(content)
            answer = link.getresponse()
            return Answer(answer.status, {k.lower(): v for k, v in answer.getheaders()}, answer.read())
        finally:
            link.close()

    def get(self, path: str) -> Any:  # noqa: ANN401
        return self.ask("GET", path).json

    def begin(self, command: str, subject: str, **values: object) -> int:
        answer = self.ask("POST", "/api/works", {"command": command, "subject": [subject], "values": values})
        assert answer.status == 201, answer.body
        return int(answer.json["number"])

    def events(self, last: int = 0) -> Iterator[dict[str, Any]]:
        """Yield what happens after an event, for ever."""
        link = http.client.HTTPConnection(self.host, timeout=120)
        try:
            link.request("GET", f"/api/events?last={last}", headers={"Cookie": self.cookie})
            for line in link.getresponse():
                if line.startswith(b"data: "):
                    yield json.loads(line[6:])
        finally:
            link.close()

    def ended(self, number: int) -> dict[str, Any]:
        """Wait until a work has ended, and return all of it."""
        for _ in self._until(number):
            pass
        found: dict[str, Any] = self.get(f"/api/works/{number}")
        return found

    def _until(self, number: int) -> Iterator[dict[str, Any]]:
        for event in self.events():
            yield event
            if event["work"] == number and event["event"] == "state" and event["state"] not in {"waiting", "running"}:
                return


@contextmanager
def browser_workbench(folder: Path, *arguments: str) -> Iterator[Ui]:
    """Run `workbench ui` in a folder; it holds a copy of the rudder, and ends in any case.

    What it keeps lies beside the folder, not in the cache of whoever runs the tests; fonts are not looked for anew.
    """
    shutil.copy(ROOT / "fmus" / "fmi2" / "Rudder.fmu", folder)
    own = {"XDG_CACHE_HOME": str(folder.with_name(f"{folder.name}-cache")), "MPLCONFIGDIR": mpl.get_cachedir()}
    process = start(["-m", "workbench", "ui", str(folder), "--no-browser", *arguments], **own)
    try:
        assert process.stdout is not None
        address = process.stdout.readline().strip()
        assert address.startswith("http://127.0.0.1:"), process.communicate()
        ui = Ui(process, address, folder)
        parts = urlsplit(address)
        ui.cookie = ui.ask("GET", f"/?{parts.query}").headers["set-cookie"].partition(";")[0]
        yield ui
    finally:
        process.kill()
        process.communicate()

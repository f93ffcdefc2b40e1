"""What is left when the program is ended at a random instant: 20 times each by KILL, TERM, INT and HUP.

Commands: a sweep, here and on a cluster, a trim, an identification, a study and an envelope. Where there is a store,
every other end comes after the first finished measurement is in it. What was finished must be in the store, the same
command must go on from there to the same numbers, no process may outlive the program, and no temporary folder the next
start.

    scripts/endings.py [--times 20] [--signals KILL,INT] [--what sweep] [--seed 1]
"""

from __future__ import annotations

import argparse
import json
import os
import random
import re
import shlex
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager, nullcontext, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
_SWEEP = "nfr fmu:Rudder --input delC --output del --band 0.5:20 --ratio 1.1 --amplitude 1,2 --store store"
_LINES = {
    "sweep": _SWEEP,
    "cluster": f"{_SWEEP} --scheduler SCHEDULER",
    "trim": "trim fmu:Aircraft",
    "identify": "identify data.csv --input u --output y",
    "study": "run study.toml --store store",
    "envelope": "run envelope.toml --store store",
}
_SWEEPS = ("sweep", "cluster")
_STUDY = """
[models]
rudder = "fmu:Rudder"

[analyses.response]
command = "nfr"
model = "rudder"
input = "delC"
output = "del"
amplitude = [1, 2]
freq = [0.5, 1, 2, 4, 8]

[analyses.linear]
command = "lin"
model = "rudder"
inputs = "delC"

[[requirements]]
name = "gain"
analysis = "response"
kind = "mask"
upper = [[0.5, 1], [8, 1]]
"""
_ENVELOPE = """
models.lag = "fmu:FirstOrderLag"
analyses.response = {command = "nfr", model = "lag", input = "u", output = "y", amplitude = [1], freq = [0.1, 1]}
envelope.parameters = {"lag.tau" = {range = [0.5, 2.0], steps = 20}}

[[requirements]]
name = "gain"
analysis = "response"
kind = "mask"
upper = [[0.1, 2], [1, 2]]
"""
_BESIDES = ("zero input", "operating point", "second responses")  # rows of a sweep's store that are no points
_OWN = ("seconds", "asked", "measured", "reused")  # of a result: differs with time, folder, and what was kept
_KEPT = "points were measured before and are kept"  # a note that tells it
_ENDS_WITHIN = 2.5  # [s], with a margin for a busy machine
_GONE_WITHIN = 10.0  # [s]: workers of a killed program see that it is gone


@dataclass(frozen=True)
class _Place:
    """A folder with what the commands need, and a mark in the environment of the processes begun there."""

    folder: Path
    mark: str = field(default_factory=lambda: str(time.monotonic_ns()))

    def __post_init__(self) -> None:
        (self.folder / "tmp").mkdir()
        (self.folder / "study.toml").write_text(_STUDY)
        (self.folder / "envelope.toml").write_text(_ENVELOPE)
        (self.folder / "data.csv").write_text(_data())

    def started_store(self, process: subprocess.Popen[str]) -> None:
        """Wait until the first finished measurement is in the store, or the program has ended."""
        while process.poll() is None and not self.kept():
            time.sleep(0.02)

    def start(self, what: str) -> subprocess.Popen[str]:
        own = {"TMPDIR": str(self.folder / "tmp"), "WORKBENCH_MARK": self.mark, "PYTHONPATH": str(ROOT)}
        return subprocess.Popen(
            [sys.executable, "-m", "workbench", *shlex.split(_LINES[what]), "--json", "out.json"],
            cwd=self.folder, env={**os.environ, **own}, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
            start_new_session=True,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # noqa: PLW1509 - as in a terminal
        )  # fmt: skip

    def whole(self, what: str) -> tuple[int, Any]:
        """Run a command to its end; return its exit code and numbers."""
        process = self.start(what)
        _, error = process.communicate()
        if process.returncode not in (0, 1):
            return process.returncode, error.strip().splitlines()[-1:]
        return self.numbers(what, process.returncode)

    def numbers(self, what: str, code: int) -> tuple[int, Any]:
        """Return an exit code and what must be the same when the command is repeated."""
        return code, _numbers(what, self.told()) if code in (0, 1) else None

    def told(self) -> Any:
        """Return the JSON that was written; None: nothing."""
        file = self.folder / "out.json"
        return json.loads(file.read_text()) if file.exists() else None

    def kept(self) -> set[str]:
        """Return the names of the points that the store has: of a sweep, amplitude and frequency."""
        found = set()
        for file in (self.folder / "store").glob("*.sqlite"):
            with suppress(sqlite3.DatabaseError), closing(sqlite3.connect(f"file:{file}?mode=ro", uri=True)) as store:
                names = (name for (name,) in store.execute("select point from measurements"))
                found |= {name for name in names if not name.startswith(_BESIDES)}
        return found

    def processes(self) -> list[int]:
        """Return the processes that were left behind."""
        found = []
        for process in Path("/proc").glob("[0-9]*"):
            with suppress(OSError):
                if f"WORKBENCH_MARK={self.mark}".encode() in (process / "environ").read_bytes():
                    found.append(int(process.name))
        return found


def _data() -> str:
    """Return a record of y[k+1] = 0.9 y[k] + 0.1 u[k] under random steps."""
    chance, y, rows = random.Random(1), 0.0, ["time,u,y"]  # noqa: S311 - no secret
    for k in range(3000):
        u = chance.choice((-1.0, 1.0))
        rows.append(f"{0.1 * k:.1f},{u},{y!r}")
        y = 0.9 * y + 0.1 * u
    return "\n".join(rows) + "\n"


def _numbers(what: str, data: Any) -> Any:
    """Return what must be the same when the command is repeated."""
    if what in _SWEEPS:
        return [data[key] for key in ("frequency_hz", "amplitude", "gain", "phase_deg", "failed")]
    if what == "trim":
        return data["operating_point"]
    if what in ("identify", "envelope"):
        return {k: v for k, v in data.items() if k not in _OWN}
    return [(a["name"], _own_numbers(a["result"])) for a in data["analyses"]]


def _own_numbers(result: dict[str, Any]) -> dict[str, Any]:
    own = {k: v for k, v in result.items() if k not in _OWN}
    return {**own, "warnings": [w for w in result.get("warnings", ()) if not w.endswith(_KEPT)]}


def _finished(what: str, data: Any) -> set[str]:
    """Return the names, as the store has them, of what a command's JSON says is finished."""
    if what not in _SWEEPS or data is None or "gain" not in data:  # asked to end before there was anything
        return set()
    rows = zip(data["amplitude"], data["gain"], strict=True)
    points = [(a, f) for a, gains in rows for f, g in zip(data["frequency_hz"], gains, strict=True) if g is not None]
    return {str((float(a), float(f))) for a, f in points}


def _ended(place: _Place, what: str, name: str, delay: float, *, first: bool) -> Iterator[str]:
    """End a command by a signal, so long after its start or its first measurement; yield what is wrong."""
    process = place.start(what)
    if first:
        place.started_store(process)
    time.sleep(delay)
    sent = time.monotonic()
    process.send_signal(getattr(signal, f"SIG{name}"))
    _, error = process.communicate()
    took = time.monotonic() - sent
    if took > _ENDS_WITHIN:
        yield f"ended after {took:.1f} s"
    # Before the program's first line, in a package's `__init__`, Python itself is starting.
    frames = [f for f in re.findall(r'File "([^"]+)"', error) if f"{os.sep}workbench{os.sep}" in f]
    if "Traceback" in error and any(not f.endswith("__init__.py") for f in frames):
        yield f"traceback: {error.strip()}"
    while place.processes() and time.monotonic() < sent + _GONE_WITHIN:
        time.sleep(0.1)
    if left := place.processes():
        yield f"{len(left)} processes left"
    data, kept = place.told(), place.kept()
    told = _finished(what, data)
    if missing := told - kept:
        yield f"told, but not in the store: {', '.join(sorted(missing))}"
    if name != "KILL" and what in _SWEEPS and process.returncode != 0 and not told and kept:
        yield "a point was finished, but the program told none"
    after = "first measurement" if first else "start"
    print(
        f"{what} {name} {delay:.2f} s after its {after}: exit {process.returncode} after {took:.2f} s, "
        f"{len(told)} told, {len(kept)} kept",
        flush=True,
    )


def _problems(what: str, name: str, delay: float, truth: Any, *, first: bool) -> Iterator[str]:
    """End a command and run it again; yield what is wrong."""
    with tempfile.TemporaryDirectory() as folder:
        place = _Place(Path(folder))
        yield from _ended(place, what, name, delay, first=first)
        if (found := place.whole(what)) != truth:
            yield f"the same command again: exit {found[0]}: {str(found[1])[:300]}"
        if left := sorted(p.name for p in (place.folder / "tmp").iterdir()):
            yield f"left in the temporary folder: {left}"


def _tried(what: str, signals: list[str], times: int, instants: random.Random) -> int:
    """End a command so many times by each signal; return the number of problems."""
    with tempfile.TemporaryDirectory() as folder:
        place, begin = _Place(Path(folder)), time.monotonic()
        process = place.start(what)
        if "--store" in _LINES[what]:
            place.started_store(process)
        first = time.monotonic() - begin
        process.communicate()
        seconds = time.monotonic() - begin
        truth = place.numbers(what, process.returncode)
    if truth[0] not in (0, 1):
        sys.exit(f"{what}: exit {truth[0]}")
    print(f"{what}: {seconds:.2f} s undisturbed, the first measurement after {first:.2f} s")
    wrong = 0
    for name in signals:
        for number in range(times):
            late = "--store" in _LINES[what] and number % 2 == 0
            left = seconds - first if late else seconds
            for problem in _problems(what, name, instants.uniform(0.0, 0.95 * left), truth, first=late):
                wrong += 1
                print(f"  {what} {name}: {problem}", flush=True)
    return wrong


@contextmanager
def _scheduler() -> Iterator[None]:
    """Start a cluster on this machine, to which the sweep is sent."""
    line = [sys.executable, str(ROOT / "scripts/cluster_local.py"), "2", "--port", "0"]
    with subprocess.Popen(line, stdout=subprocess.PIPE, text=True, cwd=ROOT) as cluster:
        try:
            address = cluster.stdout.readline().split()[-1] if cluster.stdout else ""
            _LINES["cluster"] = _LINES["cluster"].replace("SCHEDULER", address)
            yield
        finally:
            cluster.terminate()  # a program in the background does not hear INT


def main() -> None:
    """End programs and say what is left."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--times", type=int, default=20)
    parser.add_argument("--signals", type=lambda text: text.split(","), default=["KILL", "TERM", "INT", "HUP"])
    parser.add_argument("--what", type=lambda text: text.split(","), default=list(_LINES))
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    instants, wrong = random.Random(asked.seed), 0  # noqa: S311 - no secret
    with _scheduler() if "cluster" in asked.what else nullcontext():
        for what in asked.what:
            wrong += _tried(what, asked.signals, asked.times, instants)
    print(f"{len(asked.what) * len(asked.signals) * asked.times} ended, {wrong} problems")
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()

"""What a user sees when an FMU misbehaves: 12 ways × each FMI call × commands and functions, as a table.

Each case is run in Python, in one process that must survive all of them, or on the command line. What is right is
written down for each case (`expected`): the kinds of error that may be told, and whether there may be a result. Where
there is one, its numbers must be those of the same FMU that behaves, done in the same way; what differs in silence is
a defect.

    scripts/misbehave.py [--ways segfault,hang] [--calls doStep] [--what trim] [--program] [--out x.md]
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

import workbench as wb  # noqa: E402
from tests.misbehaving_fmus import CALLS, OUTSIDE, WAYS, build_misbehaving  # noqa: E402
from workbench.core.where import Worker, Workers  # noqa: E402

HANG, MEMORY = 4.0, 600.0  # [s], [MB]: what a result may cost

# What is done, in Python; each returns numbers that tell one FMU from another.
DEEDS: Mapping[str, Callable[[Any, Any], Any]] = {
    "simulate": lambda model, w: wb.simulate(model, stop=1.0, inputs={"u": 2.0}, workers=w)["y"].tolist(),
    "trim": lambda model, w: _point(wb.trim(model, workers=w)),
    "lin": lambda model, w: wb.lin(model, workers=w).to_dict()["A"],
    "nfr": lambda model, w: _gains(wb.nfr(model, "u", "y", [1.0], [1.0], workers=_one(w))),
    "info": lambda model, w: [v.name for v in wb.info(model.source, workers=w).outputs],
}
LINES: Mapping[str, list[str]] = {
    "simulate": ["--stop", "1", "--input", "u=2"],
    "trim": [],
    "lin": [],
    "info": [],
    "nfr": ["--input", "u", "--output", "y", "--freq", "1", "--amplitude", "1"],
}
# What may be said of a way. After those that end a process there is no result, where the call is one that is needed.
FITTING = {
    "segfault": {"crashed"}, "abort": {"crashed"}, "exit0": {"exited"}, "exit3": {"exited"}, "hang": {"timed out"},
    "nan": {"failed", "bad input"}, "events": {"failed"}, "memory": {"out of memory", "crashed"},
}  # fmt: skip
# Without these calls there is a result, or it is there before them: call → for what, by interface ("" both).
SPARED: Mapping[str, Mapping[str, set[str]]] = {
    "getFMUstate": {"": {"simulate", "nfr"}, "cs": {"trim"}},
    "terminate": {"": {"simulate", "lin", "nfr"}, "me": {"trim"}},  # trim of cs runs the FMU several times
    "freeInstance": {"": {"simulate", "lin", "nfr"}, "me": {"trim"}},
    "unload": {"": {"simulate", "trim", "lin", "nfr"}},
}
DEADLY = {"segfault", "abort", "exit0", "exit3", "hang"}


def expected(case: Case) -> set[str]:
    """Return the kinds of what a user may see; "ok" is a result with the right numbers."""
    spared = SPARED.get(case.call, {})
    without = spared.get("", set()) | spared.get(case.interface, set())
    if case.way in DEADLY and case.what == "info":  # says what the description does, unless it waits for the probe
        return {"ok", "timed out"} if case.way == "hang" else {"ok"}
    if case.way in DEADLY:
        return {"ok"} if case.what in without else FITTING[case.way]
    return FITTING.get(case.way, set()) | {"ok"}


def _one(worker: Worker) -> Workers:
    return Workers(jobs=1, timeout=worker.timeout, memory_limit=worker.memory_limit)


def _point(found: Any) -> Any:
    if not found.converged:
        raise wb.SimulationError(found.message)
    return found.to_dict()["operating_point"]


def _gains(found: Any) -> Any:
    if found.failed:
        raise wb.SimulationError(found.failed[0].reason)
    return found.gain.tolist()


@dataclass(frozen=True)
class Case:
    """One FMU and what is done with it."""

    way: str
    call: str
    interface: str
    what: str


@dataclass(frozen=True)
class Seen:
    """What a user saw: "ok" or the kind of error, words, and whether it is right."""

    kind: str
    words: str
    right: bool


def cases(asked: argparse.Namespace) -> Iterator[Case]:
    """Yield the cases that are asked for."""
    for interface, calls in CALLS.items():
        for call in (*calls, *OUTSIDE):
            for way in WAYS:
                if (way in asked.ways or not asked.ways) and (call in asked.calls or not asked.calls):
                    yield from (Case(way, call, interface, what) for what in asked.what or DEEDS)


def in_python(file: Path, case: Case, truth: Any) -> Seen:
    """Do it with the function."""
    limits = Worker(timeout=HANG, memory_limit=MEMORY if case.way == "memory" else None)
    try:
        with wb.load(file, case.interface) as model:
            found = DEEDS[case.what](model, limits)
    except wb.WorkbenchError as error:
        kind = _kind_in(str(error)) if case.what == "nfr" else error.kind
        return Seen(kind, str(error), kind in expected(case))
    same = _same(found, truth)
    return Seen("ok" if same else "WRONG", "", same and "ok" in expected(case))


def on_command_line(file: Path, case: Case, truth: Any) -> Seen:
    """Do it with the command."""
    done = _run(file, case)
    last = done.stderr.strip().splitlines()[-1:] or [""]
    try:
        data = json.loads(done.stdout)
    except ValueError:
        return Seen(f"exit {done.returncode}, no JSON", last[0], right=False)
    kind, code, said = _told(case.what, data, last[0])
    right = done.returncode in code and kind in expected(case)
    if kind == "ok" and not _same(_numbers(case.what, data), truth):
        kind, right = "WRONG", False
    return Seen(kind, said, right)


def _run(file: Path, case: Case) -> subprocess.CompletedProcess[str]:
    words = [sys.executable, "-m", "workbench", case.what, str(file), *LINES[case.what], "--json", "-"]
    words += ["--timeout", str(HANG)]
    words += [] if case.what == "info" else ["--interface", case.interface]
    words += ["--memory-limit", str(MEMORY)] if case.way == "memory" else []
    return subprocess.run(words, capture_output=True, text=True, cwd=ROOT, timeout=300, check=False)


def _told(what: str, data: Any, last: str) -> tuple[str, set[int], str]:
    """Return the kind of what a command's JSON tells, the exit codes that fit, and words."""
    if "failure" in data:
        return data["failure"]["kind"], {2}, last
    if what == "trim" and data.get("converged") is False:
        return "failed", {1}, data["message"]
    if data.get("failed"):
        return _kind_in(str(data["failed"])), {1}, last
    return "ok", {0}, last


def _numbers(what: str, data: Any) -> Any:
    if what == "simulate":
        return data["signals"]["y"]
    if what == "info":
        return [v["name"] for v in data["outputs"]]
    return data[{"trim": "operating_point", "lin": "A", "nfr": "gain"}[what]]


def _kind_in(reason: str) -> str:
    """Return the kind of error that a point's reason tells."""
    for words, kind in (
        ("crashed", "crashed"), ("aborted", "crashed"), ("killed", "crashed"), ("ended its process", "exited"),
        ("time limit", "timed out"), ("memory", "out of memory"),
    ):  # fmt: skip
        if words in reason:
            return kind
    return "failed"


def _same(a: Any, b: Any) -> bool:
    """Whether two results are equal, but for what names the file."""
    if isinstance(a, dict) and isinstance(b, dict):
        return all(_same(a[k], b.get(k)) for k in a if k != "model_sha256")
    if isinstance(a, list) and isinstance(b, list):
        return len(a) == len(b) and all(map(_same, a, b))
    if isinstance(a, float) and isinstance(b, float):
        return math.isclose(a, b, rel_tol=1e-9, abs_tol=1e-12)
    return bool(a == b)


def main() -> None:
    """Run the cases and write the page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    for name in ("ways", "calls", "what"):
        parser.add_argument(f"--{name}", type=lambda text: text.split(","), default=[])
    parser.add_argument("--program", action="store_true", help="on the command line in place of in Python")
    parser.add_argument("--out", type=Path, help="page to write, Markdown")
    asked = parser.parse_args()
    run = on_command_line if asked.program else in_python
    found: dict[Case, Seen] = {}
    begin = time.monotonic()
    with tempfile.TemporaryDirectory() as name:
        truths: dict[tuple[str, str], Any] = {}
        for case in cases(asked):
            key = case.interface, case.what
            if key not in truths:
                truths[key] = _truth(Path(name), case, program=asked.program)
            os.environ["MISBEHAVES"] = f"{{{case.way}@{case.call}}}" if case.call in OUTSIDE else ""
            file = build_misbehaving(Path(name), case.way, case.call)
            seen = found[case] = run(file, case, truths[key])
            if not seen.right:
                print(f"NOT RIGHT {case}: {seen.kind}: {seen.words}", flush=True)
    text = "\n".join(_page(found))
    if asked.out is not None:
        asked.out.write_text(text + "\n", encoding="utf-8")
    wrong = sum(not seen.right for seen in found.values())
    print(f"{len(found)} cases, {wrong} not right, {time.monotonic() - begin:.0f} s")
    sys.exit(1 if wrong else 0)


def _truth(folder: Path, case: Case, *, program: bool) -> Any:
    os.environ["MISBEHAVES"] = ""
    file = build_misbehaving(folder, "nothing", "never")
    if program:
        done = _run(file, case)
        return _numbers(case.what, json.loads(done.stdout))
    with wb.load(file, case.interface) as model:
        return DEEDS[case.what](model, Worker())


def _page(found: Mapping[Case, Seen]) -> Iterator[str]:
    deeds = list(dict.fromkeys(case.what for case in found))
    yield f"| FMU | {' | '.join(deeds)} |"
    yield f"| --- | {' | '.join('---' for _ in deeds)} |"
    for row in dict.fromkeys((c.interface, c.call, c.way) for c in found):
        cells = [
            next(s.kind for c, s in found.items() if (c.interface, c.call, c.way, c.what) == (*row, d)) for d in deeds
        ]
        yield f"| {row[2]} in {row[1]} ({row[0]}) | {' | '.join(cells)} |"


if __name__ == "__main__":
    main()

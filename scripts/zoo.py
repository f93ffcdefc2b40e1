"""Try the workbench on FMUs of other exporters: `python scripts/zoo.py FOLDER|FMU … [--out table.md]`.

Every FMU with a binary for this machine × each of its interfaces × info, check, simulate, nfr, trim, lin: a process for
each interface, with a time limit; after a crash the rest goes on in a new one. `simulate` is compared with FMPy (same
steps, same tolerance, inputs at their start values): a value may be off by 1e-3 of the range that its signal has there.

| verdict   | means                                                                     |
|-----------|---------------------------------------------------------------------------|
| ok        | an answer; for simulate: FMPy's                                           |
| no        | an honest no with exit code 1: no equilibrium, a promise broken, a point that failed |
| refused   | one line that says why (exit code 2)                                      |
| n/a       | the FMU has nothing to ask for, e.g. no input to force                    |
| disagrees | FMPy's trajectory is another one                                          |
| crashed   | a traceback, a signal, no line, or the time limit                         |
"""

from __future__ import annotations

import argparse
import io
import json
import os
import subprocess
import sys
import tempfile
import traceback
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workbench.cli.app import run as workbench

COMMANDS = ("info", "check", "simulate", "nfr", "trim", "lin")
LIMIT = 120.0  # for one command [s]
AGREE = 1e-3  # of the range of a signal
MOST_STEPS = 2000
TOLERANCE = 1e-6
NO_ANSWER = 1  # exit code
_MARK = "===== "

_FMPY = """
import json, sys, fmpy, numpy
found = fmpy.simulate_fmu(validate=False, **json.loads(sys.argv[1]))
print("=====", json.dumps({n: numpy.asarray(found[n], dtype=float).reshape(len(found), -1)[:, 0].tolist()
      for n in found.dtype.names if found[n].dtype.kind in "fiub"}))
"""


@dataclass(frozen=True)
class Row:
    """What one command made of one interface of an FMU."""

    fmu: str
    interface: str
    command: str
    verdict: str
    reason: str = ""


@dataclass(frozen=True)
class Subject:
    """One interface of an FMU."""

    file: Path
    interface: str
    facts: dict[str, Any]

    @property
    def span(self) -> tuple[float, float, float]:
        """Start, stop and step of the run [s]: the default experiment's, at most `MOST_STEPS` steps."""
        given = self.facts["experiment"]
        start = given["start_time"] or 0.0
        stop = given["stop_time"] if (given["stop_time"] or 0.0) > start else start + 1.0
        step = given["step"] or (stop - start) / 500.0
        return start, min(stop, start + MOST_STEPS * step), step


def main() -> int:
    """Print the table; exit code 1 if anything crashed or disagrees."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("places", nargs="+", type=Path, help="folders (searched in full) and FMUs")
    parser.add_argument("--out", type=Path, help="write the table as Markdown, too")
    parser.add_argument("--only", nargs="+", choices=COMMANDS, default=COMMANDS, help="commands, in place of all")
    parser.add_argument("--child", metavar="INTERFACE", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child is not None:
        _be_child(options.places[0], options.child, options.only)
        return 0
    rows = []
    for file in _files(options.places):
        for row in _try(file, [c for c in COMMANDS if c in options.only]):
            rows.append(row)
            print(f"{row.verdict:9} {row.fmu} {row.interface} {row.command} {row.reason}", flush=True)
            if options.out is not None:
                options.out.write_text(_table(rows), encoding="utf-8")
    return int(any(r.verdict in ("crashed", "disagrees") for r in rows))


def _files(places: Sequence[Path]) -> Iterator[Path]:
    for place in places:
        yield from sorted(place.rglob("*.fmu")) if place.is_dir() else [place]


def _try(file: Path, commands: Sequence[str]) -> Iterator[Row]:
    done = _process([sys.executable, "-m", "workbench", "info", str(file), "--json", "-"])
    if done.returncode != 0:
        yield Row(file.name, "", "info", *_verdict(done))
        return
    facts = json.loads(done.stdout)
    if not facts["interfaces"]:
        yield Row(file.name, "", "info", "n/a", "it offers neither model exchange nor co-simulation")
    elif not facts["runnable"]:
        where = ", ".join(facts["platforms"]) or "none at all"
        yield Row(file.name, "", "info", "n/a", f"no binary for this machine (it has: {where})")
    else:
        for interface in sorted(facts["interfaces"], reverse=True):
            yield from _commands(file, interface, commands)


def _commands(file: Path, interface: str, commands: Sequence[str]) -> Iterator[Row]:
    """Run commands in a child; what it does not live to tell has crashed it, and the rest is left to another."""
    rest = list(commands)
    while rest:
        words = [sys.executable, __file__, str(file), "--child", interface, "--only", *rest]
        done = _process(words, limit=LIMIT * len(rest))
        told = [json.loads(line.removeprefix(_MARK)) for line in done.stdout.splitlines() if line.startswith(_MARK)]
        for command, verdict, reason in told:
            yield Row(file.name, interface, command, verdict, reason)
        rest = rest[len(told) :]
        if rest:
            last = (done.stderr.splitlines() or [""])[-1]
            yield Row(file.name, interface, rest.pop(0), "crashed", f"exit code {done.returncode}: {last}")


def _be_child(file: Path, interface: str, commands: Sequence[str]) -> None:
    """Run commands in this process and print what came of each."""
    facts = json.loads(_workbench("info", str(file), "--json", "-").stdout)
    subject = Subject(file, interface, facts)
    asked = {"info": [], **dict(_arguments(subject))}
    for command in commands:
        verdict, reason = ("ok", "") if command == "info" else _run(subject, command, asked[command])
        print(_MARK + json.dumps([command, verdict, reason]), flush=True)


def _arguments(subject: Subject) -> Iterator[tuple[str, list[str] | str]]:
    """Return what each command is asked for; a text: why it is not asked."""
    start, stop, step = subject.span
    yield "check", []
    yield (
        "simulate",
        ["--start", repr(start), "--stop", repr(stop), "--step", repr(step), "--tolerance", str(TOLERANCE)],
    )
    forced = [v for v in subject.facts["inputs"] if v["type"] in ("Real", "Float64", "Float32")]
    seen = [
        v for v in subject.facts["outputs"] or subject.facts["states"] if v["type"] in ("Real", "Float64", "Float32")
    ]
    if not forced or not seen:
        yield "nfr", f"no continuous {'input' if not forced else 'output'}"
    else:
        size = 0.1 * (abs(float(forced[0]["start"] or 0.0)) or 1.0)
        at = ["--freq", repr(5.0 / (stop - start)), "--amplitude", repr(size)]
        yield "nfr", ["--input", forced[0]["name"], "--output", seen[0]["name"], *at]
    yield "trim", []
    yield "lin", []


def _run(subject: Subject, command: str, arguments: list[str] | str) -> tuple[str, str]:
    if isinstance(arguments, str):
        return "n/a", arguments
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out.json"
        own = ["--in-process"] if command in ("check", "simulate", "nfr") else []
        done = _workbench(
            command, str(subject.file), "--interface", subject.interface, *arguments, *own, "--json", str(out)
        )
        verdict = _verdict(done)
        if command == "simulate" and verdict[0] == "ok":
            return _compared(subject, json.loads(out.read_text(encoding="utf-8")))
    return verdict


def _workbench(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run a command of the workbench in this process."""
    out, err = io.StringIO(), io.StringIO()
    try:
        with redirect_stdout(out), redirect_stderr(err):
            code = workbench(list(arguments))
    except Exception:  # noqa: BLE001  whatever it is, it is a finding
        return subprocess.CompletedProcess(arguments, -1, out.getvalue(), traceback.format_exc())
    return subprocess.CompletedProcess(arguments, code, out.getvalue(), err.getvalue())


def _process(words: list[str], *, limit: float = LIMIT) -> subprocess.CompletedProcess[str]:
    """Run a command with a time limit; one that takes longer ends with code −1."""
    try:
        return subprocess.run(
            words, capture_output=True, text=True, timeout=limit, check=False, env=os.environ, stdin=subprocess.DEVNULL
        )
    except subprocess.TimeoutExpired as error:
        told = error.stdout.decode() if isinstance(error.stdout, bytes) else ""
        return subprocess.CompletedProcess(words, -1, told, f"time limit of {limit:g} s")


def _verdict(done: subprocess.CompletedProcess[str]) -> tuple[str, str]:
    lines = [line for line in done.stderr.splitlines() if line.strip()]
    said = [line.removeprefix("workbench: ") for line in lines if line.startswith("workbench: ")]
    if done.returncode == 0:
        return "ok", ""
    if done.returncode not in (1, 2) or "Traceback" in done.stderr or len(said) > 1:
        return "crashed", (lines or [f"exit code {done.returncode}"])[-1]
    if done.returncode == NO_ANSWER:
        return "no", (said or [_last(done.stdout)])[0]
    return ("refused", said[0]) if said else ("crashed", "exit code 2 without a line")


def _last(text: str) -> str:
    lines = [line.strip() for line in text.splitlines() if line.strip() and not line.startswith("wrote ")]
    return lines[-1] if lines else ""


# -- FMPy, the oracle -----------------------------------------------------------------------------


def _compared(subject: Subject, ours: dict[str, Any]) -> tuple[str, str]:
    start, stop, step = subject.span
    asked = {
        "filename": str(subject.file),
        "fmi_type": {"me": "ModelExchange", "cs": "CoSimulation"}[subject.interface],
        "start_time": start,
        "stop_time": stop,
        "output_interval": step,
        "relative_tolerance": TOLERANCE,
        "output": list(ours["signals"]),
        "record_events": False,
    }
    done = _process([sys.executable, "-c", _FMPY, json.dumps(asked)])
    if "=====" not in done.stdout:
        lines = done.stderr.splitlines() or [f"exit code {done.returncode}"]
        return "ok", f"FMPy does not run it: {lines[-1]}"
    theirs = json.loads(done.stdout.split("=====")[1])
    return _difference(ours, {n: np.array(v) for n, v in theirs.items()}, step)


def _difference(ours: dict[str, Any], theirs: dict[str, NDArray[np.float64]], step: float) -> tuple[str, str]:
    """Compare at our points but the events, which FMPy is not asked to record; at a jump each side of it will do."""
    time, at = np.array(ours["time"]), theirs["time"]
    if abs(at[-1] - time[-1]) > 1.5 * step:
        return "disagrees", f"it ends at {time[-1]:g} s, FMPy's run at {at[-1]:g} s"
    twice = np.append(np.diff(time) == 0.0, False) | np.append(False, np.diff(time) == 0.0)
    common = (time <= at[-1]) & ~twice
    worst, name = 0.0, ""
    for signal in sorted(set(ours["signals"]) & set(theirs)):
        y, truth = np.array(ours["signals"][signal], dtype=float)[common], theirs[signal]
        shifts = (-1e-6 * step, 0.0, 1e-6 * step)
        gaps = np.minimum.reduce([np.abs(np.interp(time[common] + s, at, truth) - y) for s in shifts])
        size = max(float(np.ptp(truth)), 1e-6 * float(np.max(np.abs(truth), initial=0.0)), 1e-12)
        if np.max(gaps, initial=0.0) / size > worst:
            worst, name = float(np.max(gaps)) / size, signal
    verdict = "ok" if worst <= AGREE else "disagrees"
    return verdict, f"FMPy: {worst:.1e} of the range" + (f" ({name})" if name else "")


# -- the table ------------------------------------------------------------------------------------


def _table(rows: Sequence[Row]) -> str:
    count = Counter(r.verdict for r in rows)
    lines = [", ".join(f"{n} {verdict}" for verdict, n in count.most_common()), ""]
    lines += ["| FMU | interface | " + " | ".join(COMMANDS) + " |", "|" + "---|" * (len(COMMANDS) + 2)]
    for key in dict.fromkeys((r.fmu, r.interface) for r in rows):
        own = {r.command: r.verdict for r in rows if (r.fmu, r.interface) == key}
        lines.append(f"| {key[0]} | {key[1]} | " + " | ".join(own.get(c, "") for c in COMMANDS) + " |")
    lines += ["", "| FMU | interface | command | verdict | reason |", "|---|---|---|---|---|"]
    lines += [
        f"| {r.fmu} | {r.interface} | {r.command} | {r.verdict} | {r.reason.replace('|', '/')} |"
        for r in rows
        if r.reason
    ]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.exit(main())

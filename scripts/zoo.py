"""Try the workbench on any FMUs, with FMPy as the oracle: `scripts/zoo.py FOLDER|FMU … [--out zoo.html]`.

Every FMU × each of its interfaces × `COMMANDS`. The workbench runs each in a worker process, FMPy in a child, both
under limits of time and memory. `info` is compared with what FMPy reads in the description; `simulate` with FMPy's run
under the same inputs, moved from their start values and back: a value may be off by 1e-3 of its signal's range there.
Without a folder: the corpus of the tests (tests/corpus.py), built for this machine.
"""

from __future__ import annotations

import argparse
import io
import json
import math
import re
import subprocess
import sys
import tempfile
import time
import traceback
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from scripts import zoo_oracle as oracle  # noqa: E402
from workbench.cli.app import run as workbench  # noqa: E402
from workbench.core.records.names_in_text import plain_unit  # noqa: E402
from workbench.fmi.archive import HARMLESS, MAX_RATIO  # noqa: E402
from workbench.show.page import Page, PageTable, Section, write_page  # noqa: E402
from workbench.show.verdicts import Verdict  # noqa: E402

AGREE = 1e-3  # of the range of a signal
ENDS = 0.05  # of the span: steps of integrators with which an FMU ends its run
VERDICTS = {
    "ok": "an answer; for info and simulate: FMPy's",
    "no": "an honest no with exit code 1 (no equilibrium, a promise broken, a point that failed), or no answer that "
    "FMPy is sure of either",
    "refused": "one line that says why, and it is so: FMPy refuses, too, or its description bears the reason out",
    "n/a": "the FMU has nothing to ask for, e.g. no input to force",
    "doubtful": "refused for a reason that nothing confirms: for a reader",
    "disagrees": "FMPy gives another answer",
    "crashed": "a traceback, a signal, or no line",
}
BAD = ("crashed", "disagrees", "doubtful")
_NUMBERS = ("Real", "Float64", "Float32")
# Types by FMPy's names, where the workbench has another.
_TYPES = {"Enumeration": ("Enumeration", "Integer", "Int64")}


@dataclass(frozen=True)
class Row:
    """What one command made of one interface of an FMU.

    Attributes:
        fmu: its file.
        tool: that made it.
        fmi: version of FMI.
        interface: "me", "cs"; "" where the file as a whole is meant.
        command: of the workbench.
        verdict: of `VERDICTS`.
        reason: its line, or what was compared.
        oracle: FMPy's word where it refuses.
        seconds: that the command took.
    """

    fmu: str
    tool: str
    fmi: str
    interface: str
    command: str
    verdict: str
    reason: str = ""
    oracle: str = ""
    seconds: float = 0.0


@dataclass(frozen=True)
class Subject:
    """One interface of an FMU.

    Attributes:
        file: the FMU.
        interface: "me" or "cs".
        facts: what `info` says.
        described: what FMPy reads.
        limits: of each command and of FMPy.
    """

    file: Path
    interface: str
    facts: dict[str, Any]
    described: oracle.Described
    limits: oracle.Limits

    @property
    def forced(self) -> list[dict[str, Any]]:
        """Continuous inputs."""
        return [v for v in self.facts["inputs"] if v["type"] in _NUMBERS]

    @property
    def seen(self) -> list[dict[str, Any]]:
        """Continuous outputs, else states."""
        return [v for v in self.facts["outputs"] or self.facts["states"] if v["type"] in _NUMBERS]


# -- what is asked ----------------------------------------------------------------------------------


def _simulate(subject: Subject) -> list[str] | str:
    asked = subject.described.asked
    words = ["--start", repr(asked.start), "--stop", repr(asked.stop), "--step", repr(asked.step)]
    held = asked.moved.keys() - asked.jumps.keys()
    moved = [word for name in sorted(held) for word in ("--bias", f"{name}={asked.moved[name]!r}")]
    signals = {
        n: f"step:time={asked.back!r},initial={v + asked.moved[n]!r},value={v!r}" for n, v in asked.jumps.items()
    }
    jumps = [word for name, signal in signals.items() for word in ("--input", f"{name}={signal}")]
    return [*words, "--tolerance", str(oracle.TOLERANCE), *moved, *jumps]


def _nfr(subject: Subject) -> list[str] | str:
    if not subject.forced or not subject.seen:
        return f"no continuous {'output' if subject.forced else 'input'}"
    asked, forced = subject.described.asked, subject.forced[0]
    size = oracle.MOVED * (abs(float(forced["start"] or 0.0)) or 1.0)
    at = ["--freq", ",".join(repr(n / (asked.stop - asked.start)) for n in (5.0, 15.0)), "--amplitude", repr(size)]
    return ["--input", forced["name"], "--output", subject.seen[0]["name"], *at]


def _modes(subject: Subject) -> list[str] | str:
    numbers = [p for p in subject.facts["parameters"] if p["type"] in _NUMBERS and p["start"]]
    if not numbers:
        return "no parameter with a start value"
    value = float(numbers[0]["start"])
    low, high = sorted((0.99 * value, 1.01 * value))
    return ["--vary", f"{numbers[0]['name']}={low!r}:{high!r}", "--points", "3"]


# What each command is asked for; a text: why it is not asked.
COMMANDS: dict[str, Callable[[Subject], list[str] | str]] = {
    "check": lambda _: [],
    "simulate": _simulate,
    "nfr": _nfr,
    "trim": lambda _: [],
    "lin": lambda _: [],
    "modes": _modes,
}


# -- what is a true reason --------------------------------------------------------------------------


def _has(subject: Subject, causality: str) -> bool:
    """Whether there are numbers of a causality; clocks, texts and binaries are none."""
    kinds = [type_ for type_, kind, _ in subject.described.variables.values() if kind == causality]
    return not {"String", "Binary", "Clock"}.issuperset(kinds)


def _has_real(subject: Subject, causality: str) -> bool:
    """Whether there are real numbers of a causality, by which a linear model is made."""
    return any(t in _NUMBERS and kind == causality for t, kind, _ in subject.described.variables.values())


def _ends(subject: Subject, theirs: oracle.Run) -> bool:
    """Whether FMPy's run ends before it should, too."""
    asked = subject.described.asked
    return bool(len(theirs.time)) and float(theirs.time[-1]) < asked.stop - 1.5 * asked.step


# What a refusal says (a regular expression) → whether FMPy's description, or its run, bears it out.
REASONS: tuple[tuple[str, Callable[[Subject, oracle.Run], bool]], ...] = (
    (
        r"needs? (its|an|the) (execution )?tool",
        lambda s, _: s.described.interfaces.get(s.interface, {}).get("needs_tool", False),
    ),
    (
        r"needs an input and an output that are real",
        lambda s, _: not (_has_real(s, "input") and _has_real(s, "output")),
    ),
    (
        r"needs an input or states",
        lambda s, _: not _has(s, "input") and (s.interface == "cs" or not s.described.states),
    ),
    (r"no inputs?\b|an input, and there is none", lambda s, _: not _has(s, "input")),
    (r"no outputs?\b", lambda s, _: not _has(s, "output")),
    (r"co-simulation shows no states", lambda s, _: s.interface == "cs"),
    (r"no (continuous )?states?\b", lambda s, _: s.described.states == 0 or s.interface == "cs"),
    (r"ended its run", _ends),
    (r"not a finite number", lambda _, run: not all(np.isfinite(y).all() for y in run.signals.values())),
    (r"--memory-limit: more than", lambda s, _: np.isfinite(s.limits.megabytes)),  # measured by the worker
    (r"there is no linear model|misses other pulses", lambda *_: True),  # measured: other inputs answer otherwise
)


def _names_in(file: Path) -> list[zipfile.ZipInfo]:
    with zipfile.ZipFile(file) as archive:
        return archive.infolist()


def _size(file: Path) -> int:
    return sum(i.file_size for i in _names_in(file))


# What a refusal of a file says → whether the file is so; FMPy opens such files.
OF_FILES: tuple[tuple[str, Callable[[Path], bool]], ...] = (
    (r"would leave the target folder", lambda f: any(".." in i.filename.split("/") for i in _names_in(f))),
    (r"as zip bombs do", lambda f: _size(f) > max(HARMLESS, MAX_RATIO * sum(i.compress_size for i in _names_in(f)))),
)


def _borne_out(subject: Subject, reason: str, theirs: oracle.Run) -> bool:
    return any(re.search(pattern, reason) and true(subject, theirs) for pattern, true in REASONS)


# -- running ----------------------------------------------------------------------------------------


def zoo(files: Sequence[Path], commands: Sequence[str], limits: oracle.Limits) -> Iterator[Row]:
    """Yield what came of each FMU, interface and command."""
    for file in files:
        yield from _try(file, commands, limits)


def _try(file: Path, commands: Sequence[str], limits: oracle.Limits) -> Iterator[Row]:
    described, runs = oracle.consult(file, limits)
    began = time.perf_counter()
    done = _workbench("info", str(file), "--json", "-")
    verdict, reason = _verdict(done)
    facts = json.loads(done.stdout) if verdict == "ok" else {}
    fmi = described.fmi or facts.get("fmi_version") or "?"
    about = (file.name, described.tool or facts.get("generation_tool") or "", fmi)

    def row(interface: str, command: str, verdict: str, reason: str = "", said: str = "") -> Row:
        return Row(*about, interface, command, verdict, reason, said, round(time.perf_counter() - began, 3))

    if verdict == "refused":
        true = described.fails or any(re.search(said, reason) and true(file) for said, true in OF_FILES)
        yield row("", "info", verdict if true else "doubtful", reason, described.fails)
        return
    if verdict != "ok":
        yield row("", "info", verdict, reason, described.fails)
        return
    differs = "" if described.fails else ", ".join(_misread(facts, described))
    yield row("", "info", "disagrees" if differs else "ok", differs, described.fails)
    for interface in facts["interfaces"]:
        subject = Subject(file, interface, facts, described, limits)
        if interface not in facts["runs_here"]:
            where = ", ".join(facts["platforms"]) or "none at all"
            yield row(interface, "simulate", "n/a", f"no binary for this machine (it has: {where})")
            continue
        theirs = runs.get(interface, oracle.Run(fails=described.fails or "it does not see this interface"))
        for command in commands:
            began = time.perf_counter()
            yield row(interface, command, *_run(subject, command, theirs))


def _run(subject: Subject, command: str, theirs: oracle.Run) -> tuple[str, str, str]:
    """Return verdict, reason and what FMPy says."""
    asked = COMMANDS[command](subject)
    if isinstance(asked, str):
        return "n/a", asked, ""
    limits = ["--timeout", repr(subject.limits.seconds)]
    if math.isfinite(subject.limits.megabytes):
        limits += ["--memory-limit", repr(subject.limits.megabytes)]
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out.json"
        done = _workbench(
            command, str(subject.file), "--interface", subject.interface, *asked, *limits, "--json", str(out)
        )
        verdict, reason = _verdict(done)
        if command == "simulate" and verdict == "ok":
            ours = json.loads(out.read_text(encoding="utf-8"))
            for name in (name for clock in subject.facts["clocks"] for name in clock["variables"]):
                ours["signals"].pop(name, None)  # FMPy lets no clock tick
            return *_judged(subject, ours, theirs), theirs.fails
    if verdict == "refused" and not theirs.fails and not _borne_out(subject, reason, theirs):
        verdict = "doubtful"
    return verdict, reason, theirs.fails


def _workbench(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run a command of the workbench in this process, which gives the FMU to a worker process."""
    out, err = io.StringIO(), io.StringIO()
    try:
        with redirect_stdout(out), redirect_stderr(err):
            code = workbench(list(arguments))
    except Exception:  # noqa: BLE001  whatever it is, it is a finding
        return subprocess.CompletedProcess(arguments, -1, out.getvalue(), traceback.format_exc())
    return subprocess.CompletedProcess(arguments, code, out.getvalue(), err.getvalue())


def _verdict(done: subprocess.CompletedProcess[str]) -> tuple[str, str]:
    lines = [line for line in done.stderr.splitlines() if line.strip()]
    said = [line.removeprefix("workbench: ") for line in lines if line.startswith("workbench: ")]
    if done.returncode == 0:
        return "ok", ""
    if done.returncode not in (1, 2) or "Traceback" in done.stderr or len(said) > 1:
        return "crashed", (lines or [f"exit code {done.returncode}"])[-1]
    if done.returncode == 1:
        left_out = [line.removeprefix("note: ") for line in lines if " is left out: " in line]
        return "no", (said or [_last(done.stdout, left_out)])[0]
    return ("refused", said[0]) if said else ("crashed", "exit code 2 without a line")


def _last(text: str, left_out: Sequence[str]) -> str:
    """Return the line of a page that says what failed or is broken, else what was left out, else its last line."""
    lines = [line.strip() for line in text.splitlines() if line.strip() and not line.startswith("wrote ")]
    told = [line for line in lines if line.startswith("failed: ") or " broken " in line]
    return " ".join([*told, *left_out, *lines[-1:], ""][0].split())


# -- comparing --------------------------------------------------------------------------------------


def _misread(facts: dict[str, Any], described: oracle.Described) -> Iterator[str]:
    """Yield where `info` says something else than FMPy."""
    if facts["fmi_version"].partition(".")[0] != described.fmi.partition(".")[0]:
        yield f"FMI {facts['fmi_version']}, by FMPy {described.fmi}"
    if sorted(facts["interfaces"]) != sorted(described.interfaces):
        yield f"interfaces {facts['interfaces']}, by FMPy {list(described.interfaces)}"
    ticking = {clock["name"] for clock in facts["clocks"]}  # has a list of its own
    for kind in ("input", "output"):
        ours = {v["name"]: v for v in facts[f"{kind}s"]}
        theirs = {n: said for n, said in described.variables.items() if said[1] == kind and n not in ticking}
        if missing := sorted(set(theirs) ^ set(ours)):
            yield f"{kind}s: only one has {', '.join(missing[:5])}"
        for name in ours.keys() & theirs.keys():
            if (ours[name]["unit"] or "") != plain_unit(theirs[name][2] or ""):
                yield f"unit of {name}: {ours[name]['unit']}, by FMPy {theirs[name][2]}"
            if ours[name]["type"] not in _TYPES.get(theirs[name][0], (theirs[name][0],)):
                yield f"type of {name}: {ours[name]['type']}, by FMPy {theirs[name][0]}"


def _judged(subject: Subject, ours: dict[str, Any], theirs: oracle.Run) -> tuple[str, str]:
    """Compare; a disagreement is for a second run of FMPy to confirm, in another process.

    By model exchange, where the solver is FMPy's, that is finer; in co-simulation it is without event mode, where the
    FMU has one, else the same again. Ours may agree with it; of others an FMU that differs from itself is excused.
    """
    asked = subject.described.asked
    verdict, reason = _compared(ours, theirs, asked)
    if verdict != "disagrees":
        return verdict, reason
    better = oracle.finer(subject.file, subject.interface, subject.limits)
    if better.fails:
        return verdict, reason
    second, words = _compared(ours, better, asked)
    if second == "ok":
        how = "at a hundredth of its tolerance" if subject.interface == "me" else "in its second run"
        return "ok", f"{words}, {how}"
    moved, apart = _compared({"time": theirs.time.tolist(), "signals": theirs.signals}, better, asked)
    if moved == "disagrees":
        return "no", f"two runs of FMPy differ, too: {apart}"
    return (second, words) if subject.interface == "me" else (verdict, reason)


def _compared(ours: dict[str, Any], theirs: oracle.Run, asked: oracle.Asked) -> tuple[str, str]:
    """Compare at our points on its grid, not at events, which FMPy does not record; at a jump each side of it will do.

    Where an FMU ends both runs with a step of an integrator, the step decides when.
    """
    if theirs.fails:
        return "ok", "FMPy does not run it"
    when, at = np.array(ours["time"]), theirs.time
    step, early = asked.step, max(at[-1], when[-1]) < asked.stop - asked.step
    if abs(at[-1] - when[-1]) > max(1.5 * step, ENDS * (asked.stop - asked.start) if early else 0.0):
        return "disagrees", f"it ends at {when[-1]:g} s, FMPy's run at {at[-1]:g} s"
    twice = np.append(np.diff(when) == 0.0, False) | np.append(False, np.diff(when) == 0.0)
    steps = (when - asked.start) / step
    common = (when <= at[-1]) & ~twice & (np.abs(steps - np.round(steps)) <= 1e-6)
    worst, name = 0.0, ""
    for signal in sorted(set(ours["signals"]) & set(theirs.signals)):
        y, truth = np.array(ours["signals"][signal], dtype=float)[common], theirs.signals[signal]
        shifts = (-1e-6 * step, 0.0, 1e-6 * step)
        gaps = np.fmin.reduce([np.abs(np.interp(when[common] + s, at, truth) - y) for s in shifts])
        missing = np.isnan(y) & np.isnan(np.interp(when[common], at, truth))  # in both runs
        known = truth[np.isfinite(truth)]
        size = max(float(np.ptp(known)), 1e-6 * float(np.max(np.abs(known), initial=0.0)), 1e-12) if len(known) else 1.0
        off = float(np.max(gaps[~missing], initial=0.0)) / size
        if not off <= worst:
            worst, name = off, signal
    verdict = "ok" if worst <= AGREE else "disagrees"
    return verdict, f"FMPy: {worst:.1e} of the range" + (f" ({name})" if name else "")


# -- the page ---------------------------------------------------------------------------------------


def page_of(rows: Sequence[Row]) -> Page:
    """Return the page of a run of the zoo: what is wrong first, then every FMU, then every line."""
    fmus = dict.fromkeys(r.fmu for r in rows)
    count = Counter(r.verdict for r in rows)
    bad = [
        Verdict("failed", f"{r.fmu} {r.interface} {r.command}: {r.verdict}: {r.reason}")
        for r in rows
        if r.verdict in BAD
    ]
    runs = {(r.fmu, r.interface) for r in rows if r.interface}
    lead = f"{len(fmus)} FMUs, {len(runs)} interfaces, {len(rows)} answers: " + ", ".join(
        f"{n} {verdict}" for verdict, n in count.most_common()
    )
    return Page(
        title="The zoo",
        lead=f"{lead}.",
        facts={},
        sections=[
            Section("By exporter", tables=[_by_tool(rows)]),
            Section("By FMU", tables=[_by_fmu(rows)]),
            Section("Every reason", tables=[_reasons(rows)]),
            Section("What the verdicts mean", tables=[PageTable(("verdict", "means"), list(VERDICTS.items()))]),
        ],
        data={"rows": [asdict(r) for r in rows]},
        summary=bad or [Verdict("good", "nothing disagrees, crashes or is refused for a doubtful reason")],
        kind="zoo",
    )


def _by_tool(rows: Sequence[Row]) -> PageTable:
    verdicts = [v for v in VERDICTS if any(r.verdict == v for r in rows)]
    lines = []
    for tool, fmi in sorted({(r.tool, r.fmi) for r in rows}):
        own = [r for r in rows if (r.tool, r.fmi) == (tool, fmi)]
        counts = Counter(r.verdict for r in own)
        lines.append((tool or "not said", fmi, str(len({r.fmu for r in own})), *(str(counts[v]) for v in verdicts)))
    return PageTable(("exporter", "FMI", "FMUs", *verdicts), lines)


def _by_fmu(rows: Sequence[Row]) -> PageTable:
    commands = list(dict.fromkeys(r.command for r in rows if r.interface))
    lines = []
    for key in dict.fromkeys((r.fmu, r.fmi, r.interface) for r in rows if r.interface):
        own = {r.command: r.verdict for r in rows if (r.fmu, r.fmi, r.interface) == key}
        lines.append((*key, *(own.get(c, "") for c in commands)))
    return PageTable(("FMU", "FMI", "interface", *commands), lines, right=())


def _reasons(rows: Sequence[Row]) -> PageTable:
    lines = [(r.fmu, r.interface, r.command, r.verdict, r.reason, r.oracle) for r in rows if r.reason or r.oracle]
    return PageTable(("FMU", "interface", "command", "verdict", "reason", "FMPy says"), lines, right=())


# -- the command ------------------------------------------------------------------------------------


def _told() -> str:
    lines = [f"  {verdict:9}  {means}" for verdict, means in VERDICTS.items()]
    return "\n".join([__doc__ or "", *lines])


def main() -> int:
    """Print the rows, write the page; exit code 1 if anything is wrong."""
    parser = argparse.ArgumentParser(description=_told(), formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("places", nargs="*", type=Path, help="folders (searched in full) and FMUs")
    parser.add_argument("--out", type=Path, help="write the page, .html")
    parser.add_argument("--only", nargs="+", choices=COMMANDS, default=list(COMMANDS), help="commands, in place of all")
    parser.add_argument("--timeout", type=float, default=60.0, help="for one result [s]")
    parser.add_argument("--memory", type=float, default=2000.0, help="that an FMU may take [MB]")
    options = parser.parse_args()
    limits = oracle.Limits(options.timeout, options.memory)
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as folder:
        for row in zoo(list(_files(options.places or [_corpus(Path(folder))])), options.only, limits):
            rows.append(row)
            print(f"{row.verdict:9} {row.fmu} {row.interface} {row.command} {row.reason}", flush=True)
    if options.out is not None:
        write_page(page_of(rows), options.out)
    return int(any(r.verdict in BAD for r in rows))


def _files(places: Sequence[Path]) -> Iterator[Path]:
    for place in places:
        yield from sorted(place.rglob("*.fmu")) if place.is_dir() else [place]


def _corpus(folder: Path) -> Path:
    from tests.corpus import build_corpus  # noqa: PLC0415  it needs the compiler

    build_corpus(folder)
    return folder


if __name__ == "__main__":
    sys.exit(main())

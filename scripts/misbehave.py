"""What a user sees when an FMU misbehaves: many ways × each FMI call × commands and functions, as a table.

The ways are crashes and the like, changes of the process (arithmetic, locale, limits), and lies: restores that restore
not all, and numbers that depend on the process. Each case is run in Python, in one process that must survive all of
them, or on the command line. What is right is written down for each case (`expected`): the kinds of error that may be
told, and whether there may be a result. Where there is one, its numbers must be those of the same FMU that behaves,
done in the same way; what differs in silence is a defect. Commands that run none of the
user's FMUs (build of a model, identify, reproduce) have no row here.

    scripts/misbehave.py [--ways segfault,hang] [--calls doStep] [--what trim] [--some 4] [--interface cs] [--program]
                         [--out x.md]
"""

from __future__ import annotations

import argparse
import json
import math
import os
import re
import shutil
import subprocess
import sys
import tempfile
import textwrap
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import cycle, islice
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

import workbench as wb  # noqa: E402
from tests.lying_fmus import build_lying  # noqa: E402
from tests.misbehaving_fmus import CALLS, OUTSIDE, WAYS, build_misbehaving  # noqa: E402
from workbench.core.records.record import plain  # noqa: E402
from workbench.jobs.options import Workers  # noqa: E402

HANG, LONG, PATIENT, MEMORY = 4.0, 20.0, 200.0, 600.0  # [s], [s], [s], [MB]: what a result may cost
BOTH, ME = ("me", "cs"), ("me",)

# -- what is opened, where it is not the FMU alone: text of a file beside it ----------------------

SYSTEMS: Mapping[str, str] = {
    "loop": """
        [components]
        plant = {{model = "{fmu}", interface = "{interface}"}}
        k = 2.0
        error = {{sum = "+-"}}
        [connections]
        "error.u2" = "plant.y"
        "k.u" = "error.y"
        "plant.u" = "k.y"
        [inputs]
        u = "error.u1"
        [outputs]
        y = "plant.y"
    """,
    "cycle": """
        [components]
        plant = {{model = "{fmu}", interface = "{interface}"}}
        lag = {{numerator = [4.0], denominator = [1.0, 1.0, 1.0]}}
        damper = "fmu:AileronDamper"
        [connections]
        "lag.u" = {{from = "plant.y", convert = false}}
        "damper.rate" = {{from = "lag.y", convert = false}}
        "plant.u" = {{from = "damper.moment", gain = -1e-4, convert = false}}
        [outputs]
        y = "lag.y"
    """,
    "filter": """
        [components]
        plant = {{model = "{fmu}", interface = "{interface}"}}
        damper = "fmu:AileronDamper"
        [components.mass]
        A = [[0.2, -1.0], [1.0, 0.0]]
        B = [[-1e-4, 0.5], [0.0, -0.2]]
        C = [[1.0, 0.0]]
        inputs = ["moment", "u"]
        outputs = ["rate"]
        [connections]
        "damper.rate" = {{from = "mass.rate", convert = false}}
        "mass.moment" = {{from = "damper.moment", convert = false}}
        "mass.u" = "plant.y"
        [inputs]
        u = "plant.u"
        [outputs]
        rate = "mass.rate"
    """,
    "two": """
        [components]
        first = {{model = "{fmu}", interface = "{interface}"}}
        second = {{model = "{fmu}", interface = "{interface}"}}
        [connections]
        "second.u" = "first.y"
        [inputs]
        u = "first.u"
        [outputs]
        y = "second.y"
    """,
    "study": """
        [models]
        m = {{model = "{fmu}", interface = "{interface}"}}
        [analyses.motion]
        command = "simulate"
        model = "m"
        stop = 1.0
        input = {{u = 2.0}}
        {limits}
        [analyses.point]
        command = "trim"
        model = "m"
        {limits}
        [[requirements]]
        name = "rest"
        analysis = "point"
        kind = "value"
        path = "operating_point.u.u"
        min = 0.5
    """,
}


def _closed(times: Sequence[float]) -> str:
    """Return a record of "loop", where y = 2/3 (1 - exp(-3 t)) after a step."""
    return "time,u,y\n" + "".join(f"{t!r},1.0,{2.0 / 3.0 * (1.0 - math.exp(-3.0 * t))!r}\n" for t in times)


# Files beside what is opened, by name.
BESIDE: Mapping[str, str] = {
    "record.csv": _closed([0.05 * k for k in range(1, 41)]),
    "wanted.toml": """
        models.loop = "loop-{interface}.toml"
        analyses.closed = {{command = "lin", model = "loop", inputs = "u", outputs = "y"}}
        [[requirements]]
        name = "gain"
        analysis = "closed"
        kind = "mask"
        lower = [[0.01, -3.0], [0.1, -3.0]]
    """,
}

# -- what is done -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Deed:
    """A command and the function that does the same; of both, the record's numbers are compared.

    Attributes:
        function: of what is opened, the interface and the limits; returns the record.
        line: options of the command.
        numbers: takes from the record's JSON what tells one FMU from another.
        subject: which of `SYSTEMS` is opened; "": the FMU.
        interfaces: for which it is done; a single one is no option of the command.
        timeout: for one result [s], longer than it ever takes.
        failed: takes from the JSON why parts of the record failed; a text that says nothing: none did.
        command: where it has another name.
        tolerance: of its numbers (relative).
    """

    function: Callable[[Any, str, Workers], Any]
    line: str
    numbers: Callable[[Any], Any]
    subject: str = ""
    interfaces: tuple[str, ...] = BOTH
    timeout: float = HANG
    failed: Callable[[Any], object] = lambda data: data.get("failed")
    command: str = ""
    tolerance: float = 1e-9


def _with(do: Callable[[Any, Workers], Any]) -> Callable[[Any, str, Workers], Any]:
    """Return a function that opens the FMU, or the system, for another."""

    def done(file: Path, interface: str, workers: Workers) -> Any:
        with wb.load(file, interface) if file.suffix == ".fmu" else wb.load(file) as model:
            return do(model, workers)

    return done


def _twice(model: Any, workers: Workers) -> Any:
    two = {"a": model, "b": model}
    asked: Any = {"outputs": ["y"], "windows": [(0.0, 1.0)], "inputs": {"u": 2.0}, "interval": 0.01}
    return wb.compare_motions(two, **asked, workers=workers)


_MANY = [0.2 * k for k in range(1, 13)]  # [Hz]

DEEDS: Mapping[str, Deed] = {
    "simulate": Deed(
        _with(lambda m, w: wb.simulate(m, stop=1.0, inputs={"u": 2.0}, workers=w)),
        "--stop 1 --input u=2",
        lambda data: data["signals"]["y"],
    ),
    "trim": Deed(
        _with(lambda m, w: wb.trim(m, workers=w)),
        "",
        lambda data: data["operating_point"],
        failed=lambda data: data["message"] if data["converged"] is False else "",
    ),
    "lin": Deed(_with(lambda m, w: wb.lin(m, workers=w)), "", lambda data: data["A"], timeout=LONG),
    "nfr": Deed(
        _with(lambda m, w: wb.nfr(m, "u", "y", [1.0], [1.0], workers=w)),
        "--input u --output y --freq 1 --amplitude 1",
        lambda data: data["gain"],
    ),
    "sweep": Deed(  # in two processes
        _with(lambda m, w: wb.nfr(m, "u", "y", _MANY, [1.0], workers=replace(w, jobs=2))),
        f"--input u --output y --freq {','.join(map(str, _MANY))} --amplitude 1 --jobs 2",
        lambda data: data["gain"],
        command="nfr",
        tolerance=1e-3,  # of a point, by default
    ),
    "info": Deed(lambda f, _, w: wb.info(f, workers=w), "", lambda data: [v["name"] for v in data["outputs"]]),
    "branches": Deed(
        _with(lambda m, w: wb.branches(m, "u", "y", [1.0], band=(0.1, 0.2), workers=w)),
        "--input u --output y --amplitude 1 --band 0.1:0.2",
        lambda data: [b["gain"] for b in data["branches"]],
        interfaces=ME,
        timeout=LONG,
    ),
    "modes": Deed(
        _with(lambda m, w: wb.modes(m, vary="k.gain", values=[1.0, 2.0], workers=w)),
        "--vary k.gain=1,2",
        lambda data: [s["natural_frequency_hz"] for s in data["sets"]],
        subject="loop",
        interfaces=ME,
        timeout=LONG,
        failed=lambda data: [s["failed"] for s in data["sets"] if s["failed"]] or "",
    ),
    "loop": Deed(
        _with(lambda m, w: wb.loop(m, "plant.y", amplitudes=[1.0], frequencies=[0.5], workers=w)),
        "--open plant.y --amplitude 1 --freq 0.5",
        lambda data: [data["linear"]["lin"]["A"], [[p["gain"] for p in c["points"]] for c in data["measured"]]],
        subject="loop",
        interfaces=ME,
        timeout=LONG,
        failed=lambda data: [p["reason"] for c in data["measured"] for p in c["points"] if p["reason"]] or "",
    ),
    "delays": Deed(
        _with(lambda m, w: wb.delays(m, stop=1.0, inputs={"u": 1.0}, workers=w)),
        "--delays --stop 1 --input u=1",
        lambda data: data.get("outputs", data["connections"]),
        subject="loop",
        command="check",
        timeout=LONG,
    ),
    "limit-cycle": Deed(
        _with(lambda m, w: wb.limit_cycle(m, block="damper", workers=w)),
        "--block damper",
        lambda data: [[c[k] for k in ("method", "frequency_hz", "amplitude")] for c in data["limit_cycles"]],
        subject="cycle",
        interfaces=ME,
        timeout=LONG,
    ),
    "feedback": Deed(
        _with(lambda m, w: wb.feedback(m, source="plant.y", target="k.u", workers=w)),
        "--from plant.y --to k.u",
        lambda data: [data["stable_gains"], data["plant"]["A"]],
        subject="loop",
        timeout=LONG,
    ),
    "feed-forward": Deed(
        _with(lambda m, w: wb.feed_forward(m, block="damper", target="plant.u", workers=w)),
        "--block damper --to plant.u",
        lambda data: data["filter"]["A"],
        subject="filter",
        interfaces=ME,
        timeout=LONG,
    ),
    "compare": Deed(
        _with(_twice),
        "--label a --label b --output y --window 0:1 --input u=2 --interval 0.01",
        lambda data: [[m["peak"], m["rms"]] for m in data["motions"]],
        command="simulate",
    ),
    "check": Deed(
        lambda f, i, w: wb.check(f, interface=i, only=["runs", "determinism", "snapshots", "processes"], workers=w),
        "--only runs,determinism,snapshots,processes",
        lambda data: [[c["name"], c["verdict"]] for c in data["checks"]],
        failed=lambda data: [c["evidence"] for c in data["checks"] if c["verdict"] == "broken"] or "",
    ),
    "calibrate": Deed(
        lambda f, _, w: _with(
            lambda m, w: wb.calibrate(m, f.parent / "record.csv", free={"k.gain": (0.5, 8.0)}, workers=w)
        )(f, "", w),
        "{folder}/record.csv --free k.gain=0.5:8",
        lambda data: data["parameters"][0]["value"],
        subject="loop",
        timeout=LONG,
    ),
    "robust": Deed(
        _with(lambda m, w: wb.robust(m, {"k.gain": (1.0, 3.0)}, workers=w)),
        "--uncertain k.gain=1:3",
        lambda data: data["stability"]["lower"],
        subject="loop",
        interfaces=ME,
        timeout=LONG,
    ),
    "tune": Deed(
        lambda f, _, w: wb.tune(
            f, free={"k.gain": (0.5, 8.0)}, study=f.parent / "wanted.toml", starts=0, keep=False, workers=w
        ),
        "--free k.gain=0.5:8 --study {folder}/wanted.toml --starts 0 --no-keep",
        lambda data: data["parameters"][0]["value"],
        subject="loop",
        timeout=LONG,
        failed=lambda data: [r["reason"] for r in data["requirements"] if r["reason"]] or "",
    ),
    "excite": Deed(
        _with(lambda m, w: wb.excite(m, "u", "y", prbs="amplitude=1", dt=0.1, samples=64, workers=w)),
        "--input u --output y --prbs amplitude=1 --step 0.1 --samples 64",
        lambda data: [data["y"], data["validation"]["y"]],
    ),
    "run": Deed(
        lambda f, _, w: wb.run_study(f, store=None, jobs=1, timeout=w.timeout),
        "--no-store",
        lambda data: [data["analyses"][0]["result"]["signals"]["y"], data["analyses"][1]["result"]["operating_point"]],
        subject="study",
        timeout=LONG,  # of a process that begins another
        failed=lambda data: [a["failed"] for a in data["analyses"] if a["code"] != 0] or "",
    ),
    "export": Deed(  # reads descriptions only
        lambda f, _, _w: wb.export_container(wb.read_system(f), f.parent / "container.fmu", step=0.1),
        "--step 0.1 --out {folder}/container.fmu",
        lambda data: [data.get("inputs"), data.get("outputs")],
        subject="two",
        interfaces=("cs",),
        command="build",
    ),
}

# -- what is right -----------------------------------------------------------------------------------

# What may be said of a way. After those that end a process there is no result, where the call is one that is needed.
FITTING = {
    "segfault": {"crashed"}, "abort": {"crashed"}, "exit0": {"exited"}, "exit3": {"exited"}, "hang": {"timed out"},
    "nan": {"failed", "bad input"}, "events": {"failed"}, "memory": {"out of memory", "crashed"},
    "_traps": {"crashed"}, "_cpu": {"crashed"}, "_few": {"failed"},
    **{way: {"out of memory", "crashed", "failed"} for way in ("_data", "_stack", "_space")},
}  # fmt: skip
# What a note, or a check, says of these ways where the numbers are others.
_RESTORES, _PROCESS = (
    r"restore|snapshots|fmi2SetFMUstate",
    r"depend on the process|in a second process|in the second instance",
)
REMARKS = {
    **dict.fromkeys(("rounding", "_arithmetic", "_flush", "_traps"), "the FMU changed the arithmetic"),
    **dict.fromkeys(("half-restore", "wrong-restore", "failing-restore"), _RESTORES),
    **dict.fromkeys(("pid", "unset", "first"), _PROCESS),
}
LIE = "lie"  # in place of a call, for the lies of tests/lying_fmus.py
LIES = ("half-restore", "wrong-restore", "failing-restore", "pid", "unset", "first")
# One run in one process has the numbers of that process, and cannot know of others: `check` and sweeps tell.
OWN, COMPARING = ("pid", "unset", "first"), ("check", "sweep")
# Instances end when the result is told; where there are more than a worker lets wait, some end before.
_TOLD_BEFORE = {"simulate", "lin", "nfr", "compare", "delays", "excite", "feedback"}
_FEW_RUNS = {"trim", "branches", "modes", "loop", "limit-cycle", "feed-forward", "run", "calibrate", "robust", "tune"}
# Without these calls there is a result, or it is there before them: call → for what, by interface ("" both).
SPARED: Mapping[str, Mapping[str, set[str]]] = {
    "getFMUstate": {"": {"simulate", "nfr", "compare"}, "cs": {"trim", "run"}},
    "terminate": {"": _TOLD_BEFORE, "me": _FEW_RUNS, "cs": {"trim", "run", "calibrate", "tune"}},
    "freeInstance": {"": _TOLD_BEFORE, "me": _FEW_RUNS, "cs": {"trim", "run", "calibrate", "tune"}},
    "unload": {"": set(DEEDS)},  # at the earliest when the results are there
}
# Other numbers are right where the record says why: what is done, call → words of a note, or of a check's evidence.
TOLD = {
    ("delays", "getFMUstate"): "snapshots fall back to replay",  # so that its steps have one length
    ("limit-cycle", "completedIntegratorStep"): "crossing 1: ",  # the refinement of a cycle fails, its prediction stays
    ("check", "getFMUstate"): "time limit: not finished",  # to be watched, not broken: it may be slow
}
READ_ONLY = {("export", "cs"), ("delays", "me")}  # no call at all: the description says everything
DEADLY = {"segfault", "abort", "exit0", "exit3", "hang"}


def expected(case: Case) -> set[str]:
    """Return the kinds of what a user may see; "ok" is a result with the right numbers."""
    spared = SPARED.get(case.call, {})
    without = spared.get("", set()) | spared.get(case.interface, set())
    if (case.what, case.interface) in READ_ONLY:
        return {"ok"}
    if case.way in DEADLY and case.what == "info":  # says what the description does, unless it waits for the probe
        return {"ok", "timed out"} if case.way == "hang" else {"ok"}
    if case.way in DEADLY:
        return {"ok"} if case.what in without else FITTING[case.way]
    if case.way in OWN:
        return {"ok", "told"} if case.what in COMPARING else {"ok", "own"}
    noticed = {"told"} if case.way in REMARKS else set()
    return FITTING.get(case.way, set()) | {"ok"} | noticed


# -- one case ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Case:
    """One FMU and what is done with it."""

    way: str
    call: str
    interface: str
    what: str

    @property
    def deed(self) -> Deed:
        """What is done."""
        return DEEDS[self.what]

    @property
    def timeout(self) -> float:
        """What a result may cost [s]: little, where it hangs before it is there."""
        waits = self.way == "hang" and self.call not in {"terminate", "freeInstance"}
        return self.deed.timeout if waits else PATIENT


@dataclass(frozen=True)
class Seen:
    """What a user saw: "ok" or the kind of error, words, and whether it is right."""

    kind: str
    words: str
    right: bool


def cases(asked: argparse.Namespace) -> Iterator[Case]:
    """Yield the cases that are asked for; with `some` of the deeds for each FMU, other ones from FMU to FMU."""
    for interface, calls in CALLS.items():
        lies = ((LIE, lie) for lie in LIES)
        deeds = [what for what in asked.what or DEEDS if interface in DEEDS[what].interfaces]
        turns = cycle(deeds)
        for call, way in (*((call, way) for call in (*calls, *OUTSIDE) for way in WAYS), *lies):
            chosen = deeds if asked.some is None else list(islice(turns, asked.some))
            if all(
                x in some or not some
                for x, some in ((interface, asked.interface), (way, asked.ways), (call, asked.calls))
            ):
                every = (Case(way, call, interface, what) for what in chosen)
                yield from (c for c in every if (not c.deed.subject if call == LIE else c.what != "sweep"))


def build(folder: Path, case: Case) -> Path:
    """Write the FMU of a case, and the file around it; return what is opened."""
    os.environ["MISBEHAVES"] = f"{{{case.way}@{case.call}}}" if case.call in OUTSIDE else ""
    fmu = build_lying(folder, case.way) if case.call == LIE else build_misbehaving(folder, case.way, case.call)
    if not case.deed.subject:
        return fmu
    limits = f"memory-limit = {MEMORY}" if case.way == "memory" else ""
    file = folder / f"{case.deed.subject}-{case.interface}.toml"
    for path, text in {file: SYSTEMS[case.deed.subject], **{folder / n: text for n, text in BESIDE.items()}}.items():
        path.write_text(textwrap.dedent(text.format(fmu=fmu, interface=case.interface, limits=limits)), "utf-8")
    return file


def in_python(file: Path, case: Case, truth: Any) -> Seen:
    """Do it with the function."""
    limits = Workers(jobs=1, timeout=case.timeout, memory_limit=MEMORY if case.way == "memory" else None)
    here = Path.cwd()
    try:
        data = plain(case.deed.function(file, case.interface, limits).to_dict())
    except wb.WorkbenchError as error:
        return Seen(error.kind, str(error), error.kind in expected(case))
    except Exception as error:  # noqa: BLE001 - what nobody may see
        return Seen("TRACEBACK", repr(error), right=False)
    if Path.cwd() != here:
        return Seen("MOVED", f"the caller is in {Path.cwd()}", right=False)
    kind, _, said = told(case, data, truth)
    return Seen(kind, said, kind in expected(case))


def on_command_line(file: Path, case: Case, truth: Any) -> Seen:
    """Do it with the command."""
    try:
        done = _run(file, case)
    except subprocess.TimeoutExpired:
        return Seen("STUCK", f"no end after {LONGEST:g} s", right=False)
    last = (done.stderr.strip().splitlines() or [""])[-1]
    if "Traceback" in done.stderr:
        return Seen("TRACEBACK", last, right=False)
    try:
        data = json.loads(done.stdout)
    except ValueError:
        return Seen(f"exit {done.returncode}, no JSON", last, right=False)
    kind, code, said = told(case, data, truth)
    if done.returncode != code:
        return Seen(f"{kind}, exit {done.returncode}", said or last, right=False)
    return Seen(kind, said, kind in expected(case) and (kind == "ok" or said != ""))


LONGEST = 300.0  # [s]: any command, with all the limits of its parts


def _run(file: Path, case: Case) -> subprocess.CompletedProcess[str]:
    line = case.deed.line.format(folder=file.parent).split()
    models = [str(file)] * (2 if case.what == "compare" else 1)
    words = [sys.executable, "-m", "workbench", case.deed.command or case.what, *models, *line, "--json", "-"]
    if case.what != "export":
        words += ["--timeout", str(case.timeout)]
    if case.way == "memory" and case.what not in {"export", "run"}:  # a study says so in its file
        words += ["--memory-limit", str(MEMORY)]
    if case.deed.subject == "" and case.what != "info" and case.deed.interfaces:
        words += ["--interface", case.interface]
    return subprocess.run(words, capture_output=True, text=True, cwd=ROOT, timeout=LONGEST, check=False)


def told(case: Case, data: Any, truth: Any) -> tuple[str, int, str]:
    """Return the kind of what a record tells, the exit code that fits, and words."""
    if "failure" in data:
        return data["failure"]["kind"], 2, data["failure"]["message"]
    notes = [
        *(data.get("notes") or ()),
        *(data.get("warnings") or ()),
        *(c["evidence"] for c in data.get("checks", ())),
    ]
    if why := str(case.deed.failed(data) or ""):
        words, said = REMARKS.get(case.way), (why, *notes) if case.what == "check" else (why,)
        return "told" if words and any(re.search(words, line) for line in said) else _kind_in(why), 1, why
    found = case.deed.numbers(data)
    if _same(found, truth, case.deed.tolerance):
        return "ok", 0, ""
    for words, kind in ((TOLD.get((case.what, case.call)), ""), (REMARKS.get(case.way), "told")):
        if words and (why := next((note for note in notes if re.search(words, note)), "")):
            return kind or _kind_in(why), 0, why
    if case.way in OWN and case.what not in COMPARING:
        return "own", 0, ""
    return "WRONG", 0, f"{found} in place of {truth}; {notes}"


def _kind_in(reason: str) -> str:
    """Return the kind of error that a point's reason tells."""
    for words, kind in (
        ("crashed", "crashed"), ("aborted", "crashed"), ("killed", "crashed"), ("ended its process", "exited"),
        ("time limit", "timed out"), ("memory", "out of memory"),
    ):  # fmt: skip
        if words in reason:
            return kind
    return "failed"


def _same(a: Any, b: Any, tolerance: float) -> bool:
    """Whether two results are equal, but for what names the file."""
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(
            _same(a[k], b[k], tolerance) for k in a if k not in {"model", "model_sha256"}
        )
    if isinstance(a, list) and isinstance(b, list):
        return len(a) == len(b) and all(_same(x, y, tolerance) for x, y in zip(a, b, strict=True))
    if isinstance(a, float) and isinstance(b, float):
        return math.isclose(a, b, rel_tol=tolerance, abs_tol=1e-12)
    return bool(a == b)


def truth_of(folder: Path, case: Case, *, program: bool) -> Any:
    """Return the numbers of the same FMU that behaves, done in the same way."""
    well = replace(case, way="honest") if case.call == LIE else replace(case, way="nothing", call="never")
    file = build(folder, well)
    if program:
        done = _run(file, well)
        if done.returncode != 0:
            raise SystemExit(f"{well}: exit {done.returncode}: {done.stderr}")
        return well.deed.numbers(json.loads(done.stdout))
    data = plain(well.deed.function(file, well.interface, Workers(jobs=1)).to_dict())
    assert not well.deed.failed(data), well  # noqa: S101
    return well.deed.numbers(data)


# -- all of them ------------------------------------------------------------------------------------------


def main() -> None:
    """Run the cases and write the page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    for name in ("ways", "calls", "what", "interface"):
        parser.add_argument(f"--{name}", type=lambda text: text.split(","), default=[])
    parser.add_argument("--some", type=int, help="so many of the deeds for each FMU, by turns; by default all")
    parser.add_argument("--program", action="store_true", help="on the command line in place of in Python")
    parser.add_argument("--out", type=Path, help="page to write, Markdown")
    asked = parser.parse_args()
    run = on_command_line if asked.program else in_python
    found: dict[Case, Seen] = {}
    begin = time.monotonic()
    with tempfile.TemporaryDirectory() as name:
        if shutil.which("localedef"):  # for "_comma"
            line = ["localedef", "-i", "de_DE", "-f", "UTF-8", f"{name}/de_DE.UTF-8"]
            subprocess.run(line, check=True)
            os.environ["LOCPATH"] = name
        truths: dict[tuple[str, str, bool], Any] = {}
        for case in cases(asked):
            key = case.interface, case.what, case.call == LIE
            if key not in truths:
                truths[key] = truth_of(Path(name), case, program=asked.program)
            seen = found[case] = run(build(Path(name), case), case, truths[key])
            if not seen.right:
                print(f"NOT RIGHT {case}: {seen.kind}: {seen.words[:300]}", flush=True)
    text = "\n".join(_page(found))
    if asked.out is not None:
        asked.out.write_text(text + "\n", encoding="utf-8")
    wrong = sum(not seen.right for seen in found.values())
    print(f"{len(found)} cases, {wrong} not right, {time.monotonic() - begin:.0f} s")
    sys.exit(1 if wrong else 0)


def _page(found: Mapping[Case, Seen]) -> Iterator[str]:
    deeds = list(dict.fromkeys(case.what for case in found))
    yield f"| FMU | {' | '.join(deeds)} |"
    yield f"| --- | {' | '.join('---' for _ in deeds)} |"
    for interface, call, way in dict.fromkeys((c.interface, c.call, c.way) for c in found):
        seen = (found.get(Case(way, call, interface, what)) for what in deeds)
        yield f"| {way} in {call} ({interface}) | {' | '.join('–' if s is None else s.kind for s in seen)} |"


if __name__ == "__main__":
    main()

"""Studies from file to verdict on bundled FMUs: grid, references, store, crashes, JUnit, report."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Callable, Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest

import workbench as wb
from tests.fmi3_fmus import build_sized
from tests.hostile_fmus import build_hostile
from workbench.cli.app import run
from workbench.fmi.bundled import bundled_path
from workbench.jobs.end_signals import INTERRUPTED
from workbench.jobs.job import Job
from workbench.jobs.options import Workers
from workbench.study import worker
from workbench.study.plan import RunResult
from workbench.study.result import StudyResult
from workbench.study.run import StudyRun
from workbench.study.worker import CommandJob, perform

GRID = """
name = "lags"
[models]
lag = "lag.fmu"
[configurations]
fmi2 = {}
fmi3 = {lag = {model = "fmu:FirstOrderLag@3"}}
[grid]
lag.tau = [0.5, 2.0]

[analyses.response]
command = "nfr"
model = "lag"
input = "u"
output = "y"
freq = [0.05, 0.1591549430918953]
amplitude = [1]

[analyses.facts]
command = "info"
model = "lag"

[[requirements]]
name = "corner"
analysis = "response"
kind = "gain"
frequency = 0.1591549430918953     # 1 rad/s
min = -5

[[requirements]]
name = "slow lag"
analysis = "response"
kind = "gain"
frequency = 0.1591549430918953
equal = -6.9897                    # 1/(1 + 2j)
tolerance = 0.001
grid = {"lag.tau" = 2.0}
configurations = ["fmi3"]

[[requirements]]
name = "it runs"
analysis = "facts"
kind = "value"
path = "runnable"
equal = true
"""


RING = """
models.m = "ring.toml"
[analyses]
usual = {command = "simulate", model = "m", stop = 40.0, input = {u = "step:time=0,value=1"}, output = ["y"]}
[analyses.coarse]
command = "simulate"
model = "m"
stop = 40.0
step = 0.08
input = {u = "step:time=0,value=1"}
output = ["y"]
[[requirements]]
name = "usual"
analysis = "usual"
kind = "overshoot"
final = 1.0
max = 5.0
[[requirements]]
name = "coarse"
analysis = "coarse"
kind = "overshoot"
final = 1.0
max = 5.0
[[requirements]]
name = "peak"
analysis = "usual"
kind = "peak"
max = 1.5
"""


def ring_system() -> tuple[str, float]:
    """A slow motion and one of 12.5 Hz, which rows every 0.08 s meet at the same phase; and its overshoot [%]."""
    slow, fast = 2.0 * math.pi * 0.05, 2.0 * math.pi * 12.5
    parts = [(0.8, 0.9, slow), (0.2, 2e-4, fast)]
    tops = [np.array([k * w * w]) for k, _, w in parts]
    bottoms = [np.array([1.0, 2.0 * z * w, w * w]) for _, z, w in parts]
    numerator = np.polyadd(np.polymul(tops[0], bottoms[1]), np.polymul(tops[1], bottoms[0]))
    denominator = np.polymul(*bottoms)
    t = np.linspace(0.0, 40.0, 400_001)
    y = np.zeros(len(t))
    for k, z, w in parts:
        r = math.sqrt(1.0 - z * z)
        y += k * (1.0 - np.exp(-z * w * t) * (np.cos(w * r * t) + z / r * np.sin(w * r * t)))
    block = f"{{numerator = {numerator.tolist()}, denominator = {denominator.tolist()}}}"
    text = f'[components]\np = {block}\n[inputs]\nu = "p.u"\n[outputs]\ny = "p.y"\n'
    return text, 100.0 * (float(y.max()) - 1.0)


def test_an_oscillation_that_all_rows_meet_at_one_phase_is_seen(tmp_path: Path) -> None:
    text, overshoot = ring_system()
    (tmp_path / "ring.toml").write_text(text, encoding="utf-8")
    found = wb.run_study(study(tmp_path, RING), store=None, jobs=1)
    assert repr(found).startswith(f"<StudyResult: {found.study.name}. ")
    assert len(repr(found)) < 700
    assert found == found  # noqa: PLR0124 - its runs hold arrays
    usual, coarse, peak = (next(c.finding for c in found.checked if c.name == n) for n in ("usual", "coarse", "peak"))
    # Over 500 swings the tolerance of the solver leaves 0.03 %; with steps of 1 ms, too.
    assert usual.value == pytest.approx(overshoot, abs=0.05)
    assert not usual.passed
    assert peak.value == pytest.approx(1.0 + overshoot / 100.0, abs=5e-4)
    # Rows that were asked for are kept; what they leave out decides that nothing is known.
    assert not coarse.passed
    assert "which lies between the rows" in coarse.reason


CYCLES = """
models.m = "cycles.toml"
analyses.lc = {command = "limit-cycle", model = "m", block = "N", output = ["y"]}
[[requirements]]
name = "of y"
analysis = "lc"
kind = "limit cycle amplitude"
signal = "y"
max = 5.0
[[requirements]]
name = "of the block"
analysis = "lc"
kind = "limit cycle amplitude"
max = 5.0
"""

LIENARD = """
[components]
P = {numerator = [1.0, 0.0], denominator = [1.0, 0.04, 1.0]}
e = {sum = "+-"}
[components.N]
block = "lookup"
x = [-40.0, -7.0, -3.0, -1.0, 0.0, 1.0, 3.0, 7.0, 40.0]
y = [-29.6, 3.4, -1.4, 1.0, 0.0, -1.0, 1.4, -3.4, 29.6]
extrapolation = "linear"
[connections]
"e.u2" = "N.y"
"P.u" = "e.y"
"N.u" = "P.y"
[inputs]
r = "e.u1"
[outputs]
y = "P.y"
"""


def test_the_largest_of_several_stable_cycles_counts_for_a_signal(tmp_path: Path) -> None:
    (tmp_path / "cycles.toml").write_text(LIENARD, encoding="utf-8")
    found = wb.run_study(study(tmp_path, CYCLES), store=None, jobs=1)
    # By integration from 15 (SciPy, 1e-9) the motion tends to 11.667; y is what the block takes.
    for checked in found.checked:
        assert checked.finding.value == pytest.approx(11.667, abs=0.02)
        assert not checked.finding.passed


def study(tmp_path: Path, text: str) -> str:
    path = tmp_path / "study.toml"
    path.write_text(text, encoding="utf-8")
    return str(path)


def measured(tmp_path: Path, text: str, *options: str, jobs: str = "1") -> tuple[int, dict[str, Any]]:
    out = tmp_path / "out.json"
    code = run(["run", study(tmp_path, text), "--json", str(out), "--jobs", jobs, *options])
    return code, json.loads(out.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def grid(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, int, dict[str, Any]]:
    """A study of four points, run once."""
    folder = tmp_path_factory.mktemp("grid")
    shutil.copy(bundled_path("fmu:FirstOrderLag"), folder / "lag.fmu")
    files = [x for kind in ("junit.xml", "report.html", "csv") for x in (f"--{kind.split('.')[0]}", str(folder / kind))]
    code, found = measured(folder, GRID, *files, jobs="2")
    return folder, code, found


def test_every_point_of_the_grid_is_judged(grid: tuple[Path, int, dict[str, Any]]) -> None:
    _, code, found = grid
    assert code == 1
    rows = {(r["name"], r["point"]): r for r in found["requirements"]}
    corner = {p: r for (name, p), r in rows.items() if name == "corner"}
    assert {p: r["passed"] for p, r in corner.items()} == {
        "fmi2, lag.tau = 0.5": True, "fmi2, lag.tau = 2": False,
        "fmi3, lag.tau = 0.5": True, "fmi3, lag.tau = 2": False,
    }  # fmt: skip
    # |1/(1 + 0.5j)| and |1/(1 + 2j)| in dB.
    assert corner["fmi2, lag.tau = 0.5"]["value"] == pytest.approx(-0.9691, abs=1e-4)
    assert corner["fmi3, lag.tau = 2"]["value"] == pytest.approx(-6.9897, abs=1e-4)
    assert corner["fmi3, lag.tau = 2"]["margin"] == pytest.approx(-1.9897, abs=1e-4)
    assert [p for name, p in rows if name == "slow lag"] == ["fmi3, lag.tau = 2"]
    # What the command cannot set is seen once for each FMU, and said.
    assert sorted(p for name, p in rows if name == "it runs") == ["fmi2, lag.tau = 0.5", "fmi3, lag.tau = 0.5"]
    assert any("'info' has no option set" in note for note in found["notes"])


def test_json_tells_all(grid: tuple[Path, int, dict[str, Any]]) -> None:
    _, _, found = grid
    assert {"command", "version", "seconds", "study", "passed", "requirements", "analyses"} <= set(found)
    assert {"name", "value", "limit", "passed", "margin", "where"} <= set(found["requirements"][0])
    assert (found["measured"], found["reused"], found["missing"]) == (6, 0, 0)
    first = found["analyses"][0]
    assert first["result"]["command"] == "nfr"
    assert "workbench nfr lag.fmu --set=lag" not in first["command_line"]
    assert "--set=tau=0.5" in first["command_line"]
    assert first["parameters"] == {"lag.tau": 0.5}


def test_junit_is_read_back(grid: tuple[Path, int, dict[str, Any]]) -> None:
    folder, _, found = grid
    root = ET.parse(folder / "junit.xml").getroot()  # noqa: S314 - we wrote it
    assert root.tag == "testsuites"
    (suite,) = root
    cases = suite.findall("testcase")
    assert len(cases) == len(found["requirements"]) == int(suite.attrib["tests"]) == int(root.attrib["tests"])
    failed = {c.attrib["name"]: c.find("failure") for c in cases if c.find("failure") is not None}
    assert set(failed) == {"corner (fmi2, lag.tau = 2)", "corner (fmi3, lag.tau = 2)"}
    assert int(suite.attrib["failures"]) == 2
    message = failed["corner (fmi2, lag.tau = 2)"]
    assert message is not None
    assert message.attrib["message"] == "-6.9897 dB, limit ≥ -5 dB (0.1592 Hz)"
    assert all(float(c.attrib["time"]) >= 0.0 for c in cases)
    assert {c.attrib["classname"] for c in cases} == {"lags.response", "lags.facts"}


def test_the_report_names_the_violation_first(grid: tuple[Path, int, dict[str, Any]]) -> None:
    folder, _, _ = grid
    text = (folder / "report.html").read_text(encoding="utf-8")
    body = text[text.index("<body") :]
    assert "http://" not in text.replace("http://www.w3.org", "")
    assert body.index("corner (fmi2, lag.tau = 2)") < body.index("it runs")
    assert body.index("2 of 7 requirements are not met: corner") < body.index("passed")
    rows = (folder / "csv").read_text(encoding="utf-8").splitlines()
    assert len(rows) == 8
    assert rows[0].startswith("requirement,point,kind,analysis,value,unit,min,max")


def test_the_second_run_measures_nothing(
    grid: tuple[Path, int, dict[str, Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, code, found = grid

    def forbidden(*_: object, **__: object) -> None:
        raise AssertionError("a worker was started")

    monkeypatch.setattr("workbench.jobs.pool.Pool.run", forbidden)
    monkeypatch.setattr("workbench.study.names.check_names", forbidden)
    again, second = measured(folder, GRID)
    assert (again, second["measured"], second["reused"]) == (code, 0, 6)
    assert second["requirements"] == found["requirements"]
    assert [a["result"] for a in second["analyses"]] == [a["result"] for a in found["analyses"]]


def test_another_limit_measures_nothing(grid: tuple[Path, int, dict[str, Any]]) -> None:
    folder, _, _ = grid
    code, found = measured(folder, GRID.replace("min = -5", "min = -8"))
    assert (code, found["measured"], found["passed"]) == (0, 0, True)


def test_another_way_of_writing_the_same_measures_nothing(tmp_path: Path) -> None:
    """What is asked for names a result, not its words; another band, amplitude or tolerance is something else."""
    shutil.copy(bundled_path("fmu:FirstOrderLag"), tmp_path / "lag.fmu")
    text = """
    [analyses.response]
    command = "nfr"
    model = "lag.fmu"
    input = "u"
    output = "y"
    band = [0.5, 2]
    amplitude = [1]
    """

    def reused(*changes: tuple[str, str], more: str = "") -> bool:
        changed = text
        for old, new in changes:
            assert old in changed
            changed = changed.replace(old, new)
        return bool(measured(tmp_path, changed + more)[1]["reused"] == 1)

    assert not reused()
    for same in (("[0.5, 2]", '"0.50:2"'), ("[1]", "[1.0]"), ("[1]", "1"), ("[1]", '"1e0"')):
        assert reused(same), same
    assert reused(more="tolerance = 1e-8\nmax-periods = 20\n")  # both are what is used without
    for other in (("[0.5, 2]", "[0.5, 3]"), ("[1]", "[2]")):
        assert not reused(other), other
    assert not reused(more="tolerance = 1e-7\n")
    with (tmp_path / "lag.fmu").open("ab") as file:
        file.write(b"a comment at the end of the archive")
    assert not reused()


def test_a_changed_fmu_and_a_changed_option_are_measured_again(grid: tuple[Path, int, dict[str, Any]]) -> None:
    folder, _, _ = grid
    one = GRID.replace("[0.5, 2.0]", "[0.5]").replace('grid = {"lag.tau" = 2.0}\n', "")
    _, found = measured(folder, one.replace("amplitude = [1]", "amplitude = [2]"))
    # The responses; that of fmi3 too, but no facts.
    assert (found["measured"], found["reused"]) == (2, 2)
    with (folder / "lag.fmu").open("ab") as file:
        file.write(b"another comment at the end of the archive")
    _, found = measured(folder, one)
    assert {a["name"]: a["reused"] for a in found["analyses"] if a["configuration"] == "fmi2"} == {
        "response": False, "facts": False,
    }  # fmt: skip
    assert all(a["reused"] for a in found["analyses"] if a["configuration"] == "fmi3")


# -- one analysis takes what another one wrote ---------------------------------------------------

CHAIN = """
[models]
lag = {model = "fmu:FirstOrderLag", set = {tau = 0.5}}
[analyses.linear]                      # stands before what it needs
command = "lin"
model = "lag"
at = {from = "point"}
[analyses.point]
command = "trim"
model = "lag"
u0 = {u = 2}
[analyses.data]
command = "excite"
model = "lag"
input = "u"
output = "y"
prbs = {amplitude = 1, seed = 3}
step = 0.05
samples = 400
[analyses.model]
command = "identify"
data = {from = "data", as = "csv"}
validate = {from = "data", as = "validation"}
input = "u"
output = "y"
order = 1
[[requirements]]
name = "pole"
analysis = "linear"
kind = "stability"
equal = -2
tolerance = 1e-6
[[requirements]]
name = "at the point"
analysis = "linear"
kind = "value"
path = "x0.x"
equal = 2
tolerance = 1e-6
[[requirements]]
name = "fit"
analysis = "model"
kind = "fit"
min = 99.9
[[requirements]]
name = "same"
analysis = "model"
with = "linear"
kind = "response agreement"
db = 1e-3
deg = 1e-2
band = [0.1, 2]
"""


def test_results_go_from_one_analysis_to_the_other(tmp_path: Path) -> None:
    code, found = measured(tmp_path, CHAIN)
    assert (code, found["passed"]) == (0, True), found["requirements"]
    # Of a changed study only what depends on the change is measured.
    _, second = measured(tmp_path, CHAIN.replace("u = 2", "u = 3").replace("equal = 2", "equal = 3"))
    assert {a["name"] for a in second["analyses"] if not a["reused"]} == {"point", "linear"}
    assert second["passed"]
    assert not list((tmp_path / ".workbench-store" / "unfinished").iterdir())
    assert (tmp_path / ".workbench-store" / ".gitignore").read_text(encoding="utf-8") == "*\n"


# -- what fails ----------------------------------------------------------------------------------


def test_a_crash_fails_its_requirements_and_the_others_go_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    build_hostile(tmp_path, "segfault-at-start").rename(tmp_path / "bad.fmu")
    text = """
    [models]
    bad = "bad.fmu"
    good = "fmu:FirstOrderLag"
    [analyses.crash]
    command = "lin"
    model = "bad"
    [analyses.after]
    command = "identify"
    data = {from = "crash"}
    [analyses.fine]
    command = "trim"
    model = "good"
    [[requirements]]
    name = "stable"
    analysis = "crash"
    kind = "stability"
    max = 0
    [[requirements]]
    name = "at rest"
    analysis = "fine"
    kind = "value"
    path = "converged"
    equal = true
    """
    junit = tmp_path / "junit.xml"
    code, found = measured(tmp_path, text, "--junit", str(junit))
    assert code == 1
    stable, rest = found["requirements"]
    assert (stable["passed"], stable["value"]) == (False, None)
    assert "crash failed: the FMU crashed: segmentation fault" in stable["reason"]
    assert rest["passed"]
    failed = {a["name"]: a["failed"] for a in found["analyses"]}
    assert failed["after"].startswith("it needs crash, which failed: the FMU crashed")
    assert "stable: crash failed" in capsys.readouterr().out
    suite = ET.parse(junit).getroot()[0]  # noqa: S314 - we wrote it
    assert {c.attrib["name"] for c in suite.findall("testcase") if c.find("error") is not None} == {
        "stable", "analysis after",
    }  # fmt: skip


def test_a_crash_is_not_kept_but_failed_points_are() -> None:
    assert not RunResult(reason="the FMU crashed").lasting
    assert not RunResult(result={}, code=130).lasting
    assert RunResult(result={}, code=1).lasting


def test_what_cannot_be_done_at_any_point_is_bad_input(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = '[analyses.a]\ncommand = "loop"\nmodel = "fmu:FirstOrderLag"\nopen = "x.y"\n'
    path = study(tmp_path, text)
    assert run(["run", path]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"workbench: {path}: line 1: [analyses.a]: ")


def test_a_signal_before_the_store_is_open_ends_the_study(tmp_path: Path) -> None:
    """It came while the first file was read, and was forgotten."""
    shutil.copy(bundled_path("fmu:FirstOrderLag"), tmp_path / "lag.fmu")
    prepared = StudyRun(study(tmp_path, GRID), store=tmp_path / "store")
    job = Job()
    with job.ended_by():
        job.stop()
    result = prepared.run(lambda: Workers(jobs=1), job)
    assert (result.measured, result.missing) == (0, prepared.total)


@pytest.mark.parametrize(("where", "continues"), [(["--no-store"], False), (["--store", "kept"], True)])
def test_the_same_command_continues_where_something_is_kept(
    where: list[str],
    continues: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    shutil.copy(bundled_path("fmu:FirstOrderLag"), tmp_path / "lag.fmu")
    whole = StudyRun.run

    def stopped(self: StudyRun, workers: Callable[[], Workers], job: Job, **more: Any) -> StudyResult:  # noqa: ANN401
        with job.ended_by():
            job.stop()
        return whole(self, workers, job, **more)

    monkeypatch.setattr(StudyRun, "run", stopped)
    monkeypatch.chdir(tmp_path)
    assert run(["run", study(tmp_path, GRID), *where]) == INTERRUPTED
    assert ("the same command continues" in capsys.readouterr().err) == continues


# -- models that stay open ------------------------------------------------------------------------

LOOP = """
[components]
plant = "plant.fmu"
gain = {gain = -1.0, units = {u = "1", y = "1"}}
limit = {block = "saturation", upper = 2.0, lower = -2.0}
[connections]
"gain.u" = "plant.y"
"limit.u" = "gain.y"
"plant.u" = "limit.y"
[outputs]
y = "plant.y"
"""


def answered(folder: Path, subject: str, given: dict[str, Any], files: dict[str, str]) -> dict[str, Any]:
    job = CommandJob(
        number=0, command="simulate", subject=[subject], options={"stop": 1.0, "set": given, "output": ["y"]},
        command_line="", folder=folder, workplace=folder, csv="", files=files,
    )  # fmt: skip
    (outcome,) = perform(None, job)
    found = asdict(replace(outcome, seconds=0.0))
    (found["result"] or {}).pop("seconds", None)
    return found


@pytest.fixture
def models(tmp_path: Path) -> Iterator[Path]:
    shutil.copy(bundled_path("fmu:FirstOrderLag"), tmp_path / "plant.fmu")
    build_sized(tmp_path)
    (tmp_path / "loop.toml").write_text(LOOP, encoding="utf-8")
    (tmp_path / "out").mkdir()
    yield tmp_path
    while worker._open:
        worker._open.pop()[1].close()


def test_a_model_that_stays_open_answers_as_one_opened_anew(models: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Parameters of FMUs and blocks, arrays, items, units, sizes and what is wrong, in any order, twice."""
    sized = next(f.name for f in models.glob("*.fmu") if f.name != "plant.fmu")
    asked: list[tuple[str, dict[str, Any]]] = [
        ("loop.toml", {"plant.tau": 0.5, "plant.x": 1}),
        ("loop.toml", {}),
        ("loop.toml", {"plant.tau": 2, "gain.gain": -3.0, "plant.x": 1.0}),
        ("loop.toml", {"limit.upper": 0.1, "gain.gain": 3.0, "plant.x": 1.0}),
        ("loop.toml", {"plant.tua": 0.5}),
        ("loop.toml", {"plant.tau": "fast"}),
        ("plant.fmu", {"tau": 0.5, "x": 2.0}),
        ("plant.fmu", {"tau": "500ms", "x": 2.0}),
        ("plant.fmu", {}),
        (sized, {"a": [1.0, 2.0], "mode": "sport"}),
        (sized, {"n": 3}),
        (sized, {"n": 99}),
        (sized, {"mode": "flying"}),
        (sized, {}),
    ]
    monkeypatch.setattr(worker, "_open", [])
    anew = [answered(models, subject, given, {}) for subject, given in asked]
    assert not worker._open
    for _ in range(2):
        assert [answered(models, subject, given, {"a": "1"}) for subject, given in asked] == anew
    assert len(worker._open) == 3
    good = [json.dumps(a["result"]["signals"], sort_keys=True) for a in anew if a["result"]]
    assert len(set(good)) == 7  # those without inputs that move them are alike


def test_a_model_whose_file_has_changed_is_opened_anew(models: Path) -> None:
    first = answered(models, "plant.fmu", {"x": 1.0}, {"plant.fmu": "1"})
    shutil.copy(bundled_path("fmu:FirstOrderLag@3"), models / "plant.fmu")
    second = answered(models, "plant.fmu", {"x": 1.0}, {"plant.fmu": "2"})
    paths = [found["result"]["operating_point"]["model_sha256"] for found in (first, second)]
    assert paths[0] != paths[1]


def test_no_more_than_a_few_models_stay_open(models: Path) -> None:
    for k in range(7):
        assert answered(models, "plant.fmu", {"x": 1.0}, {"plant.fmu": str(k)})["result"] is not None
    assert len(worker._open) == worker._MOST_OPEN

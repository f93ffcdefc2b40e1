"""What a worker has to tell of an FMU stands in the record of every command that runs one, and on its report."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import workbench as wb
from tests.command_lines import BRAKED, ENVELOPE, LAG_FMU, LAGS, LINES, LOOP, MASTER, TUNED, WANTED
from tests.misbehaving_fmus import build_misbehaving
from workbench.cli.app import run
from workbench.commands import REQUESTS, request_of

# Commands that run no FMU.
WITHOUT = {"identify", "fit", "blocks", "build", "compile", "export"}
RATE_LIMITED = """
[components]
lag = "fmu:FirstOrderLag"
limiter = {block = "rate_limiter", rising = 0.5}
integral = {block = "integrator"}
error = {sum = "+-"}
[connections]
"lag.u" = "error.y"
"limiter.u" = "lag.y"
"integral.u" = "limiter.y"
"error.u2" = "integral.y"
[inputs]
stick = "error.u1"
[outputs]
y = "integral.y"
"""
# The misbehaving FMU has no parameters; what varies is its input.
ARGUMENTS = {
    **{name: line.split(maxsplit=1)[1] for name, (line, _) in LINES.items() if name not in WITHOUT},
    "info": f"{LAG_FMU}",
    "simulate": f"{LAG_FMU} --stop 1 --input u=1",
    "lin": f"{LAG_FMU}",
    "lin --over": f"{LAG_FMU} --over u=0.5,1",
    "lin --compare": f"{LAG_FMU} --compare --freq 0.1",
    "lin --interface cs": f"{LAG_FMU} --interface cs --step 0.01 --period 0.05 --points 40",
    "modes": f"{LAG_FMU} --vary u=0.5:2 --points 3",
    "robust": f"{LAG_FMU} --uncertain u=0.5:1.5",
    "calibrate": f"{LAG_FMU} data.csv --free x --input u --output y",
    "onset": "limited.toml --input stick --limiter limiter --amplitude 0.1,1.1 --band 0.05:0.5",
}
ARITHMETIC = "the FMU changed the arithmetic of its process"
CRASHED = "when all was told, the FMU crashed"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("MISBEHAVES", "")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def words_of(folder: Path, what: str, way: str, call: str) -> list[str]:
    """Return the command line, its FMUs exchanged for one that misbehaves, and write its files."""
    made = build_misbehaving(folder, way, call).rename(folder / "bad.fmu")
    systems = {"envelope": ENVELOPE, "lags": LAGS, "loop": LOOP, "braked": BRAKED, "master": MASTER}
    systems |= {"tuned": TUNED, "wanted": WANTED}
    for name, text in {**systems, "limited": RATE_LIMITED}.items():
        bad = text.replace(LAG_FMU, made.name).replace('"lag.tau" = {range', '"lag.u" = {range')
        (folder / f"{name}.toml").write_text(bad, encoding="utf-8")
    (folder / "data.csv").write_text("time,u,y\n0,1,0\n0.1,1,1\n0.2,0,0\n0.3,1,2\n", encoding="utf-8")
    line = ARGUMENTS[what].replace(LAG_FMU, made.name).replace(" --in-process", "")
    name = what.split(maxsplit=1)[0]
    return [request_of(name).command, *line.split()]


def test_every_command_that_runs_an_fmu_is_here() -> None:
    assert {what.split()[0] for what in ARGUMENTS} | WITHOUT == set(REQUESTS)


@pytest.mark.parametrize("what", ARGUMENTS)
def test_what_a_worker_tells_stands_in_the_record_and_its_report(folder: Path, what: str) -> None:
    words = words_of(folder, what, "_arithmetic", "instantiate")
    assert run([*words, "--json", "out.json", "--report", "out.html"]) in (0, 1)
    record = json.loads((folder / "out.json").read_text())
    assert any(ARITHMETIC in note for note in [*record.get("notes", ()), *record.get("warnings", ())])
    assert ARITHMETIC in (folder / "out.html").read_text()


@pytest.mark.parametrize(
    ("what", "way", "call", "told"),
    [
        *((what, "segfault", "terminate", CRASHED) for what in ("lin", "lin --over", "check", "modes", "nfr")),
        *((what, "stdout", "instantiate", "the FMU printed") for what in ("lin", "lin --over", "branches", "check")),
    ],
)
def test_a_crash_when_all_was_told_and_what_was_printed_stand_there_too(
    folder: Path, what: str, way: str, call: str, told: str
) -> None:
    assert run([*words_of(folder, what, way, call), "--json", "out.json"]) in (0, 1)
    record = json.loads((folder / "out.json").read_text())
    notes = [*record.get("notes", ()), *record.get("warnings", ())]
    assert any(note.startswith(told) for note in notes), notes


@pytest.mark.parametrize(
    ("what", "call"),
    [
        *((what, "terminate") for what in ARGUMENTS),
        *((what, "freeInstance") for what in ("check", "lin", "modes", "nfr")),
    ],
)
def test_no_answer_is_lost_where_the_fmu_crashes_at_its_end(folder: Path, what: str, call: str) -> None:
    assert run([*words_of(folder, what, "segfault", call), "--json", "out.json"]) in (0, 1)
    record = json.loads((folder / "out.json").read_text())
    assert "failure" not in record
    assert not record.get("failed")
    told = (folder / "out.json").read_text()
    assert CRASHED in told or "crashed" not in told


def test_in_python_and_in_a_study_it_is_the_same(folder: Path) -> None:
    words_of(folder, "lin", "_arithmetic", "instantiate")
    with wb.load("bad.fmu") as model:
        assert any(ARITHMETIC in note for note in wb.lin(model).result.notes)
        assert any(ARITHMETIC in note for note in wb.lin_over(model, over={"u": [0.5, 1.0]}).notes)
    (folder / "study.toml").write_text(
        'models.bad = "bad.fmu"\nanalyses.linear = {command = "lin", model = "bad"}\n'
        'requirements = [{name = "stable", analysis = "linear", kind = "stability", max = 0.0}]\n'
    )
    assert run(["run", "study.toml", "--json", "study.json"]) == 0
    assert ARITHMETIC in (folder / "study.json").read_text()

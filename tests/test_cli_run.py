"""`workbench run`: options, exit codes, the bundled studies."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

import pytest

from workbench.cli.app import run
from workbench.cli.program import program
from workbench.commands import COMMANDS as PROGRAM
from workbench.commands import REQUESTS
from workbench.errors import InputError
from workbench.study.commands import COMMANDS, Reference, command
from workbench.study.plan import PlannedRun, make_plan
from workbench.study.read import bundled_studies, read_study
from workbench.study.run import run_study
from workbench.study.worker import CommandJob, perform

FACTS = """
[analyses.facts]
command = "info"
model = "fmu:FirstOrderLag"
probe = false
[[requirements]]
name = "inputs"
analysis = "facts"
kind = "value"
path = "inputs"
count = true
equal = 1
tolerance = 0
"""


@pytest.fixture
def facts(tmp_path: Path) -> Path:
    path = tmp_path / "facts.toml"
    path.write_text(FACTS, encoding="utf-8")
    return path


def test_every_command_with_a_result_can_be_an_analysis() -> None:
    assert set(COMMANDS) | {"run", "schema", "ui"} == set(PROGRAM)
    assert all(command(name).options for name in REQUESTS)


def test_a_study_knows_the_options_of_every_command() -> None:
    """What the program reads, but those that a study gives itself: results and help."""
    for name in COMMANDS:
        parameters = program(name).params
        spelt = {o.lstrip("-") for p in parameters if p.param_type_name == "option" for o in p.opts}
        known = [command(request) for request in PROGRAM[name]]
        flags = {c.request.chosen_by.lstrip("-") for c in known} - {""}
        assert set().union(flags, *(c.options for c in known)) == spelt - {"json", "help"}, name


@pytest.mark.parametrize(
    ("name", "options", "expected"),
    [
        ("nfr", {"amplitude": [1, 2.5], "band": [0.5, 20]}, ["--amplitude=1,2.5", "--band=0.5:20"]),
        ("nfr", {"amplitude": 1, "band": "0.5:20"}, ["--amplitude=1", "--band=0.5:20"]),
        ("nfr", {"carry": True, "offset": True}, ["--carry", "--offset"]),
        ("nfr", {"drift-check": False}, ["--no-drift-check"]),
        ("nfr", {"max_periods": 5, "set": {"k": 2, "on": True}}, ["--max-periods=5", "--set=k=2", "--set=on=true"]),
        ("simulate", {"input": {"u": "step:time=0,value=2"}}, ["--input=u=step:time=0,value=2"]),
        ("simulate", {"input": {"u": 2}}, ["--input=u=2.0"]),
        ("simulate", {"output": ["a", "b"]}, ["--output=a", "--output=b"]),
        ("lin", {"over": {"k": [1, 2]}, "dx": [1, 2]}, ["--over=k=1,2", "--dx=1,2"]),
        ("trim", {"bound": {"x": [-1, 1]}}, ["--bound=x=-1:1"]),
        ("modes", {"against": [{"k": 1, "m": 2}, {"k": 3}]}, ["--against=k=1,m=2", "--against=k=3"]),
        ("excite", {"prbs": {"amplitude": [1, 2], "seed": 3}}, ["--prbs=amplitude=1.0:2.0,seed=3"]),
        ("identify", {"data": "a.csv", "order": 3}, ["a.csv", "--order=3"]),
        ("lin", {"at": Reference(analysis="point")}, ["--at=point.json"]),
        ("compare", {"window": [[0, 1], [1, 2]], "set": {"k": True}}, ["--window=0:1", "--window=1:2", "--set=k=true"]),
    ],
)  # fmt: skip
def test_options_as_a_command_line_has_them(name: str, options: dict[str, Any], expected: list[str]) -> None:
    known = command(name)
    assert [word for key, value in options.items() for word in known.words(known.key(key), value)] == expected


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"carry": 1}, "key 'carry' is true or false, not 1"),
        ({"input": True}, "key 'input' takes a value"),
        ({"ratio": [1, 2]}, "key 'ratio' takes one value"),
        ({"input": [["a"]]}, "key 'input' takes one value"),
        ({"band": [0.5]}, "key 'band': "),
        ({"band": ["low", 1]}, "key 'band': "),
        ({"band": "0.5-20"}, "key 'band': '0.5-20' is not of the form LO:HI"),
        ({"freq": [[1]]}, "key 'freq': '[1]' is not a number"),
        ({"tolerance": -1}, "key 'tolerance': -1 is not a positive number"),
        ({"max-periods": 2.5}, "key 'max-periods': 2.5 is not a whole number"),
        ({"set": {"k": [1]}, "interface": "ms"}, "key 'interface': 'ms' is unknown; known: auto, cs, me"),
        ({"at": 3, "timeout": "long"}, "key 'timeout': 'long' is not a number"),
    ],
)
def test_values_that_an_option_cannot_take(options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as caught:
        command("nfr").values(options)
    assert message in str(caught.value)


def test_an_analysis_of_a_study_runs_silently(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    ended, missing = (
        outcome
        for model in ("FirstOrderLag", "FirstOrderLog")
        for outcome in perform(
            None,
            CommandJob(
                number=0, command="trim", subject=[f"fmu:{model}"], options={}, command_line="", folder=tmp_path,
                workplace=tmp_path, csv="",
            ),
        )
    )  # fmt: skip
    assert (ended.code, ended.reason) == (0, "")
    assert any("interface: me" in note for note in ended.notes)
    assert missing.kind == "bad input"
    assert "did you mean FirstOrderLag" in missing.reason
    captured = capfd.readouterr()
    assert (captured.out, captured.err) == ("", "")


def test_a_study_in_python(facts: Path) -> None:
    first = run_study(facts, jobs=1)
    assert first.passed
    assert (first.measured, first.reused) == (1, 0)
    second = run_study(facts)
    assert (second.measured, second.reused) == (0, 1)
    assert [c.finding for c in second.checked] == [c.finding for c in first.checked]
    assert first.checked[0].finding.value == 1.0
    assert second.words == "the requirement is met; 0 analyses measured, 1 taken from the store"


def test_json_goes_to_standard_output_alone(facts: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["run", str(facts), "--json", "-", "--no-store", "--jobs", "1"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["requirements"][0]["value"] == 1
    assert not (facts.parent / ".workbench-store").exists()


def test_the_store_can_lie_elsewhere_and_be_passed_over(
    facts: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    store = ["--store", str(tmp_path / "kept"), "--json", "-", "--jobs", "1"]
    counts = []
    for more in ([], [], ["--fresh"]):
        assert run(["run", str(facts), *store, *more]) == 0
        found = json.loads(capsys.readouterr().out)
        counts.append((found["measured"], found["reused"]))
    assert counts == [(1, 0), (0, 1), (1, 0)]
    assert not (facts.parent / ".workbench-store").exists()


def test_the_table_tells_value_limit_and_margin(facts: Path, capsys: pytest.CaptureFixture[str]) -> None:
    facts.write_text(FACTS.replace("equal = 1", "equal = 3"), encoding="utf-8")
    assert run(["run", str(facts), "--jobs", "1"]) == 1
    out = capsys.readouterr().out
    row = next(line for line in out.splitlines() if line.strip().startswith("inputs"))
    assert row.split() == ["inputs", "1", "3", "±", "0", "-2", "violated"]
    assert "1 of 1 requirements is not met: inputs" in out


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--junit", "nowhere/x.xml"], "the folder 'nowhere' does not exist"),
        (["--report", "x.pdf"], "must end in .html"),
        (["--no-store", "--fresh"], "only one of them"),
        (["--jobs", "0"], "0 is too few"),
        (["--stor", "x"], "No such option"),
    ],
)
def test_wrong_options_are_one_line(
    facts: Path, options: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["run", str(facts), *options]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert message in line


@pytest.mark.parametrize("name", bundled_studies())
def test_an_example_is_a_study_wherever_it_is_put(
    name: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    named = [] if name == "rudder_specification" else [f"study:{name}"]
    assert run(["run", *named, "--example"]) == 0
    text = capsys.readouterr().out
    assert tomllib.loads(text)["analyses"]
    (tmp_path / "mine.toml").write_text(text, encoding="utf-8")
    assert read_study(tmp_path / "mine.toml").requirements


@pytest.mark.parametrize("name", bundled_studies())
def test_bundled_studies_are_complete(name: str) -> None:
    study = read_study(f"study:{name}")
    plan = make_plan(study)
    for analysis in study.analyses.values():
        analysis.command.check(analysis.options)
    assert study.requirements
    assert not plan.notes
    read = {analysis for r in study.requirements for analysis in r.analyses}
    needed = {name for run in plan.runs for name in run.needs}
    borders = set() if study.envelope is None else set(study.envelope.borders)
    assert set(study.analyses) <= read | needed | borders


def test_the_rudder_keeps_its_specification(tmp_path: Path) -> None:
    out = tmp_path / "out.json"
    assert run(["run", "study:rudder_specification", "--no-store", "--json", str(out)]) == 0
    found = json.loads(out.read_text(encoding="utf-8"))
    assert found["passed"]
    assert all(r["passed"] for r in found["requirements"])


def plan_of(tmp_path: Path, text: str) -> list[PlannedRun]:
    path = tmp_path / "study.toml"
    path.write_text(text, encoding="utf-8")
    study = read_study(path)
    for analysis in study.analyses.values():
        analysis.command.check(analysis.options)
    return list(make_plan(study).runs)


def test_several_models_and_results_as_models(tmp_path: Path) -> None:
    text = """
    [models]
    a = {model = "fmu:FirstOrderLag", set = {tau = 2}}
    b = {model = "fmu:FirstOrderLag@3", set = {tau = 2}}
    [analyses.linear]
    command = "lin"
    model = "a"
    [analyses.exported]
    command = "build"
    model = {from = "linear"}
    out = "linear.fmu"
    [analyses.motions]
    command = "simulate"
    models = ["a", "b"]
    output = "y"
    window = [[0, 1], [1, 2]]
    """
    runs = {run.analysis.name: run for run in plan_of(tmp_path, text)}
    assert runs["exported"].command_line == "workbench build linear.json --out=linear.fmu"
    assert [f.name for f in runs["exported"].files] == ["linear.fmu"]
    words = runs["motions"].command_line
    assert words.startswith("workbench simulate fmu:FirstOrderLag fmu:FirstOrderLag@3 ")
    assert words.endswith("--output=y --window=0:1 --window=1:2")
    with pytest.raises(InputError, match="opens all its models in the same way"):
        plan_of(tmp_path, text.replace("set = {tau = 2}}", "set = {tau = 3}}", 1))
    with pytest.raises(InputError, match="key 'model' takes one model"):
        plan_of(tmp_path, text.replace('model = "a"', 'model = ["a", "b"]'))


def test_what_a_system_and_an_option_name_is_part_of_the_key(tmp_path: Path) -> None:
    inner = tmp_path / "parts"
    inner.mkdir()
    (inner / "lag.fmu").write_bytes(b"one")
    (inner / "inner.toml").write_text('[components]\nplant = {model = "lag.fmu", set = {k = 1}}\n', encoding="utf-8")
    (tmp_path / "outer.toml").write_text('[components]\na = "parts/inner.toml"\nb = "fmu:Rudder"\n', encoding="utf-8")
    (tmp_path / "trim.json").write_text("{}", encoding="utf-8")
    text = '[analyses.a]\ncommand = "lin"\nmodel = "outer.toml"\nat = "trim.json"\nmethod = "exact"\n'
    (before,) = plan_of(tmp_path, text)
    names = {"outer.toml", "parts/inner.toml", "parts/lag.fmu", "fmu:Rudder", "trim.json"}
    assert set(before.subject["files"]) == names
    for changed in ("parts/lag.fmu", "parts/inner.toml", "trim.json"):
        with (tmp_path / changed).open("ab") as file:
            file.write(b"\n")
        (after,) = plan_of(tmp_path, text)
        assert after.subject != before.subject
        before = after


def test_a_command_is_listed_in_the_words_of_its_own_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["--help"]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    for name in PROGRAM:
        words = " ".join((program(name).help or "").split("\n\n")[0].replace("`", "").split())
        assert f"{name} {words}" in shown


@pytest.mark.parametrize(("command", "subject"), [("lin", "MODEL"), ("simulate", "MODEL.."), ("run", "[STUDY]")])
def test_the_line_of_usage_names_the_subject_as_the_texts_do(
    command: str, subject: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run([command, "--help"]) == 0
    line = next(line for line in capsys.readouterr().out.splitlines() if "Usage:" in line)
    assert line.split()[-2:] == ["[OPTIONS]", subject]

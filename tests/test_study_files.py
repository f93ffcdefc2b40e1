"""Study files: what is wrong in one is told in one line, with the file, the table and the key."""

from __future__ import annotations

from pathlib import Path

import pytest

from workbench.cli.app import run
from workbench.study.read import bundled_studies

GOOD = """
[models]
lag = "fmu:FirstOrderLag"
[analyses.response]
command = "nfr"
model = "lag"
input = "u"
output = "y"
freq = [0.01, 0.1, 1]
amplitude = 1
[[requirements]]
name = "gain"
analysis = "response"
kind = "gain"
frequency = 0.1
min = -10
"""
GAIN = 'kind = "gain"\nfrequency = 0.1\nmin = -10'

# name of the case: (text to replace, by what, what the line must contain)
BROKEN: dict[str, tuple[str, str, str]] = {
    "broken TOML": ("[models]", "[models", "is not TOML: "),
    "unknown table": ("[models]", "[modells]", "key 'modells' is unknown; did you mean models?"),
    "misspelt key": ("frequency =", "frequenzy =", "\"gain\": key 'frequenzy' is unknown; did you mean frequency?"),
    "misspelt analysis": ('"response"\nkind', '"respons"\nkind', "analysis 'respons' is unknown; did you mean resp"),
    "misspelt command": ('"nfr"', '"nfrr"', "[analyses.response]: command 'nfrr' is unknown; did you mean nfr?"),
    "misspelt option": ("amplitude", "amplitud", "key 'amplitud' is not an option of 'nfr'; did you mean amplitude?"),
    "option left out": ("amplitude = 1\n", "", "[analyses.response]: key 'amplitude' is missing: Amplitudes"),
    "wrong type": ("min = -10", 'min = "-10"', "\"gain\": key 'min' must be a number, not '-10'"),
    "wrong type of an option": ("freq =", 'max-periods = "x"\nfreq =', "key 'max-periods': 'x' is not a whole number"),
    "text in a list": ("amplitude = 1", 'amplitude = [1, "two"]', "key 'amplitude': 'two' is not a number"),
    "half a band": ("freq = [0.01, 0.1, 1]", "band = [0.1]", "key 'band': takes two numbers, not 1"),
    "values without names": ("amplitude = 1", "amplitude = 1\nset = [1]", "'[1]' does not say of what"),
    "a table for a number": ("amplitude = 1", "amplitude = {a = 1}", "key 'amplitude' is not a table"),
    "misspelt model": ('"lag"\ninput', '"lug"\ninput', "[analyses.response]: model 'lug' is unknown; did you mean"),
    "no model": ('model = "lag"\n', "", "[analyses.response]: key 'model' is missing; models: lag"),
    "no such bundled FMU": ("OrderLag", "OrderLog", "[models] lag: fmu:FirstOrderLog: no bundled FMU of that name"),
    "no such file": ('"fmu:FirstOrderLag"', '"lag.fmu"', "[models] lag: no such file"),
    "no limit": ("min = -10", "", "has no limit; give min, max, or equal"),
    "min above max": ("min = -10", "min = -10\nmax = -20", "min -10 is above max -20"),
    "equal without tolerance": ("min = -10", "equal = -10", "equal needs a tolerance"),
    "unknown output": ('output = "y"', 'output = "z"', "output: fmu:FirstOrderLag has no output or state 'z'; known"),
    "unknown input": ('input = "u"', 'input = "v"', "input: fmu:FirstOrderLag has no input 'v'; known: u"),
    "unknown parameter": ("[models]", '[grid]\n"lag.taw" = [1]\n[models]', '"lag.taw": the model has no variable'),
    "model of the grid": ("[models]", '[grid]\n"leg.tau" = [1]\n[models]', "model 'leg' is unknown; did you mean lag?"),
    "grid without a list": ("[models]", '[grid]\n"lag.tau" = 1\n[models]', "must be a list of values"),
    "unit": ("min = -10", 'min = -10\nunit = "deg"', "unit 'deg' does not fit: the value is in dB"),
    "unknown unit": ("min = -10", 'min = -10\nunit = "furlong"', "unit 'furlong' is unknown"),
    "misspelt kind": ('kind = "gain"', 'kind = "gian"', "kind 'gian' is unknown; did you mean gain?"),
    "kind of another command": (GAIN, 'kind = "overshoot"\nmax = 1', "'overshoot' reads results of simulate"),
    "another path": (GAIN, 'kind = "rise time"\nmax = 1', 'take kind = "value" with the path of a number'),
    "half a corner": (GAIN, 'kind = "mask"\nupper = [[1]]', "key 'upper.0' takes 2 or more values, not 1"),
    "no name": ('name = "gain"', 'name = ""', "key 'name' must not be empty"),
    "mask that falls back": (GAIN, 'kind = "mask"\nupper = [[1, 0], [0.1, 3]]', "frequencies must rise"),
    "mask without limits": (GAIN, 'kind = "mask"', "has no limit; give upper or lower"),
    "masks that cross": (GAIN, 'kind = "mask"\nupper = [[0.1, 0]]\nlower = [[0.1, 5]]', "lower is above upper at 0.1"),
    "path": (GAIN, 'kind = "value"\npath = "gain[0"\nmax = 1', "cannot be read at '[0'"),
    "configuration": ("min = -10", 'min = -10\nconfigurations = ["x"]', "configuration 'x' is unknown"),
    "json": ("amplitude = 1", 'amplitude = 1\njson = "x.json"', "leave 'json' out"),
    "unknown analysis in from": ("freq =", 'store = {from = "x"}\nfreq =', "leave 'store' out"),
    "reference": ("freq = [0.01, 0.1, 1]", 'freq = {from = "respons"}', "analysis 'respons' is unknown"),
    "circle": ("freq = [0.01, 0.1, 1]", 'freq = {from = "response"}', "needs its own result"),
    "parameter": ('"fmu:FirstOrderLag"', '{model = "fmu:FirstOrderLag", set = {tay = 1}}', "did you mean tau?"),
    "no analyses": (GOOD, "", "key 'analyses' is missing"),
    "a study in a study": ('"nfr"', '"run"', "command 'run' is unknown"),
}  # fmt: skip


def one_line(capsys: pytest.CaptureFixture[str]) -> str:
    captured = capsys.readouterr()
    assert not captured.out
    (line,) = captured.err.splitlines()
    return line


@pytest.mark.parametrize("case", BROKEN)
def test_one_line_says_what_is_wrong(case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    old, new, message = BROKEN[case]
    assert old in GOOD
    path = tmp_path / "study.toml"
    path.write_text(GOOD.replace(old, new, 1), encoding="utf-8")
    assert run(["run", str(path)]) == 2
    line = one_line(capsys)
    assert line.startswith(f"workbench: {path}: ")
    assert message in line
    assert not list(tmp_path.glob(".workbench-store/measurements*"))


def test_broken_toml_names_the_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "study.toml"
    path.write_text(GOOD + "[analyses.response]\n", encoding="utf-8")
    assert run(["run", str(path)]) == 2
    assert "line 17" in one_line(capsys)


def test_a_name_stands_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "study.toml"
    path.write_text(GOOD + GOOD[GOOD.index("[[requirements]]") :], encoding="utf-8")
    assert run(["run", str(path)]) == 2
    assert '[[requirements]] "gain": the name appears twice' in one_line(capsys)


def test_a_file_that_is_not_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "rudder.toml").write_text(GOOD, encoding="utf-8")
    assert run(["run", str(tmp_path / "ruder.toml")]) == 2
    assert "no such file; did you mean rudder.toml?" in one_line(capsys)
    assert run(["run", "study:ruder_loop"]) == 2
    assert "did you mean rudder_loop?" in one_line(capsys)
    assert run(["run", "rudder_loop"]) == 2
    assert "did you mean study:rudder_loop?" in one_line(capsys)
    assert run(["run", "study:rudder_loop", "--junit", "page.html"]) == 2
    assert "--junit: 'page.html' must end in .xml" in one_line(capsys)
    assert run(["run", str(tmp_path)]) == 2
    assert "is a folder" in one_line(capsys)
    assert run(["run"]) == 2
    assert "--example" in one_line(capsys)


def test_every_bundled_study_is_explained() -> None:
    studies = bundled_studies()
    assert {"rudder_specification", "rudder_loop", "failed_aileron", "elevator_law"} <= set(studies)
    for name, path in studies.items():
        text = path.read_text(encoding="utf-8")
        assert f"workbench run study:{name}" in text

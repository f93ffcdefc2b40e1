"""Names and units as other exporters write them: `y[1,2]`, `[m3]`, no outputs at all."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.foreign_fmus import build_foreign
from workbench.cli.app import run
from workbench.core.records.names_in_text import plain_unit, split_names
from workbench.core.values.conversion import known_unit
from workbench.errors import InputError
from workbench.model.load import load
from workbench.response.simulate.request import simulate
from workbench.study.names import _parts


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("a,b", ["a", "b"]),
        (" a , ,b ", ["a", "b"]),
        ("y[1,2],u", ["y[1,2]", "u"]),
        ("y[1,2],z[m[3,4],5].x", ["y[1,2]", "z[m[3,4],5].x"]),
        ("\"a, b\",'c,d'", ["a, b", "c,d"]),
        ("der(x,2),y", ["der(x,2)", "y"]),
        ("it's,y", ["it's", "y"]),
        ("y[1,2]=3,x=4", ["y[1,2]=3", "x=4"]),
        ("", []),
    ],
)
def test_commas_inside_brackets_and_quotes_do_not_split(text: str, names: list[str]) -> None:
    assert split_names(text) == names


def test_an_open_bracket_is_told() -> None:
    with pytest.raises(InputError, match=r"'y\[1,2': \] is missing"):
        split_names("y[1,2")


def test_a_study_splits_likewise() -> None:
    assert _parts("y[1,2],clock") == ["y[1,2]", "clock"]
    assert _parts("y[1,2]=step:time=1,value=2") == ["y[1,2]"]


@pytest.mark.parametrize(
    ("written", "meant"),
    [("[m3]", "m3"), ("[rad/s]", "rad/s"), ("[ degC ]", "degC"), ("[-]", "1"), ("[m/s^2]", "m/s2")],
)
def test_units_in_brackets_are_those_without(written: str, meant: str) -> None:
    found, truth = known_unit(written), known_unit(meant)
    assert found is not None
    assert truth is not None
    assert (found.exponents, found.factor, found.offset) == (truth.exponents, truth.factor, truth.offset)
    assert plain_unit("N.m") == "N.m"
    assert known_unit("[furlong]") is None


@pytest.mark.parametrize("interface", ["me", "cs"])
def test_every_option_takes_such_a_name(tmp_path: Path, interface: str, capsys: pytest.CaptureFixture[str]) -> None:
    fmu, out = str(build_foreign(tmp_path)), tmp_path / "out.json"
    own = ["--interface", interface, "--in-process", "--json", str(out)]
    step = ["--step", "0.01"]
    assert run(["simulate", fmu, "--stop", "1", "--output", "y[1,2]", *step, *own]) == 0
    assert list(json.loads(out.read_text())["signals"]) == ["y[1,2]"]
    assert json.loads(out.read_text())["units"] == {"y[1,2]": "m3"}
    asked = ["--input", "u", "--output", "y[1,2]", "--freq", "1", "--amplitude", "1"]
    assert run(["nfr", fmu, *asked, *own]) == 0
    assert json.loads(out.read_text())["output"] == {"name": "y[1,2]", "unit": "m3"}
    assert "offset [m3]" in capsys.readouterr().out
    asked = ["--inputs", "u", "--outputs", "y[1,2]", *step]
    assert run(["lin", fmu, *asked, "--interface", interface, "--json", str(out)]) == 0
    assert json.loads(out.read_text())["output_names"] == ["y[1,2]"]
    if interface == "me":
        assert run(["trim", fmu, "--free", "u", "--fix", "y[1,2]=3", "--interface", "me", "--json", str(out)]) == 0
        assert json.loads(out.read_text())["u"] == {"u": pytest.approx(3.0)}


def test_without_outputs_states_are_recorded_and_told(tmp_path: Path) -> None:
    with load(build_foreign(tmp_path, outputs=False)) as model:
        result = simulate(model, stop=1.0)
    assert list(result.signals) == ["x"]
    assert any("no outputs are declared: the states are recorded (x)" in text for text in result.notes)
    np.testing.assert_allclose(result.signals["x"], 1.0 - np.exp(-result.time), atol=1e-5)


def test_without_outputs_and_states_locals_are_recorded_and_told(tmp_path: Path) -> None:
    file = build_foreign(tmp_path, outputs=False, states=False)
    with load(file, "cs", step=0.01) as model:
        result = simulate(model, stop=1.0)
    assert "y[1,2]" in result.signals
    assert any("the local variables are recorded (x, " in text for text in result.notes)


@pytest.mark.parametrize(
    "line",
    [
        ["info", "{long}"],
        ["info", "{long}.toml"],
        ["run", "{long}.toml"],
        ["check", "{long}.fmu"],
        ["build", "{long}.mo", "--out", "x.fmu"],
        ["lin", "fmu:FirstOrderLag", "--json", "{long}.json"],
        ["lin", "fmu:FirstOrderLag", "--at", "{long}.json"],
        ["simulate", "fmu:FirstOrderLag", "--stop", "1", "--plot", "{long}.png"],
    ],
)
def test_a_name_that_no_file_can_have_is_one_line(line: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    # Found by fuzzing a system file.
    assert run([word.format(long="1" * 300) for word in line]) == 2
    error = capsys.readouterr().err
    assert "File name too long" in error
    assert len([text for text in error.splitlines() if text.startswith("workbench: ")]) == 1

"""`workbench info`, `simulate` and `build`."""

from __future__ import annotations

import csv
import json
import zipfile
from pathlib import Path

import numpy as np
import pytest

from tests.gemseo import gemseo_fmu, needs_gemseo
from workbench.cli.app import run
from workbench.errors import InputError
from workbench.identification.identify.request import identify as identify_data


def test_info_for_people(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["info", "fmu:FirstOrderLag@3"]) == 0
    out = capsys.readouterr().out
    assert "FMI: 3.0, co-simulation (cs), model exchange (me)" in out
    assert "\ntau " in out  # all of a small model
    assert "--full also shows: Declared capabilities" in out
    assert run(["info", "fmu:Rudder@3"]) == 0
    out = capsys.readouterr().out
    assert "--full also shows: States (8), Parameters (31)" in out
    assert "\naeroDamping " not in out
    assert run(["info", "fmu:Rudder@3", "--full"]) == 0
    out = capsys.readouterr().out
    assert "\naeroDamping " in out
    assert "also shows" not in out


@pytest.mark.parametrize("name", ["Rudder", "Aircraft", "ElevatorLaw", "TwoRateQuantizer"])
def test_info_fits_a_screen(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["info", f"fmu:{name}"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) <= 40
    assert {"made by: FMI workbench", "good: runs here (cs, me)"} <= set(lines)


def test_a_report_of_info_has_everything(tmp_path: Path) -> None:
    assert run(["info", "fmu:Rudder", "--report", str(tmp_path / "rudder.html")]) == 0
    page = (tmp_path / "rudder.html").read_text(encoding="utf-8")
    assert all(words in page for words in ("Parameters (31)", "aeroDamping", "Declared capabilities"))


@needs_gemseo
def test_info_of_a_third_party_fmu(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["info", str(gemseo_fmu("Mass_Damper")), "--full"]) == 0
    out = capsys.readouterr().out
    assert "OpenModelica" in out
    assert "spring.c" in out


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        (None, "not a zip"),
        ({"other.txt": "x"}, "no modelDescription.xml"),
        ({"../evil.txt": "x", "modelDescription.xml": "<x/>"}, "would leave the target folder"),
    ],
)
def test_info_refuses_what_is_no_fmu(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], entries: dict[str, str] | None, message: str
) -> None:
    path = tmp_path / "bad.fmu"
    if entries is None:
        path.write_text("this is no archive")
    else:
        with zipfile.ZipFile(path, "w") as archive:
            for name, text in entries.items():
                archive.writestr(name, text)
    assert run(["info", str(path)]) == 2
    captured = capsys.readouterr()
    assert message in captured.err
    assert len(captured.err.splitlines()) == 1
    assert not (tmp_path.parent / "evil.txt").exists()


def test_simulate_writes_a_time_history(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = [tmp_path / name for name in ("r.json", "r.csv", "r.svg")]
    options = [x for pair in zip(("--json", "--csv", "--plot"), map(str, files), strict=True) for x in pair]
    command = ["simulate", "fmu:FirstOrderLag", "--stop", "3", "--input", "u=step:time=1,value=2", "--output", "y"]
    assert run([*command, "--set", "tau=0.5", *options]) == 0
    assert "largest" in capsys.readouterr().out
    result = json.loads(files[0].read_text(encoding="utf-8"))
    assert {"command", "model", "interface", "solver", "version", "seconds", "time", "signals"} <= set(result)
    time, y = np.array(result["time"]), np.array(result["signals"]["y"])
    np.testing.assert_allclose(y, np.where(time < 1.0, 0.0, 2.0 - 2.0 * np.exp(-(time - 1.0) / 0.5)), atol=1e-4)
    with files[1].open(encoding="utf-8") as file:
        assert next(csv.reader(file))[0] == "time [s]"
    assert files[2].read_text(encoding="utf-8").startswith("<?xml")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--stop", "0"], "stop"),
        (["--stop", "1", "--input", "u"], "--input: 'u' is not of the form NAME=VALUE"),
        (["--stop", "1", "--input", "u=sin:x"], "input u: 'sin:' is not a signal; did you mean sine?"),
        (["--stop", "1", "--input", "u=sine:amplitude=1"], "frequency"),
        (["--stop", "1", "--input", "u=nosuch.csv"], "nosuch.csv"),
        (["--stop", "1", "--input", "y=1"], "--input: 'y' of FirstOrderLag is an output; its inputs are: u"),
        (["--stop", "1", "--output", "yy"], "yy"),
        (["--stop", "1", "--plot", "x.bmp"], ".png"),
        (["--stop", "1", "--csv", "x.png"], "--csv: 'x.png' must end in .csv"),
        (["--stop", "1", "--json", "loop.toml"], "--json: 'loop.toml' must end in .json"),
    ],
)
def test_simulate_complains_in_one_line(capsys: pytest.CaptureFixture[str], arguments: list[str], message: str) -> None:
    assert run(["simulate", "fmu:FirstOrderLag", *arguments]) == 2
    captured = capsys.readouterr()
    lines = captured.err.splitlines()
    assert len(lines) == 1, captured.err
    assert message in lines[0]


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("Rudder", "did you mean fmu:Rudder?"),
        ("failed_aileron", "did you mean system:failed_aileron?"),
        ("lop.toml", "did you mean loop.toml?"),
        ("else.fmu", "else.fmu: no such file; give an .fmu"),
    ],
)
def test_a_missing_model_is_told_what_may_be_meant(
    name: str, hint: str, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "loop.toml").touch()
    monkeypatch.chdir(tmp_path)
    assert run(["check", name]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert hint in line


def test_build_says_what_is_missing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert run(["build", "Lag.mo", "--out", str(tmp_path / "Lag.fmu")]) == 2
    assert 'pip install "fmi-workbench[build]"' in capsys.readouterr().err


def test_build_complains_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = tmp_path / "Bad.mo"
    source.write_text("model Bad\n  Real x;\nequation\n  der(x) = = 1;\nend Bad;\n")
    for arguments in ([str(tmp_path / "nosuch.mo")], [str(source)]):
        assert run(["build", *arguments, "--out", str(tmp_path / "x.fmu")]) == 2
        assert len(capsys.readouterr().err.splitlines()) == 1
    assert run(["build", str(source), "--out", str(tmp_path / "none" / "x.fmu")]) == 2
    assert "does not exist" in capsys.readouterr().err


def test_messages_name_options_as_they_are_typed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What is `max_order` in Python is --max-order here; the same word in quotes is the name of a variable."""
    data = tmp_path / "data.csv"
    data.write_text("time [s],u,y\n" + "".join(f"{k},{k % 2},{k % 3}\n" for k in range(60)), encoding="utf-8")
    assert run(["identify", str(data), "--input", "u", "--output", "y", "--max-order", "0"]) == 2
    assert capsys.readouterr().err == "workbench: --max-order: 0 is too small; take at least 1\n"
    assert run(["identify", str(data), "--input", "max_order", "--output", "y"]) == 2
    assert "there is no column 'max_order'" in capsys.readouterr().err
    with pytest.raises(InputError, match=r"^max_order: 0 is too small"):
        identify_data(data, inputs=["u"], outputs=["y"], max_order=0)


def test_a_slip_costs_no_good_result(tmp_path: Path) -> None:
    """Bad input is told as JSON where no file stands; one that is there keeps its numbers."""
    out = tmp_path / "found.json"
    line = ["trim", "fmu:FirstOrderLag", "--json", str(out)]
    assert run([*line, "--u0", "uu=1"]) == 2
    assert json.loads(out.read_text())["failure"]["kind"] == "bad input"
    out.unlink()
    assert run(line) == 0
    good = out.read_text()
    assert run([*line, "--u0", "uu=1"]) == 2
    assert out.read_text() == good

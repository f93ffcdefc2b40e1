"""`workbench loop`: tables, files, pictures, one-line errors."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from tests.loop_models import saturation_gain
from tests.three_lags import three_lags
from workbench.cli.app import run


@pytest.fixture
def system(tmp_path: Path) -> str:
    path = tmp_path / "lags.toml"
    path.write_text(three_lags(6.0))
    return str(path)


def test_the_linear_loop_is_shown(system: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["loop", system, "--open", "y"]) == 0
    out = capsys.readouterr().out
    assert "Loop of three lags at c.y\nOpened at c.y → e.u2" in out
    assert "the closed loop is stable" in out
    rows = {line[:17].strip(): line.split()[2:] for line in out.splitlines() if " margin  " in line}
    assert rows["gain margin"] == ["2.4988", "dB", "(factor", "1.3333)", "0.27566"]
    assert rows["phase margin"] == ["10.167", "deg", "0.24147"]
    assert rows["delay margin"] == ["0.11696", "s"]
    assert "disk margin" in rows


def test_json_csv_and_picture_are_written(system: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = [tmp_path / name for name in ("r.json", "r.csv", "r.png")]
    options = [x for pair in zip(("--json", "--csv", "--plot"), map(str, files), strict=True) for x in pair]
    measured = ["--amplitude", "2", "--band", "0.15:0.4", "--ratio", "1.4", "--how", "break", "--in-process"]
    assert run(["loop", system, "--open", "k.y -> s.u", "--trim", *measured, *options]) == 0
    out = capsys.readouterr().out
    assert "Measured (break), amplitude 2" in out
    result = json.loads(files[0].read_text())
    assert result["command"] == "loop"
    assert result["connections"] == ["k.y -> s.u"]
    assert result["linear"]["margins"]["gain_margin"] == pytest.approx(8.0 / 6.0)
    assert result["linear"]["stability"]["verdict"] == "stable"
    margins = result["measured"][0]["margins"]
    assert margins["gain_margin"] == pytest.approx(8.0 / (6.0 * saturation_gain(2.0)), rel=1e-3)
    rows = list(csv.DictReader(files[1].read_text().splitlines()))
    assert {r["how"] for r in rows} == {"linear", "break"}
    linear = [r for r in rows if r["how"] == "linear"]
    values = np.array([float(r["gain"]) for r in linear])
    at = np.array([float(r["frequency_hz"]) for r in linear])
    assert values == pytest.approx(6.0 / np.abs(1.0 + 2j * np.pi * at) ** 3)
    assert files[2].stat().st_size > 20_000


def test_an_unstable_loop_is_told_before_its_crossovers(system: str, capsys: pytest.CaptureFixture[str]) -> None:
    text = Path(system).read_text()
    Path(system).write_text(text.replace("gain = 6.0", "gain = 20.0"))
    assert run(["loop", system, "--open", "y"]) == 0
    out = capsys.readouterr().out
    assert "the closed loop is unstable" in out
    assert "margins are then meaningless" in out
    assert "gain margin " not in out
    crossover = next(line for line in out.splitlines() if line.startswith("phase crossover"))
    assert crossover.split()[2:] == ["0.27566", "gain", "7.959", "dB"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--open", "k.z"], "open: no connection leaves 'k.z'; did you mean k.y"),
        (["--open", "y", "--at", "none.json", "--trim"], "--at and --trim: only one of them"),
        (["--open", "y", "--amplitude", "1", "--band", "3"], "--band: '3' is not of the form LO:HI"),
        (["--open", "y", "--amplitude", "0"], "amplitude"),
    ],
)
def test_bad_input_gets_one_line(
    system: str, capsys: pytest.CaptureFixture[str], arguments: list[str], said: str
) -> None:
    assert run(["loop", system, *arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert len(captured.err.splitlines()) == 1
    assert said in captured.err


def test_one_fmu_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["loop", "fmu:Rudder", "--open", "del"]) == 2
    assert "is a single model and has no connection to open" in capsys.readouterr().err

"""Every command takes a system."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from workbench.cli.app import run

LOOP = """
[components]
plant = "fmu:FirstOrderLag"
error = {sum = "+-"}
gain = {gain = 3.0}
[connections]
"error.u2" = "plant.y"
"gain.u" = "error.y"
"plant.u" = "gain.y"
[inputs]
reference = "error.u1"
[outputs]
y = "plant.y"
"""


@pytest.fixture
def loop(tmp_path: Path) -> str:
    path = tmp_path / "loop.toml"
    path.write_text(LOOP, encoding="utf-8")
    return str(path)


def test_info_names_components_and_connections(loop: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["info", loop, "--json", "-"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [c["name"] for c in found["components"]] == ["plant", "error", "gain"]
    assert found["connections"][0]["destination"] == "error.u2"
    assert [v["name"] for v in found["inputs"]] == ["reference"]
    assert [v["name"] for v in found["states"]] == ["plant.x"]


def test_the_closed_loop_is_the_closed_form(loop: str, tmp_path: Path) -> None:
    """3/(s + 1) closed with gain 1: 3/(s + 4)."""
    out = tmp_path / "out.json"
    assert run(["lin", loop, "--json", str(out)]) == 0
    found = json.loads(out.read_text(encoding="utf-8"))
    assert found["A"][0][0] == pytest.approx(-4.0, rel=1e-9)
    assert run(["trim", loop, "--u0", "reference=2", "--json", str(out)]) == 0
    assert json.loads(out.read_text(encoding="utf-8"))["y"]["y"] == pytest.approx(1.5, rel=1e-9)
    command = ["nfr", loop, "--input", "reference", "--output", "y", "--freq", "0.5", "--amplitude", "1"]
    assert run([*command, "--json", str(out), "--in-process"]) == 0
    assert json.loads(out.read_text(encoding="utf-8"))["gain"][0][0] == pytest.approx(
        3.0 / abs(4.0 + 3.141592653589793j), rel=1e-4
    )


def test_any_variable_of_a_component_is_recorded(loop: str, tmp_path: Path) -> None:
    out = tmp_path / "out.json"
    command = ["simulate", loop, "--stop", "1", "--input", "reference=1", "--output", "gain.y", "--in-process"]
    assert run([*command, "--json", str(out)]) == 0
    signals = json.loads(out.read_text(encoding="utf-8"))["signals"]
    assert signals["gain.y"][0] == pytest.approx(3.0)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"plant.u" = "gain.y"', '"plant.v" = "gain.y"', "'v'"),
        ('"plant.u" = "gain.y"', '"plent.u" = "gain.y"', "did you mean plant"),
        ("gain = {gain = 3.0}", "gain = {gian = 3.0}", "gian"),
        ('plant = "fmu:FirstOrderLag"', 'plant = "fmu:FirstOrderLug"', "FirstOrderLag"),
    ],
)
def test_a_wrong_system_is_one_line(
    loop: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], old: str, new: str, message: str
) -> None:
    path = tmp_path / "wrong.toml"
    path.write_text(LOOP.replace(old, new), encoding="utf-8")
    assert run(["simulate", str(path), "--stop", "1"]) == 2
    captured = capsys.readouterr()
    assert message in captured.err
    assert len(captured.err.splitlines()) == 1


def test_delays_of_co_simulation_parts_in_plain_words(
    loop: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = tmp_path / "cs.toml", tmp_path / "out.json"
    text = LOOP.replace('"fmu:FirstOrderLag"', '{model = "fmu:FirstOrderLag", interface = "cs"}')
    path.write_text(text, encoding="utf-8")
    command = ["--stop", "2", "--input", "reference=1", "--step", "0.02", "--json", str(out)]
    assert run(["check", "--delays", str(path), *command]) == 0
    assert "on average" in capsys.readouterr().out
    found = json.loads(out.read_text(encoding="utf-8"))
    # The closed form 0.75 (1 − e^(−4t)) moves by 0.75: the master's error is far below one per cent of it.
    assert found["outputs"][0]["error"] < 0.0075
    assert run(["check", "--delays", loop, "--json", str(out)]) == 0
    assert json.loads(out.read_text(encoding="utf-8"))["connections"] == []
    assert run(["check", "--delays", "fmu:FirstOrderLag", "--interface", "cs"]) == 2
    assert "has no connections" in capsys.readouterr().err

"""The command `feedback`."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path

import pytest

from tests.command_lines import LAGS, LOOP
from workbench.cli.program import command_of
from workbench.core.records.option import options_of
from workbench.errors import InputError, WorkbenchError
from workbench.limit_cycles.feedback.request import Feedback

ENDS = ("--from", "c.y", "--to", "a.u")


def run(*arguments: str) -> object:
    return command_of("feedback").main(list(arguments), "workbench feedback", standalone_mode=False)


@pytest.fixture
def lags(tmp_path: Path) -> str:
    path = tmp_path / "lags.toml"
    path.write_text(LAGS, encoding="utf-8")
    return str(path)


@pytest.fixture
def loop(tmp_path: Path) -> str:
    path = tmp_path / "loop.toml"
    path.write_text(LOOP, encoding="utf-8")
    return str(path)


@pytest.mark.parametrize("ends", [ENDS, ("--from", "y", "--to", "u")])
def test_json_csv_and_picture(lags: str, tmp_path: Path, ends: tuple[str, ...]) -> None:
    out, table, picture = (tmp_path / name for name in ("out.json", "out.csv", "out.png"))
    assert run(lags, *ends, "--json", str(out), "--csv", str(table), "--plot", str(picture)) == 0
    found = json.loads(out.read_text(encoding="utf-8"))
    assert found["stable_gains"] == [pytest.approx([-8.0, 1.0], rel=1e-6)]
    assert [c["gain"] for c in found["crossings"]] == pytest.approx([-8.0, 1.0], rel=1e-6)
    assert [c["frequency_hz"] for c in found["crossings"]] == pytest.approx([math.sqrt(3.0) / 2.0 / math.pi, 0.0])
    assert "optimum" not in found
    rows = list(csv.DictReader(table.read_text(encoding="utf-8").splitlines()))
    assert [float(r["gain"]) for r in rows] == pytest.approx([-8.0, 1.0], rel=1e-6)
    assert picture.stat().st_size > 20_000


def test_settling_of_a_saturated_loop(loop: str, tmp_path: Path) -> None:
    """With u = g·y added behind the block, (s + 1)³ + 10 − g is stable for 2 < g < 11, small motions."""
    out, table, picture = (tmp_path / name for name in ("out.json", "out.csv", "out.svg"))
    options = ["--settle", "--settle-gains", "2.5:6", "--count", "5", "--longest", "300"]
    options += ["--json", str(out), "--csv", str(table), "--plot", str(picture), "--plot-kind", "settling"]
    assert run(loop, *ENDS, "--gains=-20:20", *options) == 0
    found = json.loads(out.read_text(encoding="utf-8"))
    assert found["stable_gains"] == [pytest.approx([2.0, 11.0], rel=1e-6)]
    assert found["block"] == "block"
    assert found["gains"] == pytest.approx([2.5, 3.375, 4.25, 5.125, 6.0])
    assert len(found["settling_seconds"]) == 5
    assert found["frequency_hz"] == pytest.approx(0.275, rel=0.01)  # the cycle that the saturation holds
    assert found["threshold"] == 0.01
    assert table.read_text(encoding="utf-8").startswith("gain,settling_seconds,left")
    assert picture.stat().st_size > 10_000


@pytest.mark.parametrize("kind", ["root-locus", "nyquist", "cycles"])
def test_other_pictures(loop: str, tmp_path: Path, kind: str) -> None:
    picture = tmp_path / "picture.png"
    assert run(loop, *ENDS, "--count", "2", "--plot", str(picture), "--plot-kind", kind) == 0
    assert picture.stat().st_size > 20_000


def test_one_gain_is_simulated(loop: str, tmp_path: Path) -> None:
    out, table, picture = (tmp_path / name for name in ("out.json", "out.csv", "out.png"))
    options = ["--gain", "4", "--count", "1", "--stop", "300", "--output", "b.y"]
    options += ["--json", str(out), "--csv", str(table), "--plot", str(picture), "--plot-kind", "run"]
    assert run(loop, *ENDS, *options) == 0
    found = json.loads(out.read_text(encoding="utf-8"))["run"]
    assert found["gain"] == 4.0
    assert found["left_at_end"] < 1e-3
    assert table.read_text(encoding="utf-8").startswith("time,c.y,block.u,b.y,handed to the target")
    assert picture.stat().st_size > 20_000


def test_limits_with_units(tmp_path: Path) -> None:
    out = tmp_path / "out.json"
    arguments = ["fmu:Rudder", "--from", "del", "--to", "delC", "--limit", "0.2rad", "--rate-limit", "20deg/s"]
    assert run(*arguments, "--json", str(out)) == 0
    found = json.loads(out.read_text(encoding="utf-8"))
    assert found["target_unit"] == "deg"
    assert any(low is None or low < 0.0 for low, _ in found["stable_gains"])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--from", "c.z", "--to", "a.u"], "did you mean c.y"),
        (["--from", "a.u", "--to", "a.u"], "'a.u' of lags is an input; its outputs are: "),
        (["--from", "c.y", "--to", "b.y"], "is an output; its inputs are: "),
        (["--from", "c.y", "--to", "d.u"], "has no input 'd.u'"),
        ([*ENDS, "--gains", "3"], "LO:HI"),
        ([*ENDS, "--gains", "3:1"], "LO < HI"),
        ([*ENDS, "--settle"], "no nonlinear block is known"),
        ([*ENDS, "--settle", "--gains", "2:5"], "no gain within 2 … 5 stabilises"),
        ([*ENDS, "--settle", "--block", "bloc"], "there is no component 'bloc'"),
        ([*ENDS, "--settle", "--threshold", "2"], "it must be below 1"),
        ([*ENDS, "--settle", "--order", "1"], "take at least 2"),
        ([*ENDS, "--settle", "--watch", "c.q"], "variable 'c.q' is unknown"),
        ([*ENDS, "--pulse", "u=1"], "go together"),
        ([*ENDS, "--gain", "1", "--pulse", "w=1", "--start-after", "20"], "'w'"),
        ([*ENDS, "--count", "0"], "take at least 1"),
        ([*ENDS, "--limit", "25parsnips"], "cannot be converted"),
        ([*ENDS, "--limit=-3"], "must be positive"),
        ([*ENDS, "--limit", "1", "--actuator", "fmu:LimitedActuator"], "has its own limits"),
        ([*ENDS, "--actuator", "fmu:Aircraft"], "must have one"),
        ([*ENDS, "--plot-kind", "nyquist"], "--plot-kind needs --plot"),
        ([*ENDS, "--plot", "x.png", "--plot-kind", "settling"], "needs --settle"),
    ],
)
def test_mistakes_are_one_line(lags: str, arguments: list[str], message: str) -> None:
    with pytest.raises(InputError, match=message) as error:
        run(lags, *arguments)
    assert "\n" not in str(error.value)


def test_cycles_without_a_block_cannot_be_drawn(lags: str, tmp_path: Path) -> None:
    with pytest.raises(WorkbenchError, match="no nonlinear block"):
        run(lags, *ENDS, "--plot", str(tmp_path / "x.png"), "--plot-kind", "cycles")


def test_a_run_that_ends_too_early_is_told_before_its_picture(loop: str, tmp_path: Path) -> None:
    picture = tmp_path / "run.png"
    options = ["--gain", "4", "--count", "1", "--stop", "1", "--plot", str(picture), "--plot-kind", "run"]
    with pytest.raises(InputError, match="stop: 1 s is not after the feedback closes"):
        run(loop, *ENDS, *options)
    assert not picture.exists()


def test_the_options_that_matter_stand_first_and_the_others_under_headings() -> None:
    """What is inherited, such as the operating point, leaves its heading to none of the command's own."""
    shown = [d for d in options_of(Feedback) if not d.option.python]
    assert [d.flag for d in shown if not d.group] == ["--from", "--to", "--gains", "--settle", "--gain"]
    assert {d.name for d in shown if d.group == "Model"} == {"at"}

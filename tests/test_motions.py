"""Motions of several models under the same signals: closed forms of peak and rms, windows, units, failures."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import control
import numpy as np
import pytest

from workbench.cli.app import run
from workbench.errors import InputError
from workbench.model.described_model import DescribedModel
from workbench.response.compare.measures import measure
from workbench.response.compare.request import compare_motions
from workbench.response.compare.units import shown_unit
from workbench.response.simulate.request import simulate
from workbench.signals.kinds import Sine, Step
from workbench.signals.text import parse_signal
from workbench.system.connect import connect
from workbench.system.load import load


def oscillator(damping: float) -> DescribedModel:
    """x'' + 2 ζ x' + x = u with the acceleration as second output."""
    a, b = [[0.0, 1.0], [-1.0, -2.0 * damping]], [[0.0], [1.0]]
    plant = control.ss(a, b, [[1.0, 0.0], a[1]], [[0.0], [1.0]], inputs=["u"], outputs=["x", "acceleration"])
    return connect({"body": plant}, [], inputs={"force": "body.u"}, outputs={"x": "body.x"})


# -- measures ------------------------------------------------------------------------------------


def test_peak_and_rms_of_a_sine_between_its_rows() -> None:
    """25 rows a period: the highest of them is up to 0.8 % too low, the parabola is not."""
    time = np.linspace(0.0, 8.0, 201)
    found = measure(time, 2.0 * np.sin(2.0 * math.pi * time + 0.3), (1.0, 7.0))
    assert found is not None
    assert found.peak == pytest.approx(2.0, rel=2e-4)
    assert found.rms == pytest.approx(math.sqrt(2.0), rel=1e-9)
    assert found.half_range == pytest.approx(2.0, rel=2e-4)
    assert found.mean == pytest.approx(0.0, abs=1e-12)
    assert (2.0 * math.pi * found.peak_time + 0.3) % math.pi == pytest.approx(math.pi / 2.0, abs=0.01)


def test_rows_at_any_distance_and_a_jump() -> None:
    time = np.array([0.0, 1.0, 1.0, 1.5, 4.0])
    found = measure(time, np.array([1.0, 1.0, -3.0, -3.0, -3.0]), (0.0, 4.0))
    assert found is not None
    assert (found.peak, found.peak_time) == (3.0, 1.0)
    assert found.mean == pytest.approx((1.0 - 9.0) / 4.0)
    assert found.rms == pytest.approx(math.sqrt((1.0 + 27.0) / 4.0))
    assert found.half_range == pytest.approx(2.0)
    assert measure(time, time, (5.0, 6.0)) is None


@pytest.mark.parametrize(
    ("own", "wanted", "unit", "factor"),
    [
        ("m/s2", "g", "g", 1.0 / 9.80665), ("m", "g", "m", 1.0), ("rad", "deg", "deg", 180.0 / math.pi),
        (None, "g", None, 1.0), ("m", None, "m", 1.0),
    ],
)  # fmt: skip
def test_units_are_shown_where_they_measure_the_same(
    own: str | None, wanted: str | None, unit: str, factor: float
) -> None:
    shown = shown_unit(own, wanted)
    assert shown.unit == unit
    assert shown.factor == pytest.approx(factor)


# -- comparison ----------------------------------------------------------------------------------


def test_step_responses_have_their_overshoot() -> None:
    """1 + e^{−πζ/√(1−ζ²)} at π/√(1−ζ²); after long the step itself."""
    dampings = {"light": 0.1, "heavy": 0.4}
    models = {n: oscillator(z) for n, z in dampings.items()}
    try:
        result = compare_motions(
            models, outputs=["x", "body.acceleration"], windows=[(0.0, 10.0), (90.0, 100.0)],
            inputs={"force": Step(time=0.0, value=1.0)}, interval=0.02,
        )  # fmt: skip
    finally:
        for model in models.values():
            model.close()
    for name, z in dampings.items():
        root = math.sqrt(1.0 - z * z)
        first, last = result.measure(name, "x", 0), result.measure(name, "x", 1)
        assert first is not None
        assert last is not None
        assert first.peak == pytest.approx(1.0 + math.exp(-math.pi * z / root), rel=1e-5)
        assert first.peak_time == pytest.approx(math.pi / root, abs=2e-3)
        assert last.rms == pytest.approx(1.0, abs=2e-4)
    assert result.ratio("light", "x") == 1.0
    assert (result.ratio("heavy", "x") or 1.0) < 1.0
    assert not result.failed


def test_a_run_without_bound_is_reported_and_the_others_count() -> None:
    models = {"stable": oscillator(0.1), "unstable": oscillator(-2.0)}
    try:
        result = compare_motions(
            models,
            outputs=["x"],
            windows=[(0.0, 5.0), (300.0, 400.0)],
            inputs={"force": Sine(frequency=0.1)},
            interval=0.1,
        )
    finally:
        for model in models.values():
            model.close()
    (failed,) = result.failed
    assert failed.system == "unstable"
    assert failed.time is not None
    assert result.measure("unstable", "x", 0) is not None
    assert result.measure("unstable", "x", 1) is None
    assert result.measure("stable", "x", 1) is not None
    assert result.ratio("unstable", "x", 1) is None


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"outputs": ["z"]}, "outputs: FirstOrderLag has no variable 'z'"),
        ({"outputs": []}, "outputs: none given"),
        ({"windows": [(2.0, 1.0)]}, "must rise"),
        ({"unit": "furlong"}, "no signal can be shown in 'furlong'"),
        ({"stop": 0.5}, "before the last window"),
        ({"inputs": {"v": Step(time=0.0, value=1.0)}}, "inputs: FirstOrderLag has no input 'v'"),
    ],
)
def test_mistakes_are_one_line(options: dict[str, Any], message: str) -> None:
    with load("fmu:FirstOrderLag") as lag, pytest.raises(InputError, match=message):
        compare_motions({"lag": lag}, **{"outputs": ["y"], "windows": [(0.0, 1.0)], **options})


# -- the aircraft --------------------------------------------------------------------------------


def test_the_comfort_control_calms_the_cockpit_while_the_cycle_grows() -> None:
    """A short run after a pulse: less at the front fuselage and the wing tip with the comfort control than without."""
    folder = Path(__file__).resolve().parent.parent / "systems"
    names = {"none": "failed_aileron", "comfort": "failed_aileron_comfort"}
    cockpit, tip = "aircraft.z_front_fuselage_acceleration", "aircraft.z_wing_tip_acceleration"
    models = {n: load(folder / f"{file}.toml") for n, file in names.items()}
    try:
        result = compare_motions(
            models, outputs=[cockpit, tip], windows=[(20.0, 30.0)], unit="g", interval=0.01,
            inputs={"pulse": parse_signal("gust:value=100,duration=0.5")},
        )  # fmt: skip
    finally:
        for model in models.values():
            model.close()
    for signal in (cockpit, tip):
        assert (result.ratio("comfort", signal) or 2.0) < 1.0
    assert result.shown[cockpit].unit == "g"


# -- command -------------------------------------------------------------------------------------


def test_command_writes_everything(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = {
        o: str(tmp_path / f"out.{s}")
        for o, s in (("--json", "json"), ("--csv", "csv"), ("--plot", "png"), ("--report", "html"))
    }
    arguments = [
        "simulate", "fmu:FirstOrderLag", "fmu:FirstOrderLag@3", "--output", "y", "--output", "x", "--window", "0:1",
        "--window", "1:2", "--input", "u=step:time=0,value=2", "--label", "two", "--label", "three", "--in-process",
    ]  # fmt: skip
    assert run([*arguments, *(x for pair in files.items() for x in pair)]) == 0
    data = json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))
    assert data["systems"] == ["two", "three"]
    by = {(m["system"], m["signal"], m["window"]): m for m in data["motions"]}
    assert by["two", "y", 0]["peak"] == pytest.approx(2.0 * (1.0 - math.exp(-1.0)), rel=1e-5)
    assert by["three", "y", 1]["peak_ratio"] == pytest.approx(1.0, rel=1e-6)
    assert (tmp_path / "out.csv").read_text(encoding="utf-8").count("\n") == 9
    assert (tmp_path / "out.png").stat().st_size > 5000
    assert "two" in (tmp_path / "out.html").read_text(encoding="utf-8")
    assert "three" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--output", "y", "--window", "3"], "not of the form LO:HI"),
        (["--output", "yy", "--window", "0:1"], "did you mean y"),
        (["--output", "y", "--window", "0:1", "--input", "v=1"], "no input 'v'"),
        (["--output", "y", "--window", "0:1", "--label", "a"], "1 names for 2 models"),
    ],
)
def test_command_refuses_in_one_line(arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["simulate", "fmu:FirstOrderLag", "fmu:FirstOrderLag@3", *arguments]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


def test_a_loop_of_co_simulation_moves_as_it_does_alone() -> None:
    """Rows between communication points shorten the steps, and with them what these cost in a loop."""
    wires: list[Any] = [("plant.del", "gain.u", {"gain": -1.0}), ("gain.y", "plant.delC")]
    ends: dict[str, Any] = {"inputs": {"load": "plant.mH"}, "outputs": {"del": "plant.del"}}
    with (
        load("fmu:Rudder", interface="cs") as rudder,
        connect({"plant": rudder, "gain": 5.0}, wires, step=0.02, **ends) as co,
        connect({"plant": "fmu:Rudder", "gain": 5.0}, wires, **ends) as me,
    ):
        inputs = {"load": Step(time=0.1, value=2e3)}
        found = compare_motions({"me": me, "co": co}, inputs=inputs, stop=0.6)
        alone = simulate(co, inputs=inputs, stop=0.6)
    (history,) = (h for h in found.histories if h.system == "co")
    assert history.time.tolist() == alone.time.tolist()
    assert history.values["del"].tolist() == alone.signals["del"].tolist()
    assert any("with half the communication step" in note for note in found.notes)

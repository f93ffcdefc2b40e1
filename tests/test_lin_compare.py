"""Comparison in words, arrays of models, models along a simulation, the command."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import control
import numpy as np
import pytest

from tests.gemseo import gemseo_fmu, needs_gemseo
from tests.lin_fmus import built, fmu
from workbench.cli.app import run
from workbench.errors import InputError
from workbench.jobs.options import Workers
from workbench.model.load import load
from workbench.point.lin.request import lin, lin_along, lin_over
from workbench.point.lin.step_check import step_check
from workbench.response.compare_linear.interfaces import compare_interfaces
from workbench.response.compare_linear.request import compare
from workbench.signals.kinds import Sine
from workbench.system.connect import connect


@needs_gemseo
def test_explicit_euler_is_named_and_its_step_told() -> None:
    with load(gemseo_fmu("MassSpringSubSystem1"), "me") as model:
        found = compare(model, "x2", "x1", period=0.05, measure=False)
    difference = found.interfaces
    assert difference is not None
    assert difference.rule == "explicit Euler"
    s = 1j * 2**0.5
    assert difference.shift == pytest.approx(abs(np.log(1 + s * 0.05) / 0.05 - s) / 2**0.5, rel=1e-6)
    step = difference.agreeing_step or 0.0
    assert abs(np.log(1 + s * step) / step - s) / 2**0.5 == pytest.approx(0.01, rel=1e-6)
    assert "explicit Euler" in found.words[0]
    assert f"{step:.4g} s" in found.words[0]


def test_every_method_on_both_interfaces_and_a_picture(tmp_path: Path) -> None:
    with load("fmu:FirstOrderLag", "me") as model:
        found = compare(model, "u", "y", frequencies=[0.05, 0.2, 0.5])
    assert set(found.results) == {"exact (me)", "difference (me)", "response (me)", "response (cs)"}
    assert all(v.agrees for v in found.verdicts)
    assert "agrees" in found.words[0]
    found.plot(tmp_path / "compare.png")
    assert (tmp_path / "compare.png").stat().st_size > 10_000
    json.dumps(found.to_dict())


def test_sampled_models_are_compared_by_what_a_sine_shows() -> None:
    with load(fmu("ElevatorLaw"), "me") as model:
        found = compare(
            model,
            "side_stick",
            "elevator",
            u0={"side_stick": 0.2},
            x0={"deflection": 2.0 + 6.9 * 0.192},
            frequencies=[1.0, 9.0],
        )
    assert {"kalman-bertram (me)", "response (me)"} <= set(found.results)
    assert "sampled" in found.failed["exact (me)"]
    assert all(v.agrees for v in found.verdicts)


def test_a_grid_over_parameters_and_inputs_goes_on_from_its_store(tmp_path: Path) -> None:
    seen: list[int] = []
    with load("fmu:FirstOrderLag", "me") as model:
        name = model.parameters[0].name
        over = {name: [1.0, 2.0], "u": [0.0, 3.0]}
        first = lin_over(model, over, store=tmp_path, progress=lambda p, done, total: seen.append(total))
        again = lin_over(model, over, store=tmp_path)
    assert [tuple(p.values.values()) for p in first.points] == [(1.0, 0.0), (1.0, 3.0), (2.0, 0.0), (2.0, 3.0)]
    assert set(seen) == {4}  # the last is told in any case, those within a tenth of a second before are not
    assert not first.failed
    for a, b in zip(first.points, again.points, strict=True):
        assert a.result is not None
        assert b.result is not None
        assert np.array_equal(a.result.A, b.result.A)
    poles = [p.result.A[0, 0] for p in first.points if p.result]
    assert poles[0] != poles[2]
    first.plot(tmp_path / "grid.svg")


def test_a_grid_runs_in_worker_processes() -> None:
    with load("fmu:Rudder", "me") as model:
        found = lin_over(model, {"mH": [0.0, 100.0]}, inputs=["delC"], workers=Workers(jobs=2))
        alone = lin(model, u0={"mH": 100.0}, inputs=["delC"]).result
    assert found.points[1].result is not None
    assert np.array_equal(found.points[1].result.A, alone.A)


def test_along_a_simulation() -> None:
    with load("fmu:Rudder", "me") as model:
        signal = {"delC": Sine(amplitude=5.0, frequency=2.0)}
        found = lin_along(model, [0.0, 0.15], signals=signal, inputs=["delC"])
        with model.open_session(signals=signal) as session:
            session.advance(0.15, signals=signal)
            there = session.values(["spool", "p1"])
    last = found.points[1].result
    assert last is not None
    assert {n: last.operating_point.x[n] for n in there} == pytest.approx(there, rel=1e-6)
    assert last.operating_point.time == 0.15


def test_a_step_beside_the_model() -> None:
    with load("fmu:Rudder", "me") as model:
        linear = lin(model, inputs=["delC"]).result
        small = step_check(model, linear, input="delC", output="del", height=0.01, stop=2.0)
        large = step_check(model, linear, input="delC", output="del", height=5.0, stop=2.0)
        with pytest.raises(InputError, match="has no input 'pS'"):
            step_check(model, linear, input="pS", output="del", height=1.0, stop=1.0)
    assert small.error < 1e-3
    assert large.error > 0.01
    assert len(small.plot().axes) == 1


def test_command_writes_json_csv_and_picture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = {o: str(tmp_path / f"lin.{o}") for o in ("json", "csv", "png")}
    code = run(["lin", "fmu:Rudder", "--u0", "delC=2", "--inputs", "delC", "--dx", "p1=1e4", "--du", "0.1",
                "--json", files["json"], "--csv", files["csv"], "--plot", files["png"]])  # fmt: skip
    assert code == 0
    found = json.loads(Path(files["json"]).read_text(encoding="utf-8"))
    keys = {"A", "B", "C", "D", "dt", "state_names", "input_names", "output_names", "method", "x0", "u0", "y0"}
    assert keys <= set(found)
    assert (found["command"], found["method"], found["u0"]["delC"]) == ("lin", "difference", 2.0)
    assert len(found["A"]) == len(found["A"][0]) == 8
    lines = Path(files["csv"]).read_text(encoding="utf-8").splitlines()
    assert lines[0] == "matrix,row,column,value"
    assert len(lines) == 1 + 64 + 8 + 8 + 1
    assert "widths are given" in capsys.readouterr().out


def test_command_sweeps_and_compares(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "grid.json"
    assert run(["lin", "fmu:FirstOrderLag", "--over", "u=0,1", "--json", str(path)]) == 0
    assert [s["values"]["u"] for s in json.loads(path.read_text(encoding="utf-8"))["systems"]] == [0.0, 1.0]
    assert run(["lin", "fmu:FirstOrderLag", "--snapshot", "0.1,0.2", "--input", "u=1"]) == 0
    assert run(["lin", "fmu:FirstOrderLag", "--compare", "--freq", "0.1", "--csv", "-"]) == 0
    assert "exact (me),0.1," in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--at", "nosuch.json"], "cannot be read"),
        (["--dx", "p1"], "'p1' is not a number"),
        (["--over", "nosuch=1,2"], "has no parameter, input or state"),
        (["--compare"], "one input and one output"),
        (["--over", "mH=1", "--compare"], "only one of them"),
        (["--snapshot", "1", "--u0", "mH=1"], "leave --u0 out"),
        (["--snapshot", "2,1"], "must rise"),
        (["--compare", "--amplitude", "-2"], "--amplitude: -2 is not a positive number"),
        (["--amplitude", "2"], "--amplitude belongs to the measurement that --compare makes; add --compare"),
        (["--freq", "2"], "--freq belongs to the measurement that --compare makes; add --compare"),
        (["--compare", "--freq", "0,1"], "--freq: 0 is not a positive number"),
        (
            ["--interface", "cs", "--inputs="],
            "Rudder: a linear model needs an input or states, and this interface shows",
        ),
    ],
)
def test_command_refuses_in_one_line(arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]) -> None:
    code = run(["lin", "fmu:Rudder", *arguments])
    error = [line for line in capsys.readouterr().err.splitlines() if not line.startswith("note: ")]
    if arguments == ["--compare"]:  # Rudder has one output, and its first input is taken
        assert code == 0
        return
    assert code == 2
    assert len(error) == 1
    assert words in error[0]


def dead_band_gain(amplitude: float, half: float, slope: float) -> float:
    """The describing function of a dead band ±half, of this slope outside."""
    ratio = half / amplitude
    return float(slope * (1.0 - 2.0 / np.pi * (np.arcsin(ratio) + ratio * np.sqrt(1.0 - ratio**2))))


def test_no_linear_effect_is_told_with_the_measured_gain() -> None:
    """Inside its dead band the linear gain is 0, −∞ dB, and a sine beyond it sees the describing function."""
    text = "model Dead input Real u(start = 0); output Real y; "
    text += "equation y = if u > 1 then 2 * (u - 1) elseif u < -1 then 2 * (u + 1) else 0; end Dead;"
    with load(built(text, "Dead"), "me") as model:
        found = compare(model, "u", "y", frequencies=[0.1, 1.0], amplitude=4.0)
        small = compare(model, "u", "y", frequencies=[0.1, 1.0], amplitude=0.5)
    mine = [v for v in found.verdicts if v.method == "exact (me)"]
    assert [v.word for v in mine] == ["no linear effect"] * 2
    assert [v.measured_gain for v in mine] == pytest.approx([dead_band_gain(4.0, 1.0, 2.0)] * 2, rel=1e-3)
    assert all(v.gain_db == -np.inf and v.agrees is False for v in mine)
    assert any(w.startswith("exact (me): no linear effect; the measured gain is") for w in found.words)
    assert found.compared
    assert not small.compared
    assert {v.word for v in small.verdicts} == {"no effect"}
    assert "a sine of amplitude 0.5 at u does not move y; use a larger amplitude" in small.words[0]


def test_nothing_to_compare_is_no_success(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["lin", "fmu:DeadBand", "--compare", "--freq", "1", "--json", str(tmp_path / "found.json")]
    assert run(command) == 1
    shown = capsys.readouterr().out
    assert "nothing to compare with: a sine of amplitude 0.001 at u does not move y" in shown
    assert "nan" not in shown
    found = json.loads((tmp_path / "found.json").read_text(encoding="utf-8"))
    assert {v["word"] for v in found["verdicts"]} == {"no effect"}
    assert "operating_point" in found


def test_the_command_shows_units_and_the_point_and_says_what_takes_its_place(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    point = str(tmp_path / "point.json")
    assert run(["trim", "fmu:Rudder", "--u0", "delC=2", "--json", point]) == 0
    capsys.readouterr()
    assert run(["lin", "fmu:Rudder", "--at", point, "--u0", "delC=2"]) == 0
    shown = capsys.readouterr()
    for text in ("pistonSpeed", "m/s", "delC", "deg", "bypass", "--report also shows: Matrices"):
        assert text in shown.out
    assert "at delC = 2 deg, pS = 2.06e+07 Pa" in shown.out
    assert "as asked for" not in shown.err
    assert run(["lin", "fmu:Rudder", "--at", point, "--u0", "delC=5", "--json", str(tmp_path / "lin.json")]) == 0
    told = "note: delC is 5 as asked for, not 2, as the operating point says: it may not be an equilibrium"
    assert told in capsys.readouterr().err.splitlines()
    assert json.loads((tmp_path / "lin.json").read_text(encoding="utf-8"))["u0"]["delC"] == 5.0


@pytest.mark.parametrize("times", [1, 2, 3])
def test_the_rule_of_a_co_simulation_is_found_over_several_of_its_steps(times: int) -> None:
    step, poles = 0.05, np.array([-1.0, -4.0])
    with connect(
        {"p": control.ss(np.diag(poles), np.ones((2, 1)), np.ones((1, 2)), 0.0)},
        [],
        inputs={"u": "p.u"},
        outputs={"y": "p.y"},
    ) as model:
        equations = lin(model).result
    stepped = replace(equations, A=np.diag((1.0 + step * poles) ** times), dt=times * step)
    found = compare_interfaces(equations, stepped, step=step, frequencies=np.array([0.1]))
    assert found is not None
    assert found.rule == "explicit Euler"
    assert found.pole_error == pytest.approx(0.0, abs=1e-12)

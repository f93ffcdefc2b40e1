"""Trim of FMUs: the rudder actuator, sampled and third-party models, both interfaces, and the command line."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator
from pathlib import Path

import pytest

import workbench as wb
from tests.gemseo import gemseo_fmu, needs_gemseo
from workbench.cli.app import run
from workbench.point.trim.page import trim_page

STATES = ["p1", "p2", "spool", "current", "piston", "pistonSpeed", "surface", "surfaceSpeed"]
DEL = 1.9905784  # deg at delC = 2 deg: the model's statics, see its README


@pytest.fixture(scope="module")
def rudder() -> Iterator[wb.DescribedModel]:
    with wb.load("fmu:Rudder") as model:
        yield model


def statics(x: dict[str, float]) -> tuple[float, float]:
    """Torque on the surface [N.m] and force on the piston [N] at rest, by the README's equations."""
    force = 8e7 * (x["piston"] - 0.15 * x["surface"])
    return 0.15 * force - 3000.0 * x["surface"], 4e-3 * (x["p1"] - x["p2"]) - force


def test_rudder_at_rest_is_unique(rudder: wb.DescribedModel) -> None:
    result = wb.trim(rudder, u0={"delC": 2.0})
    assert result.converged
    assert not result.null_directions
    assert result.operating_point.y["del"] == pytest.approx(DEL, abs=1e-6)
    assert statics(result.operating_point.x) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert result.evaluations < 60
    assert [v.word for v in trim_page(result).summary] == ["converged"]


@pytest.mark.parametrize("name", ["fmu:Rudder", "fmu:Rudder@3"])
def test_rudder_with_floating_pressures_is_a_family(name: str) -> None:
    with wb.load(name) as model:
        result = wb.trim(model, u0={"delC": 2.0}, floating=["p1", "p2"])
    assert result.converged
    assert len(result.null_directions) == 2
    # p1 + p2 together, and the piston with what holds it there.
    named = [set(d.components) for d in result.null_directions]
    assert {"p1", "p2"} in named
    assert any({"piston", "current", "spool", "surface"} <= n for n in named)
    assert result.operating_point.y["del"] == pytest.approx(DEL, abs=1e-6)  # the slowest of all is the true equilibrium
    assert "8 unknowns" in result.notes[0]
    assert "6 equations" in result.notes[0]
    # One of many points is not the one that was meant: not green.
    assert [v.word for v in trim_page(result).summary] == ["watch"]


def test_the_member_nearest_to_the_start_lets_the_pressures_move(rudder: wb.DescribedModel) -> None:
    result = wb.trim(rudder, u0={"delC": 2.0}, floating=["p1", "p2"], family="nearest")
    assert result.converged
    assert statics(result.operating_point.x) == pytest.approx((0.0, 0.0), abs=1e-4)
    assert 0.0 < result.operating_point.y["del"] < DEL
    assert abs(result.operating_point.dx["p1"]) > 1e6
    assert any("carry others along" in note for note in result.notes)


def test_pressures_that_must_move_let_nothing_rest(rudder: wb.DescribedModel) -> None:
    """Beyond the stop (piston at 78.7 mm) p1 − p2 must be 217 MPa; at rest it is at most the supply less the return."""
    result = wb.trim(rudder, free=["delC"], fix={"del": 30.0}, floating=["p1", "p2"])
    p1, p2 = (result.operating_point.x[n] for n in ("p1", "p2"))
    assert p1 - p2 > 1e8
    assert max(abs(result.operating_point.dx[n]) for n in ("p1", "p2")) > 1e9
    assert not result.converged
    assert any("carry others along" in note for note in result.notes)


def test_the_family_is_pinned_by_an_output(rudder: wb.DescribedModel) -> None:
    """The required equations hold, but the valve is open: pressures change by 3e8 Pa/s, and the piston cannot rest."""
    result = wb.trim(rudder, u0={"delC": 2.0}, floating=["p1", "p2"], fix={"del": 1.0})
    assert max(abs(r.scaled) for r in result.residuals if r.required) < 1e-8
    assert not result.converged
    assert result.operating_point.y["del"] == pytest.approx(1.0)
    assert len(result.null_directions) == 1


def test_input_for_a_deflection_and_one_beyond_the_stops(rudder: wb.DescribedModel) -> None:
    found = wb.trim(rudder, free=["delC"], fix={"del": 5.0})
    assert found.converged
    assert found.operating_point.u["delC"] == pytest.approx(5.0 * 2.0 / DEL, rel=1e-4)
    beyond = wb.trim(rudder, free=["delC"], fix={"del": 40.0})
    assert not beyond.converged
    assert len(beyond.residuals) == 9


def test_co_simulation_comes_to_the_same_rest() -> None:
    with wb.load("fmu:Rudder", "cs") as model:
        result = wb.trim(model, u0={"delC": 2.0})
    assert result.converged
    assert result.method == "step map"
    assert result.operating_point.y["del"] == pytest.approx(DEL, abs=1e-5)


@pytest.mark.parametrize("interface", ["cs", "me"])
def test_where_co_simulation_finds_no_rest_model_exchange_is_proposed(interface: str) -> None:
    with wb.load("fmu:FirstOrderLag", interface=interface) as lag:
        found = wb.trim(lag, fix={"y": 3.0})  # of an input that stays at 0
    assert not found.converged
    assert any("use interface me" in note for note in found.notes) == (interface == "cs")


def test_bias_counts_as_input() -> None:
    with wb.load("fmu:FirstOrderLag", bias={"u": 1.5}) as model:
        result = wb.trim(model)
    assert result.operating_point.y["y"] == pytest.approx(1.5)


@pytest.mark.parametrize("name", ["fmu:TwoRateQuantizer", "fmu:TwoRateQuantizer@3"])
def test_two_rates_and_their_common_period(name: str) -> None:
    with wb.load(name) as model:
        result = wb.trim(model, u0={"u": 0.333})
    assert result.converged
    assert result.method == "period map"
    assert result.operating_point.period == pytest.approx(1.0, abs=1e-6)
    assert result.operating_point.discrete == pytest.approx({"yFast": 0.35, "ySlow": 0.33})
    assert result.operating_point.y["y"] == pytest.approx(0.68)


def elevator() -> wb.DescribedModel:
    return wb.load("fmu:ElevatorLaw")


def test_elevator_law_has_infinitely_many_equilibria() -> None:
    with elevator() as model:
        result = wb.trim(model)
    assert result.converged
    assert result.operating_point.period == pytest.approx(0.022)
    assert len(result.operating_point.discrete) == 4
    # All states but the rate limiter's are free, as the source report found (chapter 6.2).
    assert len(result.null_directions) == 3
    assert all(len(d.components) == 1 for d in result.null_directions)
    assert "a family of equilibria: 3 directions are left open" in result.message


def test_elevator_law_finds_the_stick_for_a_deflection() -> None:
    with elevator() as model:
        result = wb.trim(model, free=["side_stick"], fix={"elevator": 5.0})
        limited = wb.trim(model, free=["side_stick"], fix={"elevator": 80.0})
    assert result.converged
    assert result.operating_point.y["elevator"] == pytest.approx(5.0)
    assert not limited.converged


@needs_gemseo
@pytest.mark.parametrize("interface", ["me", "cs"])
def test_mass_and_damper_of_openmodelica(interface: str) -> None:
    with wb.load(gemseo_fmu("Mass_Damper"), interface) as model:
        result = wb.trim(model, u0={"f": 100.0})
    assert result.converged
    # Spring 1e4 N/m between the wall and the mass: it gives way by f/c.
    assert result.operating_point.x["damper.s_rel"] == pytest.approx(1.0 - 100.0 / 1e4, abs=1e-6)
    assert result.operating_point.x["damper.v_rel"] == pytest.approx(0.0, abs=1e-6)
    assert result.operating_point.y["y"] == pytest.approx(-0.5 + 0.01, abs=1e-6)
    assert result.method == ("equations" if interface == "me" else "running")


@needs_gemseo
@pytest.mark.parametrize("interface", ["me", "cs"])
def test_undamped_masses_of_openmodelica(interface: str) -> None:
    with wb.load(gemseo_fmu("MassSpringSubSystem1"), interface) as model:
        result = wb.trim(model, u0={"x2": 3.0})
        wanted = wb.trim(model, free=["x2"], fix={"x1": 0.25})
    assert result.converged
    assert result.operating_point.y == pytest.approx({"x1": 1.5, "v1": 0.0}, abs=1e-6)
    assert wanted.converged
    assert wanted.operating_point.u["x2"] == pytest.approx(0.5)
    assert result.method == ("equations" if interface == "me" else "step map")


# -- command line -------------------------------------------------------------------------


def test_command_writes_what_lin_reads(tmp_path: Path) -> None:
    path, table, picture = tmp_path / "trim.json", tmp_path / "trim.csv", tmp_path / "trim.svg"
    options = ["--u0", "delC=2", "--float", "p1,p2", "--json", str(path), "--csv", str(table), "--plot", str(picture)]
    assert run(["trim", "fmu:Rudder", *options]) == 0
    data = json.loads(path.read_text(encoding="utf-8"))
    assert {"x", "u", "y", "dx", "residual", "converged", "null_directions", "method"} <= set(data)
    assert data["converged"] is True
    assert list(data["x"]) == STATES
    point = wb.OperatingPoint.read(path)
    assert point.u["delC"] == 2.0
    assert point.units["del"] == "deg"
    rows = list(csv.reader(table.read_text(encoding="utf-8").splitlines()))
    assert rows[0] == ["set", "name", "value", "unit"]
    assert ["u", "delC", "2.0", "deg"] in rows
    assert picture.stat().st_size > 1000


def test_command_shows_residuals_and_ends_with_1(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path = tmp_path / "trim.json"
    assert run(["trim", "fmu:FirstOrderLag", "--fix", "y=3", "--json", str(path)]) == 1
    shown = capsys.readouterr()
    assert "no equilibrium found" in shown.out
    assert "der(x)" in shown.out
    assert "over-determined by 1" in shown.err
    assert json.loads(path.read_text(encoding="utf-8"))["converged"] is False


@pytest.mark.parametrize(
    "options",
    [
        ["--free", "nosuch"],
        ["--fix", "y"],
        ["--fix", "y=a"],
        ["--bound", "y=1"],
        ["--bound", "y=2:1"],
        ["--float", "y"],
        ["--x0", "nosuch=1"],
        ["--family", "odd"],
        ["--period", "-1"],
    ],
)
def test_command_complains_in_one_line(options: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["trim", "fmu:FirstOrderLag", *options]) == 2
    lines = [x for x in capsys.readouterr().err.splitlines() if not x.startswith("note: ")]
    assert len(lines) == 1


def test_command_has_bounds_open_to_one_side(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["trim", "fmu:FirstOrderLag", "--free", "u", "--bound", "y=2:"]) == 0
    assert "family" in capsys.readouterr().out


def test_help_has_an_example(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["trim", "--help"]) == 0
    assert "Example: workbench trim fmu:Rudder" in " ".join(capsys.readouterr().out.split())


# -- operating points ---------------------------------------------------------------------


def test_an_operating_point_survives_json() -> None:
    point = wb.OperatingPoint(
        x={"a": 1.0},
        u={"u": 2.0},
        y={"y": 3.0},
        dx={"a": 0.0},
        discrete={"d": 4.0},
        units={"a": "m"},
        time=0.5,
        period=0.1,
    )
    assert wb.OperatingPoint.from_dict(json.loads(json.dumps(point.to_dict()))) == point


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[]", "not an operating point"),
        ("{}", "'x' is missing"),
        ('{"x": {"a": null}, "u": {}}', "x: a must be a finite number"),
        ('{"x": 3, "u": {}}', "'x' must be an object that gives a value to each name"),
        ("{", "is not JSON"),
    ],
)
def test_a_bad_file_is_named(text: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "p.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(wb.InputError, match=words):
        wb.OperatingPoint.read(path)
    with pytest.raises(wb.InputError, match="cannot be read"):
        wb.OperatingPoint.read(tmp_path / "nosuch.json")

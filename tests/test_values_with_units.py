"""Start values and biases with a unit: the FMU's display units, and those that convert."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

import workbench as wb
from tests.fmi3_fmus import build_sized
from workbench.cli.app import run as command
from workbench.errors import InputError
from workbench.fmi.description import DisplayUnit, UnitDefinition
from workbench.fmi.variable import Variable
from workbench.model.starts import check_biases, check_starts
from workbench.signals.text import signal_text

_BASES = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
UNITS = {
    "rad": UnitDefinition({b: int(b == "rad") for b in _BASES}, display=(DisplayUnit("°", 180.0 / math.pi),)),
    "K": UnitDefinition({b: int(b == "K") for b in _BASES}, display=(DisplayUnit("Celsius", 1.0, -273.15),)),
    "turns": UnitDefinition(None, display=(DisplayUnit("quarters", 4.0),)),
}


def variable(name: str, unit: str | None, causality: str = "input") -> Variable:
    return Variable(name=name, type="Real", causality=causality, variability="continuous", unit=unit)


VARIABLES = {
    v.name: v
    for v in (
        variable("angle", "rad"), variable("T", "K", "parameter"), variable("count", "turns"), variable("bare", None),
        variable("heat", "K"),
    )
}  # fmt: skip


@pytest.mark.parametrize(
    ("name", "text", "value"),
    [
        ("angle", "90°", math.pi / 2.0),
        ("angle", "90 deg", math.pi / 2.0),  # by the usual symbol
        ("angle", "0.5rad", 0.5),
        ("angle", "-1e-1", -0.1),
        ("T", "20Celsius", 293.15),
        ("T", "20 degC", 293.15),
        ("T", "300", 300.0),
        ("count", "6quarters", 1.5),  # what the unit is made of is not declared
    ],
)
def test_a_value_with_a_unit_is_converted(name: str, text: str, value: float) -> None:
    assert check_starts({name: text}, VARIABLES, units=UNITS)[name] == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("angle", "5m", r"angle: 'm' does not convert to its unit, rad"),
        ("bare", "5m", r"bare: it has no unit; give a plain number in place of '5m'"),
        ("angle", "deg", r"angle: 'deg' is not a number with a unit"),
        ("heat", "2degC", r"heat: 2degC may be a value or a difference.*; give it in K"),
        ("angle", "1e999deg", r"angle must be a finite number"),
    ],
)
def test_a_unit_that_does_not_fit_is_one_line(name: str, text: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        check_biases({name: text}, VARIABLES, UNITS)


def test_the_command_line_takes_them_and_a_report_tells(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    words = ["simulate", "fmu:Rudder", "--stop", "0.5", "--output", "del", "--json", "-", "--bias"]
    found = []
    for bias in ("delC=0.05rad", f"delC={math.degrees(0.05)!r}"):
        assert command([*words, bias]) == 0
        found.append(json.loads(capfd.readouterr().out))
    assert found[0]["signals"] == found[1]["signals"]
    assert command([*words, "delC=5m"]) == 2
    assert "--bias: delC: 'm' does not convert to its unit, deg" in capfd.readouterr().err


def test_systems_and_python_take_them(tmp_path: Path) -> None:
    with wb.load("fmu:Rudder", bias={"delC": "0.05rad"}, start_values={"pS": "200bar"}) as model:
        assert model.recipe.bias == {"delC": pytest.approx(math.degrees(0.05))}
        assert model.start_values["pS"] == pytest.approx(2e7)
    text = '[components]\na = {model = "fmu:Rudder", set = {pS = "200bar"}}\n[inputs]\nd = "a.delC"\n[outputs]\n'
    (tmp_path / "one.toml").write_text(text + 'y = "a.del"\n')
    with wb.load(tmp_path / "one.toml", bias={"d": "0.05rad"}) as system:
        assert system.recipe.bias == {"d": pytest.approx(math.degrees(0.05))}
        assert system.start_values["a.pS"] == pytest.approx(2e7)


def forced(path: Path, heading: str, points: list[str]) -> list[float]:
    """Return delC [deg] of the Rudder at 0, 0.1, … 0.4 s, forced by a file."""
    path.write_text("\n".join([heading, *points]))
    with wb.load("fmu:Rudder") as model:
        result = wb.simulate(model, inputs={"delC": str(path)}, stop=0.4, outputs=["delC"])
    return list(np.interp([0.0, 0.1, 0.2, 0.3, 0.4], result.time, result["delC"]))


def test_a_column_is_converted_to_the_unit_of_the_input_it_forces(tmp_path: Path) -> None:
    file = tmp_path / "u.csv"
    plain = forced(file, "time,delC", ["0,0", "0.4,2"])
    assert plain == pytest.approx([0.0, 0.5, 1.0, 1.5, 2.0])
    assert forced(file, "time [s],delC [deg]", ["0,0", "0.4,2"]) == plain
    assert forced(file, "time [ms],delC [rad]", ["0,0", f"400,{math.radians(2.0)!r}"]) == pytest.approx(plain)
    for time, column in (("time[ms]", "delC[rad]"), ("time (ms)", "delC (rad)")):
        assert forced(file, f"{time},{column}", ["0,0", f"400,{math.radians(2.0)!r}"]) == pytest.approx(plain)
    found = forced(file, "t [min],gust [m],delC [mrad]", ["0,9,0", f"{0.4 / 60},9,{math.radians(2e3)!r}"])
    assert found == pytest.approx(plain)


@pytest.mark.parametrize(
    ("heading", "words"),
    [
        ("time,delC [kg]", r"input delC: values in 'kg' do not convert to its unit, deg; give them in"),
        ("time,delC [furlong]", r"input delC: values in 'furlong' do not convert to its unit, deg"),
        ("time [m],delC", r"u\.csv: the times of 'time \[m\]' do not convert to s; give them in s"),
        ("time [degC],delC", r"the times of 'time \[degC\]' do not convert to s"),
    ],
)
def test_a_heading_whose_unit_does_not_fit_is_one_line(tmp_path: Path, heading: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        forced(tmp_path / "u.csv", heading, ["0,0", "1,1"])


def test_a_table_with_a_unit_is_written_as_it_is_read() -> None:
    table = wb.parse_signal("table:0=0,1=2,hold=1,unit=rad")
    assert table == wb.Table([0.0, 1.0], [0.0, 2.0], "hold", "rad")
    assert wb.parse_signal(signal_text(table)) == table
    assert wb.parse_signal("table:0=0,1=2,hold=0") == wb.Table([0.0, 1.0], [0.0, 2.0])
    with pytest.raises(InputError, match="'hold=yes' is neither hold=1, a staircase, nor hold=0"):
        wb.parse_signal("table:0=0,1=2,hold=yes")


def test_a_session_converts_no_units() -> None:
    table = wb.Table([0.0, 1.0], [2.0, 2.0], unit="rad")
    with (
        wb.load("fmu:Rudder") as model,
        pytest.raises(InputError, match=r"input delC: a session converts no units; give the table in deg"),
        model.open_session(signals={"delC": table}),
    ):
        pass


def test_display_units_of_an_fmu_are_taken_and_shown(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    file = build_sized(tmp_path)
    assert command(["info", str(file), "--no-probe", "--full"]) == 0
    shown = capfd.readouterr().out
    assert "Display units" in shown
    assert "degC = K − 273.15" in shown
    with wb.load(file, start_values={"x[1]": "90deg", "u[1]": "20degC"}) as model:
        assert [model.start_values[n] for n in ("x[1]", "u[1]")] == pytest.approx([math.pi / 2.0, 293.15])

"""Numbers with units in the texts of signals: what they are in the input's own unit, in s, Hz and deg, or refused."""

from __future__ import annotations

import json
import math
import pickle
from collections.abc import Iterator
from pathlib import Path

import pytest

import workbench as wb
from tests.fmi3_fmus import build_sized
from workbench.cli.app import run as command
from workbench.core.records.quantity import Quantity, amount, quantity
from workbench.core.values.conversion import in_other_unit, named_conversion
from workbench.errors import InputError
from workbench.model.names import forced_inputs
from workbench.signals.gusts import gust, turbulence
from workbench.signals.kinds import Constant, Prbs, Signal, Sine, Step, Table, pulse


@pytest.fixture(scope="module")
def rudder() -> Iterator[wb.Model]:
    """A model whose input delC is in deg."""
    with wb.load("fmu:Rudder") as model:
        yield model


@pytest.fixture(scope="module")
def heated(tmp_path_factory: pytest.TempPathFactory) -> Iterator[wb.Model]:
    """A model whose inputs u[1] … are in K."""
    with wb.load(build_sized(tmp_path_factory.mktemp("heated"))) as model:
        yield model


def forced(model: wb.Model, name: str, text: str | Path) -> Signal:
    return forced_inputs(model, {name: text})[name]


TWO = math.degrees(0.02)


@pytest.mark.parametrize(
    ("text", "signal"),
    [
        ("0.02rad", Constant(TWO)),
        ("20 mrad", Constant(TWO)),
        ("3°", Constant(3.0)),
        ("sine:amplitude=20mrad,frequency=3rad/s,offset=-0.02rad,phase=1rad,start=700ms",
         Sine(amplitude=TWO, frequency=3.0 / (2.0 * math.pi), offset=-TWO, phase=math.degrees(1.0), start=0.7)),
        ("sine:frequency=2kHz", Sine(frequency=2000.0)),
        ("sine:frequency=90rpm", Sine(frequency=1.5)),
        ("step:time=0.1min,value=0.02rad,initial=1", Step(time=6.0, value=TWO, initial=1.0)),
        ("prbs:hold=50ms,amplitude=0.02rad,order=5", Prbs(hold=0.05, amplitude=TWO, order=5)),
        ("pulse:duration=100ms,value=0.02rad,time=1s", pulse(time=1.0, value=TWO, duration=0.1)),
        ("gust:duration=100ms,value=0.02rad", gust(value=TWO, duration=0.1)),
        ("gust:gradient=0.1km,speed=360km/h,value=0.02rad", gust(value=TWO, gradient=100.0, speed=100.0)),
        ("turbulence:intensity=20mrad,speed=360km/h,duration=200ms,length=1km,seed=3",
         turbulence(intensity=TWO, speed=100.0, duration=0.2, length=1000.0, seed=3)),
        ("table:0=0,100ms=0.02rad,1=2", Table([0.0, 0.1, 1.0], [0.0, TWO, 2.0])),
        ("table:0=0,100ms=0.02,unit=rad", Table([0.0, 0.1], [0.0, TWO])),
    ],
)  # fmt: skip
def test_numbers_in_other_units(rudder: wb.Model, text: str, signal: Signal) -> None:
    found = forced(rudder, "delC", text)
    assert type(found) is type(signal)
    given, wanted = ((s.times, s.values) if isinstance(s, Table) else tuple(vars(s).values()) for s in (found, signal))
    assert len(given) == len(wanted)
    for one, other in zip(given, wanted, strict=True):
        assert one == pytest.approx(other, rel=1e-14, abs=1e-14)


def test_a_level_has_the_offset_an_amplitude_has_not(heated: wb.Model) -> None:
    assert forced(heated, "u[1]", "20degC") == Constant(293.15)
    found = forced(heated, "u[1]", "sine:amplitude=2degC,frequency=1,offset=20degC")
    assert found == Sine(amplitude=2.0, frequency=1.0, offset=293.15)
    assert forced(heated, "u[1]", "prbs:hold=1,amplitude=9degF") == Prbs(hold=1.0, amplitude=5.0)
    assert forced(heated, "u[1]", "step:time=1,value=1degC,initial=0degC") == Step(time=1, value=274.15, initial=273.15)
    for kind in ("pulse", "gust"):
        words = rf"input u\[1\]: {kind}: value: 2degC may be a value or a difference.*; give it in K"
        with pytest.raises(InputError, match=words):
            forced(heated, "u[1]", f"{kind}:duration=1,value=2degC")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("2kg", "'kg' does not convert to its unit, deg; give a number in that, or a unit that does"),
        ("0.05Rad", "'Rad' does not convert to its unit, deg; did you mean rad?"),
        ("0,05rad", "'0,05rad' has a comma for its decimals; write a point, as in 0.05rad"),
        ("0,05", "'0,05' has a comma for its decimals; write a point, as in 0.05"),
        ("sine:amplitude=0,05rad,frequency=2", "sine: 'amplitude=0,05rad' has a comma for its decimals"),
        ("sine:amplitude=2kg,frequency=2", "sine: amplitude: 'kg' does not convert to its unit, deg"),
        ("sine:frequency=2s", "sine: frequency: 's' does not convert to Hz; give it in Hz"),
        ("sine:frequency=2,phase=2s", "sine: phase: 's' does not convert to deg"),
        ("step:time=2degC,value=1", "step: time: 'degC' does not convert to s"),
        ("prbs:hold=1,order=3s", "prbs: order: '3s' has a unit; give a whole number"),
        ("table:0=0,1m=2", "table: 'm' does not convert to s"),
        ("table:0=0,1=2rad,unit=rad", "table: give the unit once, as unit=rad or beside the values"),
        ("Sine:frequency=1", "'Sine:' is not a signal; did you mean sine?"),
        ("sine:frequency=2,amplitude=xrad", "sine: amplitude needs a number, as in amplitude=1.0, not 'xrad'"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_one_line(rudder: wb.Model, text: str, words: str) -> None:
    with pytest.raises(InputError) as caught:
        forced(rudder, "delC", text)
    assert str(caught.value).startswith(f"input delC: {words}")


def test_without_the_input_values_have_no_units() -> None:
    assert wb.parse_signal("step:time=100ms,value=1") == Step(time=0.1, value=1.0)
    with pytest.raises(InputError, match="'2rad' cannot be converted, since the input's unit is not known here"):
        wb.parse_signal("sine:amplitude=2rad,frequency=1")


@pytest.mark.parametrize(
    ("cell", "words"),
    [
        ("0.5rad", r"u\.csv: line 3: '0.5rad' has a unit, which belongs to the heading, as in 'u \[rad\]'"),
        ("1_0", r"u\.csv: line 3, cell 2: '1_0' is not a number; needs two columns of numbers"),
        ("", r"u\.csv: line 3, cell 2: is empty"),
        ("nan", r"u\.csv: line 3, cell 2: 'nan' is not a finite number"),
        ("0,5", r"u\.csv: line 3: '0,5' has a comma for its decimals; write a point, as in 0.5"),
    ],
)
def test_cells_of_a_file_are_plain_numbers(rudder: wb.Model, tmp_path: Path, cell: str, words: str) -> None:
    (tmp_path / "u.csv").write_text(f"time;delC\n0;0\n1;{cell}\n", encoding="utf-8")
    with pytest.raises(InputError, match=words):
        forced(rudder, "delC", str(tmp_path / "u.csv"))


def test_decimal_commas_in_a_file_are_told(rudder: wb.Model, tmp_path: Path) -> None:
    """Between commas "1,5" is two cells: read as 1, the signal would be another one."""
    file = tmp_path / "u.csv"
    file.write_text("time,delC\n0,1,5\n1,2,5\n", encoding="utf-8")
    with pytest.raises(InputError, match="line 2 has 3 cells below 2 headings; decimals follow a point"):
        forced(rudder, "delC", str(file))
    file.write_text("time;delC\n0;1\n0,5;2\n", encoding="utf-8")
    with pytest.raises(InputError, match="line 3, cell 1: '0,5' has a comma for its decimals; write a point"):
        forced(rudder, "delC", str(file))


def test_a_file_may_be_named_by_its_path(rudder: wb.Model, tmp_path: Path) -> None:
    file = tmp_path / "u.csv"
    file.write_text("time,delC\n0,1\n\n1,2\n", encoding="utf-8")
    assert forced(rudder, "delC", file) == forced(rudder, "delC", str(file)) == wb.parse_signal(file)


def test_the_command_line_and_a_record_have_the_inputs_unit(capfd: pytest.CaptureFixture[str]) -> None:
    words = ["simulate", "fmu:Rudder", "--stop", "0.3", "--output", "delC", "--json", "-", "--input"]
    assert command([*words, "delC=step:time=100ms,value=20mrad"]) == 0
    record = json.loads(capfd.readouterr().out)
    assert record["signals"]["delC"][-1] == pytest.approx(TWO)
    assert command([*words, "delC=2kg"]) == 2
    assert "input delC: 'kg' does not convert to its unit, deg" in capfd.readouterr().err


@pytest.mark.parametrize(
    ("words", "path", "value"),
    [
        ("nfr --input delC --output del --freq 1 --amplitude 20mrad,0.04rad", ["amplitude"], [TWO, 2.0 * TWO]),
        ("branches --input delC --output del --freq 1 --band 0.9:1.1 --amplitude 20mrad",
         ["branches", 0, "amplitude"], TWO),
        ("trim --u0 delC=0.02rad --float p1,p2", ["operating_point", "u", "delC"], TWO),
        ("trim --fix del=0.02rad --bound delC=-0.1rad:0.1rad --float p1,p2", ["operating_point", "y", "del"], TWO),
        ("lin --over delC=0.02rad,0.04rad --inputs delC --outputs del", ["over", "delC"], [TWO, 2.0 * TWO]),
    ],
)  # fmt: skip
def test_options_in_units_of_a_variable(
    words: str, path: list[str | int], value: object, capfd: pytest.CaptureFixture[str]
) -> None:
    name, *options = words.split()
    assert command([name, "fmu:Rudder", *options, "--json", "-"]) == 0
    found = json.loads(capfd.readouterr().out)
    for key in path:
        found = found[key]
    assert found == pytest.approx(value)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("nfr --input delC --output del --freq 1 --amplitude 2kg", "--amplitude: delC: 'kg' does not convert"),
        ("nfr --input delX --output del --freq 1 --amplitude 2deg", "input: Rudder has no variable 'delX'"),
        ("nfr --input delC --output del --freq 1 --amplitude 1,2deg", "--amplitude: '2deg' has a unit, and '1'"),
        ("nfr --input delC --output del --freq 2s --amplitude 1", "--freq: '2s' is not a number; give it in Hz"),
        ("trim --fix del=0,02", "--fix: del: '0,02' has a comma for its decimals; write a point, as in 0.02"),
        ("trim --bound delC=-5:5deg", "--bound: delC: '5deg' has a unit, and '-5' beside it has none"),
        ("lin --u0 delC=2K", "--u0: delC: 'K' does not convert to its unit, deg"),
        ("modes --vary m=1kg:2kg", "--vary: m: '1kg' is not a number"),
        ("branches --input delC --output del --freq 1 --vary m=1kg:2kg", "--vary: m: '1kg' is not a number"),
    ],
)  # fmt: skip
def test_options_whose_unit_does_not_fit(words: str, told: str, capfd: pytest.CaptureFixture[str]) -> None:
    name, *options = words.split()
    assert command([name, "fmu:Rudder", *options]) == 2
    assert told in capfd.readouterr().err


@pytest.mark.parametrize("text", ["5 1/s", "5%", "2µm", "-2.5e3 m/s", "20 ℃", ".5[rad]", "3°", "7kg.m2/s2"])
def test_units_begin_like_units(text: str) -> None:
    assert quantity(text)[1] in text


@pytest.mark.parametrize("text", ["1:2", "5;", "2=3", "5_m", "1 / 2", "m", "5,,m"])
def test_what_follows_a_number_may_be_no_unit(text: str) -> None:
    with pytest.raises(ValueError, match="is not a number with a unit, as in 25deg"):
        quantity(text)


def test_a_quantity_is_written_as_it_is_read() -> None:
    found = amount("-5e-2 rad")
    assert (float(found), str(found)) == (-0.05, "-0.05rad")
    assert found not in (-0.05, amount("-0.05deg"))  # 1deg,1rad are two amplitudes
    assert pickle.loads(pickle.dumps(found)).unit == "rad"  # noqa: S301 - our own
    assert amount("2") == 2.0
    assert not isinstance(amount("2"), Quantity)


@pytest.mark.parametrize("unit", [("ms", "s", 1000), ("us", "s", 1_000_000), ("mm", "m", 1000)])
def test_thousandths_are_the_nearest_numbers(unit: tuple[str, str, int]) -> None:
    found = named_conversion(*unit[:2])
    assert found is not None
    assert all(in_other_unit(float(k), found) == k / unit[2] for k in range(3000))

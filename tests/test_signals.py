"""Signals: values, breaks, and their text form."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import workbench as wb
from workbench.errors import InputError
from workbench.signals.kinds import Constant, Prbs, Signal, Sine, Step, Table
from workbench.signals.text import parse_signal, signals_of


def test_sine_counts_its_phase_from_start() -> None:
    signal = Sine(amplitude=2.0, frequency=0.5, phase=90.0, offset=1.0, start=3.0)
    assert signal(3.0) == pytest.approx(3.0)
    assert signal(4.0) == pytest.approx(-1.0)
    assert signal.next_break(0.0) == math.inf


def test_step_is_a_right_limit() -> None:
    signal = Step(time=1.0, value=5.0, initial=2.0)
    assert signal(math.nextafter(1.0, 0.0)) == 2.0
    assert signal(1.0) == 5.0
    assert signal.next_break(0.0) == 1.0
    assert signal.next_break(1.0) == math.inf


@pytest.mark.parametrize("order", range(2, 15))
def test_prbs_has_maximum_length_and_balance(order: int) -> None:
    signal = Prbs(hold=1.0, order=order)
    length = 2**order - 1
    bits = np.array([signal(i + 0.5) for i in range(length)])
    assert bits.sum() == 1.0  # one more +1 than −1
    correlation = np.fft.ifft(np.abs(np.fft.fft(bits)) ** 2).real
    assert correlation[0] == pytest.approx(length)
    assert correlation[1:] == pytest.approx(np.full(length - 1, -1.0))


@given(st.floats(-1e3, 1e3), st.floats(1e-3, 10.0), st.integers(1, 500))
def test_prbs_value_changes_exactly_at_its_breaks(start: float, hold: float, seed: int) -> None:
    signal = Prbs(hold=hold, order=9, seed=seed, start=start)
    t = start
    for _ in range(5):
        after = signal.next_break(t)
        assert after > t
        assert signal(math.nextafter(after, -math.inf)) == signal(t)
        assert signal(after) != signal(t)
        t = after


def test_table_interpolates_holds_and_jumps() -> None:
    linear = Table([0.0, 1.0, 1.0, 2.0], [0.0, 2.0, 5.0, 7.0])
    assert [linear(t) for t in (-1.0, 0.5, 1.0, 1.5, 9.0)] == [0.0, 1.0, 5.0, 6.0, 7.0]
    assert linear.next_break(0.0) == 1.0
    assert linear.next_break(1.0) == 2.0
    stairs = Table([0.0, 1.0], [3.0, 4.0], "hold")
    assert [stairs(t) for t in (0.0, 0.999, 1.0, 5.0)] == [3.0, 3.0, 4.0, 4.0]


@pytest.mark.parametrize(
    ("text", "signal"),
    [
        ("0.5", Constant(0.5)),
        (" -1e3 ", Constant(-1000.0)),
        (
            "sine:amplitude=1,frequency=2,offset=0.5,phase=90",
            Sine(frequency=2.0, offset=0.5, phase=90.0),
        ),
        ("step:time=1,value=2", Step(time=1.0, value=2.0)),
        ("prbs:hold=0.1,order=7", Prbs(hold=0.1, order=7)),
    ],
)
def test_parse(text: str, signal: Signal) -> None:
    assert parse_signal(text) == signal


def test_parse_reads_a_table(tmp_path: Path) -> None:
    file = tmp_path / "input.csv"
    file.write_text("time;value\n0;1\n2;3\n")
    assert parse_signal(str(file))(1.0) == 2.0


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("sine:amplitude=1", "frequency is missing"),
        ("sine:frequency=0", "must be positive"),
        ("sine:frequency=-2", "must be positive"),
        ("sine:freqency=2", "did you mean frequency"),
        ("step:time=1,value=x", "needs a number"),
        ("saw:frequency=1", "is not a signal"),
        ("nowhere.csv", "cannot be read"),
        ("nan", "finite"),
        ("prbs:hold=0.1,order=40", "order must be"),
        ("prbs:hold=0.1,order=2.5", "whole number"),
    ],
)
def test_parse_refuses_in_one_line(text: str, words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        parse_signal(text)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("times", "values", "words"),
    [
        ([], [], "is empty"),
        ([0.0, 1.0], [1.0], "equally"),
        ([1.0, 0.0], [1.0, 2.0], "falls"),
        (["0", "1"], [1.0, 2.0], "times must be numbers, not '0'"),
        ([0.0, 1.0], np.zeros((2, 2)), r"values has the shape \(2, 2\)"),
    ],
)
def test_table_refuses(times: list[float], values: list[float], words: str) -> None:
    with pytest.raises(InputError, match=words):
        Table(times, values)


@pytest.mark.parametrize("wrong", [lambda t: t, {1.0, 2.0}, None])
def test_what_is_no_signal_is_refused_in_one_line(wrong: object) -> None:
    with pytest.raises(wb.InputError, match=r"input u: a \w+ is not a signal; give a number"):
        signals_of({"u": cast("Any", wrong)})


def test_a_model_that_is_not_open_is_refused_in_one_line() -> None:
    with pytest.raises(wb.InputError, match=r"'fmu:Rudder' is not open; write with wb\.load"):
        wb.simulate(cast("Any", "fmu:Rudder"), stop=1.0)
    with pytest.raises(wb.InputError, match=r"'fmu:Rudder' is not open; write with wb\.load"):
        wb.lin(cast("Any", "fmu:Rudder"))


def test_a_closed_model_is_refused_whatever_ran_before_and_an_open_one_where_a_file_is_wanted() -> None:
    with wb.load("fmu:FirstOrderLag") as model:
        wb.lin(model)
        with pytest.raises(wb.InputError, match="not an open model"):
            wb.check(model)  # type: ignore[arg-type]
    for f in (wb.lin, wb.trim, wb.simulate):
        with pytest.raises(wb.InputError, match="FirstOrderLag was closed"):
            f(model)


def test_a_whole_number_beyond_all_floats_is_one_line() -> None:
    for make in (lambda: wb.Constant(10**400), lambda: wb.Sine(amplitude=10**400, frequency=1.0)):
        with pytest.raises(wb.InputError, match="must be a finite number"):
            make()
    with (
        wb.load("fmu:FirstOrderLag") as model,
        pytest.raises(wb.InputError, match="a whole number beyond 1e308 is too large"),
    ):
        wb.simulate(model, stop=10**400)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("one", [np.float64(1), np.float32(1), np.int64(1), np.bool_(1), np.array(1.0)])
def test_a_signal_of_numpy_scalars_is_that_of_their_values(one: float) -> None:
    assert signals_of({"u": one, "v": [one, 2.0]}) == signals_of({"u": 1, "v": [1, 2.0]})
    assert type(Step(time=0.5, value=one).value) in (float, int, bool)
    assert repr(Table([0.0, one], [one, 2])) == repr(Table([0.0, 1.0], [1.0, 2.0]))
    assert repr(wb.gust(duration=one, value=one)) == repr(wb.gust(duration=1.0, value=1.0))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Step(time=cast("float", "1"), value=2.0), "step: time must be a number, not '1'"),
        (lambda: Sine(frequency=cast("float", "2")), "sine: frequency must be a number, not '2'"),
        (lambda: Prbs(hold=1.0, order=cast("int", "3")), "prbs: order must be a whole number, not '3'"),
        (lambda: wb.pulse(duration=cast("float", None)), "pulse: duration must be a number, not None"),
        (lambda: signals_of({"u": math.nan}), "input u: value must be a finite number, not nan"),
    ],
)
def test_a_signal_says_which_value_is_not_a_number(make: Callable[[], object], words: str) -> None:
    with pytest.raises(InputError, match=words):
        make()

"""Sampled time: periods are the rational numbers that were meant, and instants are rounded once."""

from __future__ import annotations

import math
from decimal import Decimal
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

import workbench as wb
from workbench.core.values.calendar import Calendar, Sampler, exact, simplest_between
from workbench.errors import InputError


def of(*pairs: tuple[float, float]) -> Calendar:
    return Calendar(tuple(Sampler(exact(period), exact(offset)) for period, offset in pairs))


class TestExact:
    def test_decimal_literals_are_exact(self) -> None:
        rng = np.random.default_rng(1)
        for digits in range(1, 16):
            for exponent in range(-9, 7):
                text = f"{rng.integers(1, 10**digits)}e{exponent}"
                assert exact(float(text)) == Fraction(Decimal(text)), text

    def test_fractions_from_arithmetic_are_exact(self) -> None:
        for q in range(1, 1000):
            for p in (1, 2, q + 1, 7 * q - 1):
                assert exact(p / q) == Fraction(p, q)

    def test_what_arithmetic_made_of_them_is_the_same(self) -> None:
        for q in range(1, 200):
            for p in range(1, 20):
                assert exact(p * (1 / q)) == Fraction(p, q)
                assert exact(p * 0.01) == Fraction(p, 100)

    def test_it_rounds_to_the_double_it_was_made_of(self) -> None:
        rng = np.random.default_rng(2)
        for value in (10.0 ** rng.uniform(-12, 12, 500)).tolist():
            assert float(exact(value)) == value
            assert exact(-value) == -exact(value)
        assert exact(0.0) == 0

    def test_long_decimals_keep_their_ratio(self) -> None:
        assert exact(0.246913578024) == 2 * exact(0.123456789012)


def test_the_simplest_fraction_has_the_smallest_denominator() -> None:
    rng = np.random.default_rng(3)
    for _ in range(200):
        low, width = rng.uniform(0.01, 3.0), 10.0 ** rng.uniform(-3, -1)
        found = simplest_between(Fraction(low), Fraction(low + width))
        assert low <= found <= low + width
        assert all(math.floor((low + width) * q) < math.ceil(low * q) for q in range(1, found.denominator))


class TestCalendar:
    def test_instants_that_coincide_are_the_same_double(self) -> None:
        fast, slow = Sampler(exact(0.1)), Sampler(exact(0.3))
        assert all(fast.instant(3 * k) == slow.instant(k) for k in range(1000))
        assert fast.instant(3) != 3 * 0.1

    def test_integers_give_the_instants(self) -> None:
        sampler = Sampler(exact(0.06), exact(1 / 7))
        first, step, denominator = sampler.integers
        assert [(first + k * step) / denominator for k in range(100)] == [sampler.instant(k) for k in range(100)]

    @pytest.mark.parametrize(
        ("pairs", "basic", "gap"),
        [
            (((0.1, 0.0), (0.3, 0.0)), Fraction(3, 10), 0.1),
            (((0.06, 0.0), (0.04, 0.0)), Fraction(12, 100), 0.04),
            (((0.06, 0.0), (0.04, 0.005)), Fraction(12, 100), 0.04),
            (((1 / 3, 0.0), (0.5, 0.0)), Fraction(1), 1 / 3),
            (((0.2, 1.7),), Fraction(1, 5), 0.2),
        ],
    )
    def test_basic_period_and_longest_gap(
        self, pairs: tuple[tuple[float, float], ...], basic: Fraction, gap: float
    ) -> None:
        """By hand: 0 and 60 ms beside 5, 45 and 85 ms leave 40 ms between 5 and 45, or 85 and 120, at most."""
        assert (of(*pairs).basic_period, of(*pairs).longest_gap) == (basic, gap)

    @pytest.mark.parametrize("step", [Fraction(3, 50), Fraction(1, 3), Fraction(7, 1000)])
    def test_what_coincides_is_the_same_double(self, step: Fraction) -> None:
        fast, slow = Sampler(step), Sampler(3 * step, step)
        assert [slow.instant(k) for k in range(1000)] == [fast.instant(3 * k + 1) for k in range(1000)]

    def test_periods_that_hardly_repeat_are_refused(self) -> None:
        with pytest.raises(InputError, match=r"0\.1, 0\.1000001 s repeat together after"):
            _ = of((0.1, 0.0), (0.1000001, 0.0)).basic_period

    def test_a_period_must_be_positive(self) -> None:
        with pytest.raises(InputError, match="positive"):
            Sampler(exact(0.0))


def test_a_number_of_numpy_is_as_exact_as_one_of_python() -> None:
    assert exact(np.float64(0.004554244107364149)) == exact(0.004554244107364149)


def test_samples_that_are_lost_in_the_rounding_of_a_late_start_are_refused(tmp_path: Path) -> None:
    """Half of them went missing in silence: seconds since 1970 as the start."""
    (file := tmp_path / "late.toml").write_text(
        "[components]\nc = {A = [[1.0]], B = [[1.0]], C = [[1.0]], dt = 0.05}\n"
        'h = {block = "zero_order_hold", period = 0.1}\n'
        '[connections]\n"h.u" = "c.y"\n[inputs]\nu = "c.u"\n[outputs]\ny = "h.y"\n'
    )
    with (
        wb.load(file, start=1.7e9) as model,
        pytest.raises(InputError, match=r"samples every 0\.05 s cannot be told apart at a time of 1\.7e\+09 s"),
    ):
        wb.simulate(model, stop=1.7e9 + 1.0, inputs={"u": 1.0})
    with wb.load(file, start=1e6) as model:
        found = wb.simulate(model, stop=1e6 + 1.0, inputs={"u": 1.0})
    assert found.signals["y"][-1] == 20.0


def test_numbers_of_many_digits_are_not_taken_for_simpler_ones_nearby() -> None:
    """Within 2000 units in the last place nearly all numbers of nine digits have a simpler neighbour, by chance."""
    random = np.random.default_rng(5)
    written = [Fraction(int(n), 10**9) for n in random.integers(10**8, 10**9, 300)]
    assert [exact(float(f), 2000.0) for f in written] == written
    assert exact(1.0 / 3.0 + 1e-14, 2000.0) == Fraction(1, 3)


@pytest.mark.parametrize("dt", [1e-9, 1e-12])
def test_a_run_of_too_many_samples_is_refused(dt: float) -> None:
    """By name and number, at once: a run of 1 s would not end."""
    one = np.ones((1, 1))
    fast = wb.LinearComponent(name="fast", A=0.5 * one, B=one, C=one, D=0.0 * one, dt=dt, x0=np.zeros(1),
                              state_names=("x",), input_names=("u",), output_names=("y",))  # fmt: skip
    model = wb.connect({"fast": fast}, inputs={"u": "fast.u"}, outputs={"y": "fast.y"})
    signals = {"u": wb.Constant(1.0)}
    with model, model.open_session(signals=signals) as session:
        session.advance(10.5 * dt, signals=signals)
        assert session.values(["y"])["y"] == 2.0 * (1.0 - 0.5**10)
        with pytest.raises(InputError, match=f"fast samples every {dt:g} s: .* samples in a run from .* to 1 s"):
            session.advance(1.0, signals=signals)


def test_a_fast_system_is_linear_as_a_slow_one_is() -> None:
    """A probe that ran for a fixed time would make a million samples of it."""
    one = np.ones((1, 1))
    fast = wb.LinearComponent(name="fast", A=0.5 * one, B=one, C=one, D=0.0 * one, dt=1e-12, x0=np.zeros(1),
                              state_names=("x",), input_names=("u",), output_names=("y",))  # fmt: skip
    with wb.connect({"fast": fast}, inputs={"u": "fast.u"}, outputs={"y": "fast.y"}) as model:
        found = wb.lin(model)
    assert (found.dt, found.A.tolist()) == (1e-12, [[0.5]])

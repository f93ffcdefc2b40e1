"""Sampled, hybrid and multirate models: rates, the basic period, Kalman and Bertram's map in closed form."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.lin_fmus import built, fmu
from workbench.core.values.arrays import Floats
from workbench.errors import InputError
from workbench.model.load import load
from workbench.model.sample_rates import basic_period, sample_periods
from workbench.point.lin.request import lin
from workbench.response.nfr.request import nfr

LOOP = """
model Loop
  input Real u(start = 0.3);
  output Real y;
  parameter Real a = -2;
  Real x(start = 0.2, fixed = true, nominal = 1);
  discrete Real z(start = 0.1, fixed = true, nominal = 1);
  discrete Real copy(start = 0, fixed = true);
equation
  der(x) = a * x + 3 * z + u;
  when sample(0, 0.1) then
    z = -0.7 * x + 0.5 * pre(z);
    copy = 2 * x;
  end when;
  y = x + copy;
end Loop;
"""

MULTIRATE = """
model Multirate
  input Real u(start = 0);
  output Real y;
  Real f;
  discrete Real fast(start = 0, fixed = true, nominal = 1);
  discrete Real slow(start = 0, fixed = true, nominal = 1);
equation
  when sample(0, 0.1) then
    fast = 0.9 * pre(fast) + u;
  end when;
  when sample(0, 0.15) then
    slow = 0.8 * pre(slow) + f;
  end when;
  f = fast;
  y = slow + 0.5 * fast;
end Multirate;
"""


def test_periods_are_taken_apart() -> None:
    times: Floats = np.unique(np.concatenate([np.arange(1.0, 400.0) / 208.0, np.arange(1.0, 252.0) / 131.0]))
    times = times[times < 1.9]
    assert sample_periods(times) == pytest.approx((1 / 208, 1 / 131), rel=1e-9)
    assert sample_periods(0.022 * np.arange(1.0, 10.0)) == pytest.approx((0.022,))
    three: Floats = np.unique(np.round(np.concatenate([p * np.arange(1.0, 1.5 / p) for p in (0.04, 0.06, 0.1)]), 9))
    assert sample_periods(three) == pytest.approx((0.04, 0.06, 0.1))
    offset: Floats = np.sort(np.concatenate([0.03 + 0.1 * np.arange(20), 0.5 * np.arange(1, 4)]))
    assert sample_periods(offset) == pytest.approx((0.1, 0.5))


@pytest.mark.parametrize("times", [[0.1, 0.2], [1.0, 2.0, 4.0, 8.0, 16.0]])
def test_events_without_a_rate_are_refused(times: list[float]) -> None:
    with pytest.raises(InputError, match="give periods"):
        sample_periods(np.array(times))


@pytest.mark.parametrize(
    ("periods", "tolerance", "expected"),
    [
        ((0.1, 0.15), 1e-6, 0.3),
        ((1 / 208, 1 / 131), 1e-6, 1.0),
        ((0.1, 0.2000001), 1e-3, 0.2),
        ((0.02,), 1e-6, 0.02),
        ((0.1, 0.15, 0.04), 1e-9, 0.6),
    ],
)
def test_the_basic_period(periods: tuple[float, ...], tolerance: float, expected: float) -> None:
    assert basic_period(periods, tolerance) == pytest.approx(expected, rel=max(tolerance, 1e-9))


@pytest.mark.parametrize("periods", [(0.1, 0.1 * math.pi), (0.0,), ()])
def test_no_common_period(periods: tuple[float, ...]) -> None:
    with pytest.raises(InputError):
        basic_period(periods, 1e-12)


def test_a_hybrid_loop_in_closed_form() -> None:
    with load(built(LOOP, "Loop"), "me") as model:
        result = lin(model).result
    assert result.method == "kalman-bertram"
    assert result.dt == pytest.approx(0.1)
    assert result.state_names == ("x", "z")
    e, T = math.exp(-0.2), 0.1
    g = (1.0 - e) / 2.0
    # From just before the sample: first G, then the flow with the new z
    A = np.array([[e - 0.7 * 3 * g, 0.5 * 3 * g], [-0.7, 0.5]])
    assert np.allclose(result.A, A, atol=1e-7)
    assert np.allclose(result.B, [[g], [0.0]], atol=1e-7)
    assert np.allclose(result.C, [[3.0, 0.0]], atol=1e-9)
    # the eigenvalues of G·e^(FT)
    G, flow = np.array([[1, 0], [-0.7, 0.5]]), np.array([[e, 3 * g], [0, 1]])
    assert sorted(result.poles.real) == pytest.approx(sorted(np.linalg.eigvals(G @ flow).real), abs=1e-6)
    assert pytest.approx(result.operating_point.period or 0.0) == T
    assert not result.doubts
    assert any("copy" in note for note in result.notes)


def test_two_rates_in_closed_form() -> None:
    with load(built(MULTIRATE, "Multirate"), "me") as model:
        result = lin(model).result
    assert result.dt == pytest.approx(0.3)

    def period(fast: float, slow: float, u: float) -> tuple[float, float]:
        for tick in (0.0, 0.1, 0.15, 0.2):
            fast = 0.9 * fast + u if tick != 0.15 else fast
            slow = 0.8 * slow + fast if tick in (0.0, 0.15) else slow
        return fast, slow

    expected = np.array([period(1, 0, 0), period(0, 1, 0), period(0, 0, 1)]).T
    assert np.allclose(np.hstack([result.A, result.B]), expected, atol=1e-9)
    assert np.allclose(result.C, [[1.5 * 0.9, 0.8]], atol=1e-9)
    assert result.D[0, 0] == pytest.approx(1.5)


def test_given_periods_stand_above_found_ones() -> None:
    with load(built(LOOP, "Loop"), "me", periods=[0.1, 0.2]) as model:
        result = lin(model).result
    assert result.dt == pytest.approx(0.2)


def test_a_fast_sampler_with_coarse_steps_is_flat() -> None:
    with load("fmu:TwoRateQuantizer", "me") as model:
        flat = lin(model).result
        wide = lin(model, du=5.0).result
    assert flat.dt == pytest.approx(1.0)
    assert not flat.D.any()
    assert "locally flat" in flat.zeros[0].reason
    assert wide.D[0, 0] == pytest.approx(2.0)
    assert flat.state_names == ()


def test_elevator_law_against_a_small_sine() -> None:
    frequencies = np.array([0.5, 2.0, 4.0, 6.5, 9.1])
    point = {"deflection": 2.0 + 6.9 * 0.192}
    with load(fmu("ElevatorLaw"), "me") as model:
        result = lin(model, x0=point, u0={"side_stick": 0.2}, inputs=["side_stick"]).result
        recipe = replace(model.recipe, start_values=point, bias={"side_stick": 0.2})
        with recipe.open() as moved:
            measured = nfr(moved, "side_stick", "elevator", frequencies, [0.01])
    assert result.dt == pytest.approx(0.022)
    ratio = result.fundamental(frequencies)[:, 0, 0] / measured.response[0]
    assert np.max(np.abs(20.0 * np.log10(np.abs(ratio)))) < 0.5
    assert np.max(np.abs(np.degrees(np.angle(ratio)))) < 5.0


def test_what_a_sine_shows_of_a_hybrid_loop() -> None:
    """Input in continuous time, loop closed by a sampler: the linear model says what a sine would measure."""
    frequencies = np.array([0.3, 1.0, 2.0])
    with load(built(LOOP, "Loop"), "me", tolerance=1e-8) as model:
        result = lin(model).result
        # 10 whole samples in a period, else the response is not periodic
        measured = nfr(model, "u", "y", frequencies, [0.05], max_periods=40)
    settled = ~measured.averaged[0]
    ratio = (result.fundamental(frequencies)[:, 0, 0] / measured.response[0])[settled]
    assert np.max(np.abs(20.0 * np.log10(np.abs(ratio)))) < 0.5
    assert np.max(np.abs(np.degrees(np.angle(ratio)))) < 5.0


def test_a_whole_input_of_a_sampled_model_moves_by_one_to_both_sides() -> None:
    """At 3 the cubes of 4 and 2 are 56 apart, 28 for each."""
    text = """
model Cubes
  input Integer n(start = 3);
  output Real y;
  discrete Real z(start = 0, fixed = true);
equation
  when sample(0, 0.1) then
    z = 0.5 * pre(z) + n * n * n;
  end when;
  y = z;
end Cubes;
"""
    with load(built(text, "Cubes"), "me") as model:
        result = lin(model, inputs=["n"], method="kalman-bertram").result
    assert result.B.item() == pytest.approx(28.0, rel=1e-9)

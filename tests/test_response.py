"""Frequency responses: decibels, phases, interpolation, crossings, margins, differences, names: closed forms."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from workbench.core.values.decibels import decibels, degrees, difference, follow_phase, unwrapped
from workbench.core.values.linear import Linear, LinearPart
from workbench.core.values.response import Response
from workbench.errors import InputError

FREQUENCY = np.geomspace(0.01, 10.0, 400)
S = 2j * np.pi * FREQUENCY


def complex_of(values: NDArray[Any]) -> NDArray[np.complex128]:
    return values.astype(np.complex128)


def test_decibels_and_degrees() -> None:
    assert decibels([1.0, -10.0, 0.1j, 0.0]).tolist() == pytest.approx([0.0, 20.0, -20.0, -math.inf])
    assert degrees([1.0, 1j, -1.0, -1j]).tolist() == pytest.approx([0.0, 90.0, 180.0, -90.0])
    assert math.isnan(decibels(math.nan))


def test_phase_of_a_chain_of_lags_falls_by_many_turns() -> None:
    """1/(1 + s)^9: −9·arctan ω, −810° in the end; both rules agree where no step is large."""
    value = complex_of(1.0 / (1.0 + S) ** 9)
    truth = -9.0 * np.degrees(np.arctan(2.0 * np.pi * FREQUENCY))
    assert follow_phase(value) == pytest.approx(truth, abs=1e-9)
    assert unwrapped(value) == pytest.approx(truth, abs=1e-9)


def test_the_published_rule_takes_a_rise_of_more_than_100_degrees_for_a_turn_down() -> None:
    """Of φ + n·360° the one in (last − 260°, last + 100°]; `unwrapped` goes the shorter way."""
    value = np.exp(1j * np.radians([10.0, 105.0, 215.0]))
    assert follow_phase(value) == pytest.approx([10.0, 105.0, -145.0])
    assert unwrapped(value) == pytest.approx([10.0, 105.0, 215.0])


def test_what_has_no_phase_is_passed_over() -> None:
    value = np.array([1j, np.nan, 0.0, -1.0])
    for found in (follow_phase(value), unwrapped(value)):
        assert np.isnan(found).tolist() == [False, True, True, False]
        assert abs(found[3] - found[0]) in (90.0, 270.0)


def test_empty_response() -> None:
    none = Response(np.zeros(0), np.zeros(0, dtype=np.complex128))
    assert (none.gain_crossings(), none.phase_crossings()) == ([], [])
    assert len(none.phase_deg) == len(none.finer(4).value) == 0


def test_crossings_of_a_loop_of_three_lags() -> None:
    """k/(1 + s)³: real and negative at ω = √3 with −k/8; gain 1 at ω = √(k^(2/3) − 1)."""
    loop = Response(FREQUENCY, complex_of(4.0 / (1.0 + S) ** 3))
    (gain,), ((phase, upwards),) = loop.gain_crossings(), loop.phase_crossings()
    assert gain == pytest.approx(math.sqrt(4.0 ** (2.0 / 3.0) - 1.0) / (2.0 * math.pi), rel=1e-6)
    assert phase == pytest.approx(math.sqrt(3.0) / (2.0 * math.pi), rel=1e-6)
    assert upwards
    assert complex(loop.between(phase)) == pytest.approx(-0.5, abs=1e-5)


def test_interpolation_has_the_points_and_ends_with_them() -> None:
    response = Response(FREQUENCY[::20], complex_of(1.0 / (1.0 + S[::20])))
    assert response.between(response.frequency_hz) == pytest.approx(response.value, rel=1e-12)
    assert np.isnan(response.between([0.001, 100.0])).all()
    fine = response.finer(5)
    assert len(fine.value) == 5 * (len(response.value) - 1) + 1
    assert fine.value == pytest.approx(1.0 / (1.0 + 2j * np.pi * fine.frequency_hz), rel=2e-3)


def test_a_crossing_at_a_point_is_found_once() -> None:
    f = np.array([0.5, 1.0, 2.0])
    assert Response(f, np.array([2.0, 1.0, 0.5], dtype=np.complex128)).gain_crossings() == [1.0]
    on_end = Response(f, np.array([4.0, 2.0, 1.0], dtype=np.complex128))
    assert on_end.gain_crossings() in ([], [2.0])
    assert np.isfinite(on_end.between(2.0))


def test_difference_of_two_responses() -> None:
    gain, phase = difference([2.0, 1j, 1.0, np.nan], [1.0, 1.0, 0.0, 1.0])
    assert gain[:2] == pytest.approx([20.0 * math.log10(2.0), 0.0])
    assert phase[:2] == pytest.approx([0.0, 90.0])
    assert np.isnan([*gain[2:], *phase[2:]]).all()


def test_a_linear_part_and_its_points_have_the_same_crossings() -> None:
    part = LinearPart(np.diag([-1.0, -2.0, -4.0]), np.array([1.0, -4.0, 6.0]), np.array([30.0, 10.0, 5.0]))
    at = Response(FREQUENCY, part.response(FREQUENCY)).gain_crossings()
    assert [abs(part.at(f)) for f in at] == pytest.approx([1.0] * len(at), rel=1e-5)
    assert len(at) == 1


def plant(numerator: float, *poles: float) -> Linear:
    """Return numerator/((s − p₁)(s − p₂)…) as a chain of first-order lags."""
    chain = np.diag(np.array(poles)) + np.diag(np.ones(len(poles) - 1), -1)
    b, c = np.eye(len(poles))[0], numerator * np.eye(len(poles))[-1]
    return Linear(chain, b, c, np.zeros((1, 1)), input_names=("u",), output_names=("y",), units={"u": "V", "y": "rad"})


def test_a_second_order_plant_has_its_closed_form() -> None:
    """ω₀²/(s² + 2 D ω₀ s + ω₀²): gain 1/(2 D) and −90° at ω₀, −180° far above."""
    w, damping = 2.0 * math.pi * 0.7, 0.05
    model = Linear([[0.0, 1.0], [-w * w, -2.0 * damping * w]], [0.0, w * w], [1.0, 0.0], 0.0)  # type: ignore[arg-type]
    curve = model.curve(0, 0, [0.0007, 0.7, 700.0])
    assert curve.gain[:2] == pytest.approx([1.0, 10.0], rel=1e-5)
    assert curve.gain_db[1:] == pytest.approx([20.0, -120.0], abs=1e-4)
    assert curve.phase_deg == pytest.approx([0.0, -90.0, -180.0], abs=0.01)


@pytest.mark.parametrize(("order", "start"), [(1, -90.0), (2, -180.0)])
def test_the_phase_of_integrators_begins_below_zero(order: int, start: float) -> None:
    """1/s² is real and negative: whether rounding puts it at +180° or −180°, the phase is −180°."""
    curve = plant(1.0, *(0.0 for _ in range(order))).curve("u", "y", FREQUENCY)
    assert curve.phase_deg == pytest.approx(np.full(len(FREQUENCY), start), abs=1e-9)


def test_the_phase_of_a_delay_falls_without_end() -> None:
    """exp(−sT): −360°·f·T, gain 1 everywhere: no phase margin is left where the phase reaches −180°."""
    f = np.linspace(0.05, 10.0, 200)
    curve = Response(f, complex_of(np.exp(-2j * np.pi * f * 0.5)))
    assert curve.phase_deg == pytest.approx(-180.0 * f)
    half = Response(f, complex_of(0.5 * np.exp(-2j * np.pi * f * 0.5))).margins()
    assert half.gain_margin == pytest.approx(2.0)
    assert [c.frequency_hz for c in half.phase_crossovers] == pytest.approx([1.0, 3.0, 5.0, 7.0, 9.0], rel=1e-3)
    assert not half.gain_crossovers
    assert math.isnan(half.phase_margin_deg)  # beyond the band anything may be


def test_margins_of_a_loop_of_an_integrator_and_two_lags() -> None:
    """K/(s (s + 1) (s + 2)): gain margin 6/K at ω = √2; K = 1: |L| = 1 where ω² (ω² + 1) (ω² + 4) = 1."""
    found = plant(1.0, 0.0, -1.0, -2.0).curve("u", "y", np.geomspace(0.005, 2.0, 200)).margins()
    assert found.gain_margin == pytest.approx(6.0, rel=1e-4)
    assert found.phase_crossover_hz == pytest.approx(math.sqrt(2.0) / (2.0 * math.pi), rel=1e-4)
    roots = np.roots([1.0, 5.0, 4.0, -1.0])  # of ω²
    w = math.sqrt(float(roots[np.isreal(roots) & (roots.real > 0.0)][0].real))
    assert found.gain_crossover_hz == pytest.approx(w / (2.0 * math.pi), rel=1e-4)
    phase_margin = 90.0 - math.degrees(math.atan(w) + math.atan(w / 2.0))
    assert found.phase_margin_deg == pytest.approx(phase_margin, abs=0.01)
    assert found.delay_margin_s == pytest.approx(math.radians(phase_margin) / w, rel=1e-4)
    assert found.verdict == "not judged"


def test_a_curve_has_names_units_and_wrong_names_are_told() -> None:
    curve = plant(1.0, -1.0).curve("u", "y", [1.0])
    assert (curve.input, curve.output, curve.input_unit, curve.output_unit) == ("u", "y", "V", "rad")
    assert curve.amplitude is None
    with pytest.raises(InputError, match="no output 'x'"):
        plant(1.0, -1.0).curve("u", "x", [1.0])
    with pytest.raises(InputError, match="has 1 inputs, numbered from 0"):
        plant(1.0, -1.0).curve(1, 0, [1.0])


def test_a_response_becomes_one_of_python_control() -> None:
    f = np.array([0.1, 1.0, 2.0])
    response = Response(f, np.array([1.0, np.nan, 0.5j]), input="u", output="y")
    frd = response.to_frd(name="G")
    assert frd.omega == pytest.approx(2.0 * np.pi * f[[0, 2]])
    assert np.squeeze(frd.frdata) == pytest.approx([1.0, 0.5j])
    assert (frd.input_labels, frd.output_labels, frd.name) == (["u"], ["y"], "G")
    with pytest.raises(InputError, match="no point of the response has a value"):
        Response(f, complex_of(np.full(3, np.nan + 0j))).to_frd()


def test_the_difference_of_responses_stands_at_their_common_frequencies_with_both_errors() -> None:
    """2·exp(j30°) over 1: 6.02 dB and 30°; errors of 3 % and 4 % make 5 %, which is 0.446 dB and 2.87°."""
    f = np.array([1.0, 2.0, 3.0])
    one = Response(f, complex_of(np.full(3, 2.0 * np.exp(1j * np.pi / 6.0))), np.full(3, 0.03))
    found = one.difference(
        Response(np.array([0.5, 2.0, 3.0 * (1.0 + 1e-12)]), complex_of(np.ones(3)), np.full(3, 0.04))
    )
    assert found.frequency_hz.tolist() == [2.0, 3.0]
    assert found.gain_db == pytest.approx([20.0 * math.log10(2.0)] * 2)
    assert found.phase_deg == pytest.approx([30.0, 30.0])
    assert found.error == pytest.approx([0.05, 0.05])
    assert found.gain_error_db == pytest.approx([-20.0 * math.log10(0.95)] * 2)
    assert found.phase_error_deg == pytest.approx([math.degrees(math.asin(0.05))] * 2)
    assert one.difference(Response(f, complex_of(np.ones(3)))).error == pytest.approx([0.03] * 3)
    with pytest.raises(InputError, match="no frequency in common"):
        one.difference(Response(f + 0.5, complex_of(np.ones(3))))


def test_what_is_rounding_only_vanishes() -> None:
    """Two equal chambers, filled alike, move a piston by their difference only; by their sum or a leak they do."""
    stiff = 4e12
    A = np.array([[-13.4, 11.4, -stiff], [11.4, -13.4, stiff], [7e-4, -7e-4, -2e4]])
    both = Linear(
        A, np.array([[1.0, 1.0], [1.0, 1.0 + 1e-9], [0.0, 0.0]]), np.array([[0.0, 0.0, 1.0], [1.0, 1.0, 0.0]]),
        np.zeros((2, 2)), input_names=("supply", "leak"), output_names=("speed", "pressures"),
    )  # fmt: skip
    assert both.vanishes(FREQUENCY).all(axis=0).tolist() == [[True, False], [False, False]]
    assert not both.vanishes(FREQUENCY)[:, 1].any()
    assert both.without_effect == (("supply", "speed"),)
    assert not both.curve("supply", "speed", FREQUENCY).value.any()


def test_small_responses_and_other_units_are_not_taken_for_rounding() -> None:
    """A chain of ten lags falls to 1e-24 of its states in other units; each digit of it is true."""
    chain = plant(1.0, *(-1.0 for _ in range(10)))
    scale = np.logspace(-12, 12, 10)
    scaled = Linear(chain.A * scale[:, None] / scale, chain.B * scale[:, None], chain.C / scale, chain.D)
    f = np.geomspace(0.01, 1e3, 50)
    assert np.abs(scaled.response(f)[-1, 0, 0]) < 1e-36
    assert not scaled.vanishes(f).any()
    assert not scaled.part().vanishes(f).any()


@pytest.mark.parametrize(
    ("gain", "crossings"),
    [
        ([4.0, 2.0, 1.0], [3.0]),
        ([1.0, 2.0, 4.0], [1.0]),
        ([0.5, 1.0, 0.5], [2.0]),
        ([2.0, 1.0, 0.5], [2.0]),
        ([1.0, 1.0, 1.0], []),
        ([4.0, 3.0, 2.0], []),
    ],
)
def test_a_gain_of_one_at_a_point_is_a_crossing_once(gain: list[float], crossings: list[float]) -> None:
    curve = Response(np.array([1.0, 2.0, 3.0]), np.array(gain, dtype=complex))
    assert curve.gain_crossings() == pytest.approx(crossings)


def test_a_response_without_values_or_with_frequency_0_has_no_margins_beyond_them() -> None:
    nothing = Response(np.array([1.0, 2.0]), np.array([np.nan, 0.0], dtype=complex))
    assert np.isnan(nothing.between([1.0, 1.5])).all()
    assert not nothing.margins().gain_crossovers
    lag = Response(np.array([0.0, 1.0, 2.0]), np.array([3.0, 2.0, 0.5], dtype=complex))
    assert len(lag.margins().gain_crossovers) == 1
    with pytest.raises(InputError, match="frequencies of a response rise"):
        Response(np.array([2.0, 1.0]), np.ones(2, dtype=complex)).margins()

"""Frequency responses: decibels, phases, interpolation, crossings, differences: closed forms."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from workbench.core.linear import LinearPart
from workbench.core.response import Response, decibels, degrees, difference, follow_phase, unwrapped

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

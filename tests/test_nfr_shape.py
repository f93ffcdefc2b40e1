"""What is said of a curve between its points: peaks, falls and jumps, on curves whose truth is known."""

from __future__ import annotations

import cmath
import math
from dataclasses import replace

import numpy as np
import pytest

from tests.fakes import lag
from workbench.core.values.arrays import Floats
from workbench.core.values.decibels import decibels
from workbench.core.values.linear import LinearPart
from workbench.response.nfr.certificate import Certificate
from workbench.response.nfr.curve import fall_of, peak_of
from workbench.response.nfr.jumps import jumps, may_jump, stepped_over
from workbench.response.nfr.page import nfr_page
from workbench.response.nfr.point import NfrPoint, change
from workbench.response.nfr.prior_knowledge import LinearStart
from workbench.response.nfr.request import nfr
from workbench.response.nfr.result import NfrResult, percent


def second_order(f: Floats, natural: float, damping: float) -> Floats:
    s = 1j * f / natural
    return decibels(1.0 / (1.0 + 2.0 * damping * s + s * s))


def test_the_fall_brackets_the_true_bandwidth_of_many_systems() -> None:
    random = np.random.default_rng(1)
    found = 0
    for _ in range(300):
        natural, damping = float(np.exp(random.uniform(-1.0, 2.0))), float(random.uniform(0.05, 1.5))
        ratio = float(random.uniform(1.05, 2.0))
        f = 0.02 * natural * ratio ** np.arange(np.ceil(np.log(1000.0) / np.log(ratio)))
        error = np.full(len(f), float(random.choice([0.0, 1e-4, 0.02])))
        measured = second_order(f, natural, damping) + decibels(1.0 + error * random.uniform(-1.0, 1.0, len(f)))
        fall = fall_of(f, measured, error)
        assert fall is not None
        b = 1.0 - 2.0 * damping**2
        level = 10.0**0.3  # 3 dB, in power, below the gain 1
        truth = natural * np.sqrt(b + np.sqrt(b * b - 1.0 + level))
        # The gain at the first frequency, from which it falls, is 1 but for 0.4 permille of f².
        assert fall.low * 0.999 < truth < fall.high * 1.001
        assert error[0] > 0.0 or fall.high / fall.low == pytest.approx(ratio)
        found += 1
    assert found == 300


def test_a_fall_is_not_told_where_errors_leave_it_open() -> None:
    f, gain_db = np.array([1.0, 2.0, 4.0]), np.array([0.0, -4.0, -8.0])
    assert fall_of(f, gain_db, np.full(3, np.nan)) is None
    assert fall_of(f, gain_db, np.array([0.5, 0.0, 0.0])) is None
    wide = fall_of(f, gain_db, np.array([0.0, 0.3, 0.0]))
    assert wide is not None
    assert (wide.low, wide.high) == (1.0, 4.0)
    assert fall_of(f[:1], gain_db[:1], np.zeros(1)) is None


def test_a_cliff_is_told_from_a_steep_slope() -> None:
    f = np.array([1.0, 1.1, 1.2, 1.3, 1.4])
    jump = fall_of(f, np.array([0.0, 1.0, 2.0, -20.0, -20.5]), np.zeros(5))
    assert jump is not None
    assert jump.cliff
    slope = fall_of(np.array([1.0, 2.0, 4.0, 8.0]), np.array([0.0, -1.0, -13.0, -25.0]), np.zeros(4))
    assert slope is not None
    assert not slope.cliff


@pytest.mark.parametrize("damping", [0.02, 0.05, 0.1, 0.2, 0.3])
@pytest.mark.parametrize("ratio", [1.02, 1.1, 1.2, 1.5])
def test_a_peak_that_lies_more_than_a_decibel_above_the_points_is_said_to_be_open(damping: float, ratio: float) -> None:
    for shift in np.linspace(0.0, 1.0, 21):
        f = 10.0 * ratio ** (np.arange(-10, 10) + shift)
        peak = peak_of(f, second_order(f, 10.0, damping))
        assert peak is not None
        at = 10.0 * np.sqrt(1.0 - 2.0 * damping**2)
        missed = -decibels(2.0 * damping * np.sqrt(1.0 - damping**2)) - peak.gain_db
        if missed > 1.0:
            assert peak.between is not None
            assert peak.between[0] < at < peak.between[1]
        if ratio < 1.0 + 0.2 * damping:
            assert peak.between is None


def test_a_falling_curve_has_no_peak() -> None:
    assert peak_of(np.array([1.0, 2.0, 3.0]), np.array([0.0, -1.0, -2.0])) is None
    assert peak_of(np.array([]), np.array([])) is None


def point(
    frequency: float, gain: complex, error: float = 1e-3, *, averaged: bool = False, thd: float = 0.02
) -> NfrPoint:
    certificate = Certificate(errcrit=0.02, max_periods=20, thd=thd)
    return NfrPoint(
        frequency=frequency, amplitude=0.1, response=gain, offset=0.0, error=error, averaged=averaged,
        certificate=certificate,
    )  # fmt: skip


def test_a_peak_between_points_is_told_from_what_was_measured_there() -> None:
    row = [point(1.0, 1.0), point(2.0, 2.0), point(3.0, 1.5)]
    (told,) = stepped_over(row, [point(2.4, -4.0j), point(1.5, 1.7)])
    assert told.startswith("between 2 and 3 Hz, amplitude 0.1, the gain peaks: 4 at 2.4 Hz, 2 and 1.5 at the points")
    assert stepped_over(row, [point(2.4, 2.1, error=0.2)]) == []
    assert stepped_over(row, []) == []


def test_a_carried_sweep_that_jumps_says_so_though_its_points_have_not_settled() -> None:
    row = [point(0.20 + 0.01 * k, 9.0 + k, 0.05, averaged=True) for k in range(4)]
    row += [point(0.24, 4.4, 2.6, averaged=True), point(0.25, 0.63), point(0.26, 0.6)]
    (told,) = jumps(row, carried=True)
    assert told.startswith("between 0.23 and 0.25 Hz, amplitude 0.1, the response jumps from gain 12 to 0.63")
    assert jumps(row) == []
    assert jumps([replace(p, response=9.0) for p in row], carried=True) == []


def test_errors_as_percent() -> None:
    assert [percent(e) for e in (4.5e-10, 0.0123, 0.99, 0.999, 1.1, 2.64)] == [
        "4.5e-08",
        "1.2",
        "99",
        "100",
        "110",
        "260",
    ]


def lead(result: NfrResult) -> str:
    return nfr_page(result).lead


def curve_row(result: NfrResult) -> list[str]:
    """The row of the first amplitude: amplitude, −3 dB, −90°, highest gain, where."""
    section = next(s for s in nfr_page(result).sections if s.title == "Bandwidth and highest gain")
    return list(section.tables[0].rows[0])


def test_the_page_brackets_the_bandwidth_and_says_that_it_is_linear() -> None:
    result = nfr(lag(0.1), "u", "y", [0.1, 1.0, 1.5, 2.0, 3.0], [1.0, 2.0])
    text = lead(result)
    assert curve_row(result)[1] == "1.5 … 2"
    assert "The amplitudes agree within their errors: it is linear here." in text
    truth = np.sqrt(10.0**0.3 * (1.0 + (0.2 * np.pi * 0.1) ** 2) - 1.0) / (0.2 * np.pi)
    assert 1.5 < truth < 2.0


def test_the_page_gives_no_bandwidth_above_a_resonance() -> None:
    plain = nfr(lag(0.1), "u", "y", [1.0, 1.1, 1.2, 1.3, 1.4, 1.5], [1.0])
    peaked = replace(plain, response=np.array([[1.0, 3.0, 10.0, 2.0, 0.5, 0.3]], dtype=np.complex128))
    assert curve_row(peaked)[1::2] == ["–", "≥ 20.00"]
    assert curve_row(peaked)[4] == "1.1 … 1.3"
    flat = replace(plain, response=np.array([[1.0, 1.1, 1.0, 0.8, 0.6, 0.5]], dtype=np.complex128))
    assert curve_row(flat)[1] == "1.3 … 1.4"


def test_the_page_says_where_the_gain_passes_the_level_without_being_a_bandwidth_and_why() -> None:
    plain = nfr(lag(0.1), "u", "y", [1.0, 1.1, 1.2, 1.3, 1.4, 1.5], [1.0])
    peaked = replace(plain, response=np.array([[1.0, 3.0, 10.0, 2.0, 0.5, 0.3]], dtype=np.complex128))
    words = "between 1.3 and 1.4 Hz, above a resonance: that is not a bandwidth"
    assert any(words in text for text in _told(peaked))
    flat = replace(plain, response=np.array([[1.0, 1.1, 1.0, 0.8, 0.6, 0.5]], dtype=np.complex128))
    assert not any("bandwidth." in text and "passes" in text for text in _told(flat))


def _told(result: NfrResult) -> list[str]:
    return list(next(s for s in nfr_page(result).sections if s.title == "Bandwidth and highest gain").paragraphs)


def test_the_change_from_one_measurement_to_another() -> None:
    """Half as large and 30° later; nothing where both vanish; without bound where one of them fails or vanishes."""
    one, later = point(1.0, 2.0), point(1.0, cmath.rect(1.0, -math.pi / 6.0))
    gain, phase_deg = change(one, later)
    assert gain == pytest.approx(0.5)
    assert phase_deg == pytest.approx(30.0)
    none, failed = point(1.0, 0.0), replace(one, response=None)
    assert change(none, none) == (0.0, 0.0)
    for old, new in ((none, one), (one, none), (failed, one), (one, failed), (failed, none), (failed, failed)):
        assert change(old, new) == (math.inf, math.inf)


@pytest.mark.parametrize(("gain", "bent"), [(1.0, False), (0.98, False), (0.9, True), (1.1, True), (0.0, True)])
@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_a_response_that_departs_by_3_per_cent_from_the_linear_one_may_jump_whatever_its_size(
    gain: float, bent: bool, size: float
) -> None:
    """The linear model is a gain."""
    linear = LinearStart(LinearPart(np.zeros((0, 0)), np.zeros(0), np.zeros(0), size), np.zeros(0), np.zeros(0))
    assert may_jump([point(1.0, gain * size)], linear) == bent


def test_no_response_of_no_linear_response_is_not_bent() -> None:
    linear = LinearStart(LinearPart(np.zeros((0, 0)), np.zeros(0), np.zeros(0), 0.0), np.zeros(0), np.zeros(0))
    assert not may_jump([point(1.0, 0.0)], linear)
    assert may_jump([point(1.0, 1e-9)], linear)

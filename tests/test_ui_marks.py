"""What is marked in pictures of frequency responses: resonances and where the gain falls."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import workbench as wb
from workbench.core.values.arrays import Complex, Floats
from workbench.response.nfr.features import CurveFeatures
from workbench.ui.marks import brief_of, nfr_marks, response_marks

HZ = np.geomspace(0.1, 10.0, 400)
ZETA = 0.1  # of a mode at 1 Hz
PEAK = math.sqrt(1.0 - 2.0 * ZETA**2)  # where the gain of such a mode is largest [Hz]


def mode(hz: Floats, damping: float = ZETA) -> Complex:
    return np.asarray(1.0 / (1.0 - hz**2 + 2j * damping * hz), dtype=np.complex128)


def peaks(value: Complex, hz: Floats = HZ) -> list[float]:
    return [mark["hz"] for mark in response_marks(hz, value) if mark["what"] == "resonance"]


def test_a_resonance_is_marked_where_the_gain_is_largest() -> None:
    (mark,) = [m for m in response_marks(HZ, mode(HZ)) if m["what"] == "resonance"]
    assert mark["hz"] == pytest.approx(PEAK, rel=0.012)  # half a distance of points
    assert mark["db"] == pytest.approx(-20.0 * math.log10(2.0 * ZETA * math.sqrt(1.0 - ZETA**2)), abs=0.01)


def test_a_resonance_on_a_slope_is_marked_though_the_slope_is_higher_elsewhere() -> None:
    on_a_slope = mode(HZ) / (2j * np.pi * HZ)
    assert np.argmax(np.abs(on_a_slope)) == 0
    (hz,) = peaks(on_a_slope)
    assert hz == pytest.approx(PEAK, rel=0.05)
    assert peaks(on_a_slope[::-1], HZ[::-1]) == [hz]  # in whatever order the points come


def test_what_only_falls_or_ripples_has_no_resonance() -> None:
    lag = 1.0 / (1.0 + 1j * HZ)
    ripple = 10.0 ** (0.2 * np.sin(40.0 * np.log(HZ)) / 20.0)  # of 0.2 dB
    for value in (lag, lag / (1j * HZ), lag * ripple, mode(HZ, 0.8), np.full(len(HZ), 1.0 + 0j)):
        assert peaks(np.asarray(value, dtype=np.complex128)) == []
    gaps = mode(HZ)
    gaps[::7] = np.nan
    assert len(peaks(gaps)) == 1


def test_what_was_measured_is_marked_in_place_of_what_lies_between_points() -> None:
    with wb.load("fmu:FirstOrderLag", tolerance=1e-8) as model:
        plain = wb.nfr(model, "u", "y", [0.01, 0.05, 0.1, 0.2, 0.4], [1.0])
        measured = wb.nfr(model, "u", "y", [0.01, 0.05, 0.1, 0.2, 0.4], [1.0], bandwidth=3.0)
    (one,) = measured.features
    assert one.bandwidth_hz is not None
    (between,), (mark,) = nfr_marks(plain, 0), nfr_marks(measured, 0)
    assert between["hz"] != pytest.approx(one.bandwidth_hz, rel=1e-4)  # read from a straight line
    assert mark["hz"] == one.bandwidth_hz
    assert mark["db"] == pytest.approx(float(measured.gain_db[0, 0]) - 3.0)
    assert brief_of(measured) == mark["text"] == f"−3 dB at {one.bandwidth_hz:.4g} Hz"
    bump = replace(measured, features=(CurveFeatures(1.0, 3.0, resonance_hz=0.07, resonance_gain_db=1.25),))
    (peak,) = nfr_marks(bump, 0)  # and no fall, where the record has found none
    assert (peak["hz"], peak["db"]) == (0.07, 1.25)

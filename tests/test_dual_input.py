"""Dual-input describing functions against exact integrals."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import ellipe, ellipk

import workbench as wb


@pytest.mark.parametrize(("a", "b"), [(1.0, 0.0), (2.0, 1.5), (0.3, -4.0)])
def test_cubic_beside_a_bias(a: float, b: float) -> None:
    mean, gain = wb.gain_beside_bias(wb.standard_block("cubic", {"coefficient": 2.0}), a, b)
    assert mean == pytest.approx(2.0 * (b**3 + 1.5 * a * a * b), abs=1e-12)
    assert gain == pytest.approx(2.0 * (0.75 * a * a + 3.0 * b * b))


@pytest.mark.parametrize(("a", "b"), [(1.0, 0.3), (2.0, -1.9), (1.0, 1.5)])
def test_relay_beside_a_bias(a: float, b: float) -> None:
    ratio = max(-1.0, min(1.0, b / a))
    mean, gain = wb.gain_beside_bias(wb.standard_block("relay", {"level": 3.0}), a, b)
    assert mean == pytest.approx(6.0 / math.pi * math.asin(ratio), abs=1e-9)
    assert gain == pytest.approx(12.0 / (math.pi * a) * math.sqrt(1.0 - ratio * ratio), abs=1e-9)


def test_hysteresis_shifts_its_phase_beside_a_bias() -> None:
    """On above B + A sin θ = h, off below −h: the fundamental from the two instants."""
    a, b, h = 1.0, 0.2, 0.3
    mean, gain = wb.gain_beside_bias(wb.standard_block("relay_with_hysteresis", {"half_width": h}), a, b)
    on, off = math.asin((h - b) / a), math.pi + math.asin((h + b) / a)
    assert mean == pytest.approx(2.0 * (off - on) / (2.0 * math.pi) - 1.0, abs=1e-6)
    y = 2.0 / (1j * math.pi) * (np.exp(-1j * on) - np.exp(-1j * off))
    assert gain == pytest.approx(complex(y / (-1j * a)), abs=1e-6)


@pytest.mark.parametrize(("a", "b"), [(1.0, 2.0), (3.0, 0.5), (1.0, 1.0)])
def test_cubic_beside_a_sine(a: float, b: float) -> None:
    assert wb.beside_sine(wb.standard_block("cubic"), b).gain(a) == pytest.approx(0.75 * a * a + 1.5 * b * b)


@pytest.mark.parametrize(("a", "b"), [(0.5, 1.0), (0.9, 1.0), (0.01, 1.0), (2.0, 1.0)])
def test_relay_beside_a_sine(a: float, b: float) -> None:
    """By the complete elliptic integrals, for A < B: 8/(π²A) · (E − (1 − k²) K)/k with k = A/B."""
    found = wb.beside_sine(wb.standard_block("relay"), b).gain(a).real
    if a < b:
        k = a / b
        exact = 8.0 / (math.pi**2 * a) * (ellipe(k * k) - (1.0 - k * k) * ellipk(k * k)) / k
        assert found == pytest.approx(exact, rel=1e-4)
    mean, _ = quad(lambda t: math.asin(max(-1.0, min(1.0, a * math.sin(t) / b))) * math.sin(t), 0.0, math.pi, limit=400)
    assert found == pytest.approx(4.0 / (math.pi**2 * a) * mean, rel=1e-4)


def test_dither_makes_a_relay_a_gain() -> None:
    """A small signal sees 2M/(πB); a loop that the relay would keep oscillating is quiet then."""
    dithered = wb.beside_sine(wb.standard_block("relay"), 2.0)
    assert dithered.gain(1e-3).real == pytest.approx(1.0 / math.pi, rel=1e-4)
    assert dithered.static(np.array([0.7]))[0] == pytest.approx(2.0 / math.pi * math.asin(0.35), rel=1e-6)


def test_what_cannot_be_is_told() -> None:
    with pytest.raises(wb.InputError, match="is not above 0"):
        wb.gain_beside_bias(wb.standard_block("relay"), 0.0, 1.0)
    with pytest.raises(wb.InputError, match="backlash"):
        wb.beside_sine(wb.standard_block("backlash"), 1.0)

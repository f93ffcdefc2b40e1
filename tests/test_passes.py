"""Peaks between the samples of a record."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from workbench.response.simulate.zero_crossings import half_range, highest


@pytest.mark.parametrize("samples", [10, 24, 200])
def test_peaks_of_a_smooth_motion_are_found_between_its_samples(samples: int) -> None:
    for phase in np.linspace(-0.3, 0.3, 31):
        angle = phase + 2.0 * math.pi * np.arange(2 * samples) / samples
        assert half_range(np.sin(angle)) == pytest.approx(1.0, abs=0.5 * math.pi**4 / samples**4)


def test_peaks_of_a_relaxation_oscillation_are_not_made_higher_by_the_jump_beside_them() -> None:
    """Van der Pol's oscillator at μ = 20: a parabola through the jump had its peaks 12 % too high."""
    mu = 20.0
    solution = solve_ivp(
        lambda t, s: [s[1], mu * (1.0 - s[0] ** 2) * s[1] - s[0]],
        (0.0, 200.0), [2.0, 0.0], method="Radau", rtol=1e-8, atol=1e-9, dense_output=True,
    )  # fmt: skip
    amplitude = 0.5 * float(np.ptp(solution.sol(np.linspace(80.0, 180.0, 100001))[0]))
    assert amplitude == pytest.approx(2.0078, abs=2e-4)
    for start in np.linspace(80.0, 81.0, 23):
        found = half_range(solution.sol(start + np.arange(400) / 200.0 * 34.68)[0])
        assert found == pytest.approx(amplitude, rel=2e-3)


def test_a_peak_at_a_jump_or_a_kink_or_an_event_is_its_largest_sample() -> None:
    t = np.arange(7.0)
    assert highest(t, np.array([0.0, 0.0, 0.0, 4.0, 3.9, 3.8, 3.7])) == (4.0, 3.0)
    assert highest(t, np.array([1.0, 2.0, 3.0, 4.0, 3.0, 2.0, 1.0])) == (4.0, 3.0)
    twice = np.array([0.0, 1.0, 2.0, 2.0, 2.0, 3.0, 4.0])
    assert highest(twice, np.array([0.0, 1.0, 2.0, 5.0, 4.9, 4.0, 3.0])) == (5.0, 2.0)
    assert highest(np.array([0.0]), np.array([3.0])) == (3.0, 0.0)


def test_a_kink_has_no_parabola_through_it() -> None:
    """Second differences −0.1, −2.4 and −0.1: the largest sample is what is known of the peak."""
    x = np.cumsum([0.0, 2.0, 1.9, -0.5, -0.6])
    assert highest(np.arange(5.0), x) == pytest.approx((3.9, 2.0))

"""Gusts of the rule by their gradient, and turbulence against von Kármán's spectrum."""

from __future__ import annotations

import math

import numpy as np
import pytest

import workbench as wb
from workbench.errors import InputError

SIGMA, V, L, STEP, DURATION = 1.5, 250.0, 762.0, 0.01, 200.0


def von_karman(omega: float) -> float:
    """Return the density of vertical turbulence, of both signs together [(m/s)²·s/rad]."""
    x = (1.339 * omega * L / V) ** 2
    return float(SIGMA**2 * L / (math.pi * V) * (1.0 + 8.0 * x / 3.0) / (1.0 + x) ** (11.0 / 6.0))


def test_turbulence_has_the_spectrum_and_the_root_mean_square_asked_for() -> None:
    pieces = [
        np.array(wb.turbulence(intensity=SIGMA, speed=V, duration=DURATION, length=L, step=STEP, seed=seed).values[:-1])
        for seed in range(40)
    ]
    mean_square = np.mean([np.mean(x**2) for x in pieces])
    # What lies below one period of the piece and above half the rate of its points is left out.
    lines = 2.0 * math.pi * np.arange(1, round(DURATION / STEP / 2) + 1) / DURATION
    inside = sum(map(von_karman, lines.tolist())) * 2.0 * math.pi / DURATION
    assert mean_square == pytest.approx(inside, rel=0.08)  # three standard errors of 8000 s, correlated over 3 s
    assert inside == pytest.approx(SIGMA**2, rel=0.05)
    # It is periodic, so that its lines stand alone; of their mean over a band both sides know the same.
    power = np.mean([2.0 * np.abs(np.fft.rfft(x) / len(x)) ** 2 for x in pieces], axis=0)[1:]
    truth = np.array([von_karman(omega) for omega in lines]) * 2.0 * math.pi / DURATION
    f = lines / (2.0 * math.pi)
    for low, high in ((0.1, 0.5), (0.5, 2.0), (2.0, 3.0), (5.0, 20.0), (20.0, 49.0)):
        band = (f >= low) & (f < high)
        assert power[band].sum() == pytest.approx(truth[band].sum(), rel=0.05)


def test_turbulence_begins_and_ends_near_zero_and_follows_from_its_seed() -> None:
    one, same, other = (wb.turbulence(speed=V, duration=10.0, seed=seed) for seed in (3, 3, 4))
    assert one == same != other
    assert one(0.0) == one(10.0) == one(99.0)
    assert abs(one(0.0)) < 0.02
    assert wb.parse_signal("turbulence:speed=250,duration=10,seed=3") == one


def test_a_gradient_is_half_the_length_that_the_aircraft_flies_through() -> None:
    found = wb.parse_signal("gust:gradient=107,speed=250,value=10")
    assert found == wb.gust(value=10.0, duration=0.856)
    assert found(0.428) == pytest.approx(10.0)
    assert found(0.214) == pytest.approx(5.0)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("gust:value=3", r"gust: give either duration \[s\], or gradient \[m\] and speed \[m/s\]"),
        ("gust:duration=1,gradient=9,speed=200", "gust: give either duration"),
        ("gust:gradient=9", "gust: give either duration"),
        ("gust:gradient=-9,speed=200", "gust: gradient must be positive, not -9"),
        ("turbulence:speed=200", "turbulence: duration is missing; write turbulence:duration=…"),
        ("turbulence:speed=0,duration=1", "turbulence: speed must be positive, not 0"),
        ("turbulence:speed=200,duration=1,seed=-1", "turbulence: seed must be 0 or more, not -1"),
        (
            "turbulence:speed=200,duration=1e9",
            r"turbulence: 100000000000 points; duration/step must be from 2 to 2\^20",
        ),
    ],
)
def test_a_gust_that_cannot_be_is_one_line(text: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        wb.parse_signal(text)

"""Bandwidth, resonance, the amplitude for a bandwidth: closed forms, and how often the stated errors hold."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import workbench as wb
from tests.fakes import lag, oscillator
from workbench.errors import InputError
from workbench.response.nfr.features import Measure, amplitude_limit, features_of
from workbench.response.nfr.point import NfrPoint

DROP = 3.0


def measured(response: Callable[[float, float], complex], error: float, seed: int) -> Measure:
    """Points that are off by less than the error they state, a different one at each frequency."""
    draw = np.random.default_rng(seed)

    def measure(frequency: float, amplitude: float) -> NfrPoint:
        off = 1.0 + error * draw.uniform(-1.0, 1.0) * cmath.exp(1j * draw.uniform(0.0, math.pi))
        return NfrPoint(
            frequency=frequency, amplitude=amplitude, response=response(frequency, amplitude) * off, error=error
        )

    return measure


def slower(frequency: float, amplitude: float) -> complex:
    """A lag whose time constant rises with the amplitude."""
    return 1.0 / (1.0 + 1j * frequency * amplitude)


def corner(amplitude: float, lowest: float) -> float:
    """Where `slower` has fallen by 3 dB from its gain at the lowest frequency."""
    return math.sqrt(10.0 ** (DROP / 10.0) * (1.0 + (lowest * amplitude) ** 2) - 1.0) / amplitude


GRID = [0.05 * 1.3**k for k in range(20)]


@pytest.mark.parametrize("error", [1e-6, 1e-4, 1e-2])
def test_bandwidth_and_amplitude_lie_inside_their_stated_errors(error: float) -> None:
    """Of 100 draws each; an error that is never near the deviation would promise too little."""
    deviations = []
    for seed in range(100):
        measure = measured(slower, error, seed)
        rows = [[measure(f, a) for f in GRID] for a in (0.5, 1.0, 2.0)]
        found = features_of(rows[1], DROP, measure)
        assert found.bandwidth_hz is not None
        assert found.bandwidth_error_hz is not None
        deviations.append(abs(found.bandwidth_hz - corner(1.0, GRID[0])) / found.bandwidth_error_hz)
        limit = amplitude_limit(rows, 0.7, DROP, measure)
        assert limit.amplitude is not None
        assert limit.error is not None
        truth = math.sqrt((10.0 ** (DROP / 10.0) - 1.0) / (0.7**2 - 10.0 ** (DROP / 10.0) * GRID[0] ** 2))
        deviations.append(abs(limit.amplitude - truth) / limit.error)
    assert np.mean(np.array(deviations) <= 1.0) >= 0.95
    assert max(deviations) > 0.2


@pytest.mark.parametrize("error", [1e-6, 1e-4, 1e-2])
def test_the_frequency_of_90_degrees_lies_inside_its_stated_error(error: float) -> None:
    """1/(1 − f² + 0.8 a j f), which lags by 90° at f = 1 whatever a is; (1 + j f)⁻⁵, which goes on."""
    deviations = []
    for seed in range(100):
        measure = measured(lambda f, a: 1.0 / (1.0 - f**2 + 0.8j * a * f), error, seed)
        found = features_of([measure(f, 1.0) for f in GRID], DROP, measure)
        assert found.lag_hz is not None
        assert found.lag_error_hz is not None
        deviations.append(abs(found.lag_hz - 1.0) / found.lag_error_hz)
    assert np.mean(np.array(deviations) <= 1.0) >= 0.95
    assert max(deviations) > 0.2
    measure = measured(lambda f, _: 1.0 / (1.0 + 1j * f) ** 5, 1e-6, 0)
    assert features_of([measure(f, 1.0) for f in GRID], DROP, measure).lag_hz == pytest.approx(math.tan(math.pi / 10.0))


@pytest.mark.parametrize("drop", [0.5, 2.0, 6.0])
def test_a_bandwidth_is_where_the_gain_has_fallen_by_what_is_asked_for(drop: float) -> None:
    first = 0.01
    found = wb.nfr(lag(0.1), "u", "y", [first, 0.3, 0.6, 1.0, 2.0, 4.0, 8.0], [1.0], bandwidth=drop).features[0]
    w0 = 2.0 * math.pi * first * 0.1
    truth = math.sqrt(10.0 ** (drop / 10.0) * (1.0 + w0**2) - 1.0) / (0.2 * math.pi)
    assert found.bandwidth_hz is not None
    assert found.bandwidth_error_hz is not None
    assert abs(found.bandwidth_hz - truth) <= found.bandwidth_error_hz <= 0.01 * truth


def test_of_a_lag_and_an_oscillator_the_engine_finds_what_their_equations_say() -> None:
    first = 0.05
    slow = wb.nfr(lag(0.1), "u", "y", [first, 1.0, 2.0, 4.0], [1.0], bandwidth=3.0).features[0]
    w0 = 2.0 * math.pi * first * 0.1
    truth = math.sqrt(10.0**0.3 * (1.0 + w0**2) - 1.0) / (0.2 * math.pi)
    assert slow.bandwidth_hz is not None
    assert slow.bandwidth_error_hz is not None
    assert abs(slow.bandwidth_hz - truth) <= slow.bandwidth_error_hz <= 0.01 * truth
    assert slow.resonance_hz is None
    light = wb.nfr(oscillator(), "u", "y", [2.0, 10.0, 14.0, 17.0, 20.0], [1.0], bandwidth=3.0).features[0]
    zeta = 10.0 / (2.0 * math.sqrt(1e4))
    peak = 100.0 / (2.0 * math.pi) * math.sqrt(1.0 - 2.0 * zeta**2)
    gain_db = 20.0 * math.log10(1e-4 / (2.0 * zeta * math.sqrt(1.0 - zeta**2)))
    assert light.resonance_hz == pytest.approx(peak, rel=1e-3)
    assert light.lag_hz is not None
    assert light.lag_error_hz is not None
    assert abs(light.lag_hz - 100.0 / (2.0 * math.pi)) <= light.lag_error_hz + 1e-6
    assert light.resonance_gain_db is not None
    assert light.resonance_error_db is not None
    assert abs(light.resonance_gain_db - gain_db) <= light.resonance_error_db + 1e-5


def oscillation(zeta: float) -> Callable[[float, float], complex]:
    return lambda f, _: 1.0 / (1.0 - f**2 + 2j * zeta * f)


def test_a_fall_behind_a_resonance_is_told_to_be_no_bandwidth() -> None:
    """1/(1 − f² + 2ζ j f): 14 dB above its gain at rest with ζ = 0.1, none with ζ = 0.7."""
    for zeta, resonant in ((0.1, True), (0.7, False)):
        measure = measured(oscillation(zeta), 1e-6, 0)
        found = features_of([measure(f, 1.0) for f in GRID], DROP, measure)
        assert found.bandwidth_hz is not None
        assert ("that is not a bandwidth" in found.remark) == resonant


def test_a_jump_over_the_level_is_told_and_is_where_it_is() -> None:
    def jumps(frequency: float, amplitude: float) -> complex:
        return complex(1.0 if frequency < 1.7 / amplitude else 0.2)

    measure = measured(jumps, 1e-6, 0)
    found = features_of([measure(f, 1.0) for f in GRID], DROP, measure)
    assert found.bandwidth_hz == pytest.approx(1.7, rel=1e-5)
    assert "it jumps there, by 14 dB" in found.remark


def test_what_cannot_be_found_has_a_reason() -> None:
    measure = measured(slower, 1e-6, 0)
    rows = [[measure(f, a) for f in GRID[:5]] for a in (0.1, 0.2)]
    assert features_of(rows[0], DROP, measure).remark == f"the gain does not fall by 3 dB up to {GRID[4]:g} Hz"
    vague = [replace(p, error=0.5) for p in rows[0]]
    assert features_of(vague, DROP, measure).remark == f"the gain does not surely fall by 3 dB up to {GRID[4]:g} Hz"
    assert "above 0.1 Hz at all amplitudes" in amplitude_limit(rows, 0.1, DROP, measure).remark
    unknown = measured(slower, math.nan, 0)
    wide = [measure(f, 1.0) for f in GRID]
    assert "the error is not known" in features_of(wide, DROP, unknown).remark

    def dips(frequency: float, amplitude: float) -> complex:
        return 0.1 if 0.1 < frequency < 0.2 else slower(frequency, amplitude)

    measure = measured(dips, 1e-6, 0)
    rows = [[measure(f, a) for f in GRID] for a in (0.5, 1.0, 2.0)]
    limit = amplitude_limit(rows, 0.7, DROP, measure)
    assert limit.amplitude is None
    assert "the gain has fallen so far" in limit.remark


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"bandwidth": 3.0, "carry": True}, "a carried sweep"),
        ({"least_bandwidth": 7.0}, "least_bandwidth: 7 Hz is not inside the band, 0.1 to 5 Hz"),
        ({"bandwidth": -3.0}, "bandwidth"),
    ],
)
def test_what_cannot_be_asked(options: dict[str, float], words: str) -> None:
    with pytest.raises(InputError, match=words):
        wb.nfr(lag(0.1), "u", "y", [0.1, 5.0], [1.0], **options)  # type: ignore[arg-type]

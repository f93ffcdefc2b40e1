"""Onset of rate limiting: closed forms, a published aircraft, and the model's own motion on both sides of the onset."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import workbench as wb
from workbench.cli.app import run
from workbench.errors import InputError
from workbench.loops.onset.boundary import BOUNDARY, boundary_db
from workbench.loops.onset.request import onset
from workbench.model.described_model import DescribedModel

GC = (5.21 * np.poly([57.36, -4.26, -0.55]), np.polymul([1, 2 * 0.442 * 22.85, 22.85**2], np.poly([0.0, -1.16])))
GA = (-10.524 * np.poly([-1.562, -0.038, 0.0]), np.polymul([1, 2 * 0.212 * 0.088, 0.088**2], np.poly([-3.75, 1.44])))


def loop_of(gain: float, denominator: Sequence[float], limiter: object = None) -> DescribedModel:
    """A plant behind a limiter of 1/s, closed with negative feedback."""
    given = wb.BlockComponent(name="limiter", kind="rate_limiter", parameters={"rising": 1.0, "lag": 1e-3})
    plant = {"numerator": [1.0], "denominator": list(denominator)}
    return wb.connect(
        {
            "error": wb.SumComponent(name="error", signs=(1, -1)),
            "gain": gain,
            "limiter": limiter or given,
            "plant": wb.BlockComponent(name="plant", kind="transfer_function", parameters=plant),
        },
        [("error.y", "gain.u"), ("gain.y", "limiter.u"), ("limiter.y", "plant.u"), ("plant.y", "error.u2")],
        inputs={"r": "error.u1"},
        outputs={"y": "plant.y"},
    )


def test_an_integrator_reaches_the_limit_where_the_equation_says() -> None:
    """F = 2s/(s + 2): A·ω·|F| = 1 at ω² = (1/A² + √(1/A⁴ + 64/A²)) / 8."""
    with loop_of(2.0, [1.0, 0.0]) as loop:
        found = onset(loop, "r", limiter="limiter", amplitudes=[0.1, 0.5, 2.0], in_process=True)
    for p in found.points:
        b = 1.0 / p.amplitude**2
        omega = math.sqrt((b + math.sqrt(b * b + 64.0 * b)) / 8.0)
        assert p.frequency_hz == pytest.approx(omega / (2.0 * math.pi), rel=5e-3)  # the limiter lags by 1 ms
        assert p.gain_db == pytest.approx(20.0 * math.log10(2.0 / omega), abs=0.05)
        assert p.phase_deg == pytest.approx(-90.0, abs=0.5)
        assert p.above_db == pytest.approx((p.gain_db or 0.0) - 7.5, abs=0.1)
        assert p.verdict == ("above the boundary" if 2.0 / omega > 10.0**0.375 else "below the boundary")


def test_the_published_aircraft() -> None:
    """Its transfer functions, evaluated without the workbench, with a limiter that does not lag."""
    w = np.geomspace(0.5, 60.0, 400_000)
    s = 1j * w
    gc, ga = (np.polyval(n, s) / np.polyval(d, s) for n, d in (GC, GA))
    with wb.load("system:pitch_rate_limit") as loop:
        found = onset(loop, "stick", limiter="limiter", amplitudes=[0.1, 0.5, 1.1], in_process=True)
    assert [p.verdict for p in found.points] == ["not reached", "below the boundary", "above the boundary"]
    assert found.points[0].frequency_hz is None
    for p in found.points[1:]:
        rate = p.amplitude * 13.68 * np.abs(gc / (1.0 + gc * ga)) * w
        k = int(np.flatnonzero(rate >= 60.0)[0])
        assert p.frequency_hz == pytest.approx(w[k] / (2.0 * math.pi), rel=0.01)
        assert p.gain_db == pytest.approx(20.0 * math.log10(abs(gc[k] * ga[k])), abs=0.1)
        assert p.phase_deg == pytest.approx(math.degrees(np.angle(gc[k] * ga[k])), abs=1.0)


def test_the_model_itself_is_linear_below_the_onset_and_not_above() -> None:
    with loop_of(2.0, [1.0, 0.0]) as loop:
        (p,) = onset(loop, "r", limiter="limiter", amplitudes=[0.5], in_process=True).points
        assert p.frequency_hz is not None
        sides = [0.98 * p.frequency_hz, 1.05 * p.frequency_hz]
        measured = wb.nfr(loop, "r", "y", sides, [0.5], in_process=True)
    below, above = np.ravel(measured.thd).tolist()
    assert below < 1e-5
    assert above > 1e-3


def test_where_the_boundary_is_passed_the_response_jumps() -> None:
    with loop_of(4.0, [1.0, 0.5, 0.0]) as loop:
        (p,) = onset(loop, "r", limiter="limiter", amplitudes=[0.3], jump=True, in_process=True).points
    assert p.verdict == "above the boundary"
    assert p.jumps
    assert p.frequency_hz is not None
    assert p.frequency_hz < p.jumps[0].frequency_hz < 1.2 * p.frequency_hz
    assert p.jumps[0].rate_ratio > 1.0


def test_the_boundary_is_known_where_it_was_published() -> None:
    assert [boundary_db(phase) for phase, _ in BOUNDARY] == [gain for _, gain in BOUNDARY]
    assert boundary_db(-150.0) == pytest.approx(0.55)
    assert boundary_db(-181.0) is None
    assert boundary_db(-59.0) is None


def test_bandwidth_and_phase_delay_of_three_lags() -> None:
    """K = 2 closed around 1/(s (s + 1)²) … of the closed loop's own polynomial, found on a fine grid."""
    with loop_of(0.5, [1.0, 2.0, 1.0, 0.0]) as loop:
        told = onset(loop, "r", limiter="limiter", amplitudes=[0.1], attitude="y", in_process=True).attitude
    f = np.geomspace(0.01, 2.0, 200_000)
    s = 2j * math.pi * f
    value = 0.5 / (s**3 + 2.0 * s**2 + s + 0.5)
    phase = np.degrees(np.unwrap(np.angle(value)))
    half = float(f[np.flatnonzero(phase <= -180.0)[0]])
    assert told is not None
    assert told.phase_bandwidth_hz == pytest.approx(f[np.flatnonzero(phase <= -135.0)[0]], rel=2e-3)
    assert told.phase_delay_s == pytest.approx(-(np.interp(2 * half, f, phase) + 180.0) / (720.0 * half), rel=5e-3)


@pytest.mark.parametrize(
    ("gain", "denominator", "options", "message"),
    [
        (9.0, [1.0, 2.0, 1.0, 0.0], {}, "is not stable below the limit: a pole at"),
        (1.0, [1.0, 1.0], {"limiter": "limit"}, "there is no component 'limit'; did you mean limiter"),
        (1.0, [1.0, 1.0], {"limiter": "gain"}, "is not known, as it is not a block rate_limiter"),
        (1.0, [1.0, 1.0], {"band": (1.0, 0.5)}, "is not of the form LO:HI"),
        (1.0, [1.0, 1.0], {"amplitudes": [-1.0]}, "amplitudes"),
        (1.0, [1.0, 1.0], {"attitude": "z"}, "attitude"),
    ],
)
def test_what_cannot_be_judged_is_refused(
    gain: float, denominator: list[float], options: dict[str, Any], message: str
) -> None:
    with loop_of(gain, denominator) as loop, pytest.raises(InputError, match=message):
        onset(loop, "r", **{"limiter": "limiter", "amplitudes": [0.5], "in_process": True, **options})


def test_any_component_is_a_limiter_whose_rate_is_given(tmp_path: Path) -> None:
    out = tmp_path / "o.json"
    line = ["onset", "system:pitch_rate_limit", "--input", "stick", "--limiter", "limiter", "--rate", "30"]
    assert run([*line, "--amplitude", "0.55", "--in-process", "--json", str(out)]) == 0
    told = wb.OnsetResult.from_dict(json.loads(out.read_text(encoding="utf-8")))
    assert told.points[0].frequency_hz == pytest.approx(0.7534, abs=1e-3)  # half the limit, half the amplitude
    assert any("itself limits at -60 and 60" in note for note in told.notes)


# -- samples and delays -----------------------------------------------------------------------------

PERIOD = 0.1


def sampled_loop(prefilter: bool = False) -> DescribedModel:
    """A hold one sample late, 1/s behind it, negative feedback: F(z) = (z − 1)/(z(z − 1) + T) of the samples."""
    before: dict[str, object] = {"lag": "fmu:FirstOrderLag"} if prefilter else {}
    late = {"numerator": [1.0], "denominator": [1.0, 0.0], "period": PERIOD}
    return wb.connect(
        {
            **before,
            "error": wb.SumComponent(name="error", signs=(1, -1)),
            "hold": wb.BlockComponent(name="hold", kind="discrete_transfer_function", parameters=late),
            "plant": wb.BlockComponent(name="plant", kind="integrator"),
        },
        [("error.y", "hold.u"), ("hold.y", "plant.u"), ("plant.y", "error.u2"), *[("lag.y", "error.u1")] * prefilter],
        inputs={"r": "lag.u" if prefilter else "error.u1"},
        outputs={"y": "plant.y"},
    )


@pytest.mark.parametrize("prefilter", [False, True])
def test_a_sampled_limiter_begins_where_a_sample_differs_by_the_limit(prefilter: bool) -> None:
    """2 A |F| sin(πfT)/T = R, with the lag 1/(s + 1) before the samples in its own frequency response."""
    with sampled_loop(prefilter) as loop:
        (p,) = onset(loop, "r", limiter="hold", rate=1.0, amplitudes=[0.5], in_process=True).points

    def asked_for(f: float) -> float:
        z = np.exp(2j * math.pi * f * PERIOD)
        before = 1.0 / abs(2j * math.pi * f + 1.0) if prefilter else 1.0
        return float(before * abs((z - 1.0) / (z * (z - 1.0) + PERIOD)) * math.sin(math.pi * f * PERIOD) / PERIOD)

    if prefilter:  # a sine behind the lag never moves so fast
        assert p.frequency_hz is None
        assert p.least_amplitude == pytest.approx(0.5 / p.highest_ratio)
        assert asked_for(p.highest_hz) == pytest.approx(p.highest_ratio, rel=1e-3)
        assert not p.rises
        assert p.highest_ratio == pytest.approx(max(map(asked_for, np.geomspace(0.01, 4.995, 20_000))), rel=1e-3)
        return
    assert p.frequency_hz is not None
    assert asked_for(p.frequency_hz) == pytest.approx(1.0, rel=1e-6)
    z = np.exp(2j * math.pi * p.frequency_hz * PERIOD)
    through = PERIOD / (z * (z - 1.0))
    assert p.gain_db == pytest.approx(20.0 * math.log10(abs(through)), abs=1e-6)
    assert p.phase_deg == pytest.approx(math.degrees(np.angle(through)), abs=1e-5)


def test_a_limit_inside_a_sampled_control_law_is_met_by_the_model_at_the_onset() -> None:
    """Of the samples of the law's output, some change by the limit a little above the onset, and none below."""
    period, rate = 0.022, 30.0
    with wb.load("system:law_and_rudder") as loop:
        (p,) = onset(loop, "reference", limiter="law", rate=rate, amplitudes=[1.0], in_process=True).points
        assert p.frequency_hz is not None
        fastest = []
        for factor in (0.97, 1.02):
            forced = {"reference": wb.Sine(amplitude=1.0, frequency=factor * p.frequency_hz)}
            points = np.arange(0.5, 500.0) * period
            with loop.open_session() as session:
                record = session.advance(points[-1] + period, signals=forced, record=["command"], points=points)
            y = np.interp(points, record.time, record.values["command"])
            fastest.append(float(np.abs(np.diff(y[100:])).max() / period))
    assert 0.95 * rate < fastest[0] < 0.985 * rate
    assert fastest[1] == pytest.approx(rate, rel=1e-9)


def test_a_pilot_closes_the_loop_with_his_exact_delay() -> None:
    """The transfer functions of the system file, evaluated without the workbench; the limiter lags by 1 ms."""
    with wb.load("system:pilot_in_the_loop") as loop:
        points = onset(loop, "attitude", limiter="limiter", amplitudes=[2.0, 10.0], in_process=True).points
    f = np.geomspace(0.1, 2.0, 400_000)
    s = 2j * math.pi * f
    pilot = 1.5 * (0.3 * s + 1.0) / (0.05 * s + 1.0) * np.exp(-0.3 * s) / (0.001 * s + 1.0)
    through = pilot * (7.0 * s + 5.6) / (s**3 + 3.6 * s**2 + 9.0 * s)
    for p in points:
        k = int(np.flatnonzero(p.amplitude * np.abs(s * pilot / (1.0 + through)) >= 30.0)[0])
        assert p.frequency_hz == pytest.approx(f[k], rel=1e-5)
        assert p.gain_db == pytest.approx(20.0 * math.log10(abs(through[k])), abs=1e-3)
        assert p.phase_deg == pytest.approx(math.degrees(np.angle(through[k])), abs=1e-2)


def test_a_limiter_between_the_samples_is_refused() -> None:
    with wb.load("system:law_and_rudder") as loop:
        with pytest.raises(InputError, match=r"rudder\.del does not stand over the 0\.022 s"):
            onset(loop, "reference", limiter="rudder", rate=30.0, amplitudes=[1.0], in_process=True)
        with pytest.raises(InputError, match=r"is not below 22\.7273 Hz, half the sample rate"):
            onset(loop, "reference", limiter="law", rate=30.0, amplitudes=[1.0], band=(30.0, 50.0), in_process=True)

"""The measured response against closed forms."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import workbench as wb
from tests.fakes import DeadTimeSession, FakeModel, Rows, StaticSession, lag, linear, oscillator
from workbench.core.values.arrays import Floats
from workbench.response.nfr.request import nfr
from workbench.response.nfr.result import NfrResult
from workbench.signals.kinds import Sine


def errors(result: NfrResult, truth: Callable[[complex], complex]) -> tuple[float, float]:
    """Largest error of gain [relative] and phase [deg] over all frequencies."""
    exact = np.array([truth(2j * math.pi * f) for f in result.frequency_hz])
    quotient = result.response / exact
    return float(np.max(np.abs(np.abs(quotient) - 1.0))), float(np.max(np.abs(np.degrees(np.angle(quotient)))))


@pytest.mark.parametrize("tau", [1e-3, 1e-2, 0.1, 0.3, 1.0, 3.0, 10.0, 100.0])
@pytest.mark.parametrize("errcrit", [0.1, 0.01, 0.001])
def test_a_lag_of_any_speed_is_measured_to_1e_3_and_a_tenth_of_a_degree(tau: float, errcrit: float) -> None:
    result = nfr(lag(tau), "u", "y", amplitudes=1.0, band=(0.1, 10.0), errcrit=errcrit)
    gain, phase = errors(result, lambda s: 1.0 / (1.0 + tau * s))
    assert gain < 1e-3
    assert phase < 0.1
    assert not result.averaged.any()
    assert np.nanmax(result.periods) <= 20


@pytest.mark.parametrize("errcrit", [0.1, 0.001])
@pytest.mark.parametrize("damping", [1.0, 10.0, 60.0, 300.0])
def test_a_lightly_damped_oscillator_does_not_settle_by_accident(damping: float, errcrit: float) -> None:
    model = oscillator(damping=damping)
    result = nfr(model, "u", "y", amplitudes=1.0, frequencies=np.geomspace(1.0, 60.0, 60), errcrit=errcrit)
    gain, phase = errors(result, lambda s: 1.0 / (s * s + damping * s + 1e4))
    assert gain < 1e-3
    assert phase < 0.1
    assert not result.averaged.any()


def test_two_pairs_of_poles_and_a_feedthrough() -> None:
    a = [[0, 1, 0, 0], [-400, -2, 0, 0], [0, 0, 0, 1], [0, 0, -9000, -12]]
    model = linear(a, [0, 1, 0, 1], [400, 0, 2000, 0], 0.3)
    result = nfr(model, "u", "y", amplitudes=1.0, band=(0.5, 30.0))
    gain, phase = errors(result, lambda s: 0.3 + 400 / (s * s + 2 * s + 400) + 2000 / (s * s + 12 * s + 9000))
    assert gain < 2e-3
    assert phase < 0.1


def test_an_integrator_keeps_its_drift_out_of_the_response() -> None:
    model = linear([[0.0, 0.0], [0.0, -5.0]], [1.0, 5.0], [1.0, 1.0])
    result = nfr(model, "u", "y", amplitudes=1.0, band=(0.1, 10.0))
    gain, phase = errors(result, lambda s: 1 / s + 5 / (s + 5))
    assert gain < 1e-3
    assert phase < 0.1


def test_two_integrators_drift_and_are_measured_all_the_same() -> None:
    # y = −m·sin(ωt)/ω² + m·t/ω: the drift never ends, and is no divergence.
    class DoubleIntegrator(StaticSession):
        def rows(self, time: Floats, sine: Sine) -> Rows:
            _, _, u = super().rows(time, sine)
            omega = 2.0 * math.pi * sine.frequency
            return time, sine.amplitude * (time / omega) - u / omega**2, u

    result = nfr(FakeModel(lambda: DoubleIntegrator(lambda u: u)), "u", "y", [0.5, 2.0], 1.0)
    gain, phase = errors(result, lambda s: 1 / s**2)
    assert gain < 1e-3
    assert phase < 0.1


@pytest.mark.parametrize("amplitude", [0.5, 1.5, 3.0, 10.0])
def test_a_saturation_has_its_describing_function(amplitude: float) -> None:
    result = nfr(FakeModel(lambda: StaticSession(lambda u: np.clip(u, -1.0, 1.0))), "u", "y", [2.0], amplitude)
    r = min(1.0, 1.0 / amplitude)
    exact = 2.0 / math.pi * (math.asin(r) + r * math.sqrt(1.0 - r * r))
    assert result.gain[0, 0] == pytest.approx(exact, rel=1e-3)
    assert abs(result.phase_deg[0, 0]) < 0.1
    assert result.periods[0, 0] == 2


def test_an_even_nonlinearity_shows_as_offset() -> None:
    model = FakeModel(lambda: StaticSession(lambda u: u + 0.25 * u**2))
    result = nfr(model, "u", "y", [1.0], [1.0, 2.0])
    np.testing.assert_allclose(result.offset[:, 0], [0.125, 0.5], rtol=1e-9)
    np.testing.assert_allclose(result.gain, 1.0, rtol=1e-9)


def test_a_large_constant_does_not_drown_a_small_response() -> None:
    result = nfr(linear([[-6.0]], [6e-3], [1.0], offset=1e7), "u", "y", [1.0], 1.0)
    gain, phase = errors(result, lambda s: 6e-3 / (s + 6))
    assert gain < 1e-3
    assert phase < 0.1
    assert result.offset[0, 0] == pytest.approx(1e7)


@pytest.mark.parametrize("periods", [0.3, 2.5, 4.0, 7.25])
def test_dead_time_longer_than_two_periods_is_waited_for(periods: float) -> None:
    result = nfr(FakeModel(lambda: DeadTimeSession(periods / 2.0)), "u", "y", [2.0], 1.0)
    assert result.gain[0, 0] == pytest.approx(1.0, rel=1e-3)
    assert (result.phase_deg[0, 0] + 360.0 * periods) % 360.0 == pytest.approx(0.0, abs=0.1)
    assert periods < result.periods[0, 0] <= math.ceil(periods) + 3


def test_noise_of_the_solver_does_not_keep_a_point_from_settling() -> None:
    result = nfr(linear([[-6.0]], [6.0], [1.0], noise=1e-4), "u", "y", [0.5, 5.0], 1.0)
    gain, phase = errors(result, lambda s: 6 / (s + 6))
    assert not result.averaged.any()
    assert gain < 2e-3
    assert phase < 0.2


@pytest.mark.parametrize("errcrit", [0.1, 0.01])
def test_a_small_motion_beside_a_large_mean_is_measured_again_until_its_error_is_what_was_asked_for(
    errcrit: float,
) -> None:
    """A rudder at 2 deg moved by 0.01 deg; at so small an amplitude it is its linear model."""
    with wb.load("fmu:Rudder") as rudder:
        point = wb.trim(rudder, u0={"delC": 2.0})
        result = wb.nfr(rudder, "delC", "del", [16.0, 20.0], [0.1], at=point, errcrit=errcrit)
        linear_model = wb.lin(rudder, inputs=["delC"], outputs=["del"], at=point)
    assert result.status == (("settled", "settled"),)
    assert np.all(result.error <= errcrit / 10.0)
    truth = linear_model.result.response(np.array([16.0, 20.0]))[:, 0, 0]
    assert np.all(np.abs(result.response[0] / truth - 1.0) < 2e-3)


def test_the_sine_moves_about_the_start_value_of_its_input() -> None:
    """The supply pressure of a rudder, 206 bar: moved by a bar it does what the linear model there does."""
    with wb.load("fmu:Rudder") as rudder:
        result = wb.nfr(rudder, "pS", "p1", [1.0], [1e5])
        linear_model = wb.lin(rudder, inputs=["pS"], outputs=["p1"])
    truth = linear_model.result.response(np.array([1.0]))[0, 0, 0]
    assert abs(result.response[0, 0] / truth - 1.0) <= result.error[0, 0] < 0.01
    assert result.operating_point is not None
    assert result.operating_point.u["pS"] == 20.6e6


def test_branches_move_about_the_start_value_of_the_input_too() -> None:
    """About a constant force the hardening spring is stiffer than at rest."""
    with wb.load("fmu:Duffing", start_values={"u": 1.0}) as model:
        measured = wb.nfr(model, "u", "y", [0.2], [0.01], max_periods=60)
        followed = wb.branches(model, "u", "y", amplitudes=[0.01], band=(0.19, 0.21), frequencies=[0.2])
    (there,) = followed.at(0.2)
    assert measured.status == (("settled",),)
    assert there.gain == pytest.approx(measured.gain[0, 0], rel=1e-3)


@pytest.mark.parametrize(("delay", "frequency"), [(0.4, 4.3), (0.01, 1.3), (2.7, 0.62)])
def test_what_a_delay_gets_wrong_is_in_the_error_however_tight_the_tolerance(
    tmp_path: Path, delay: float, frequency: float
) -> None:
    file = tmp_path / "delayed.toml"
    file.write_text(
        f"""
        [components]
        P = {{ numerator = [1], denominator = [0.03, 1] }}
        d = {{ block = "delay", delay = {delay} }}
        [connections]
        "d.u" = "P.y"
        [inputs]
        u = "P.u"
        [outputs]
        y = "d.y"
        """
    )
    with wb.load(file, tolerance=1e-12) as model:
        found = wb.nfr(model, "u", "y", [frequency], [1.0], in_process=True)
    s = 2j * math.pi * frequency
    assert 1e-10 < abs(found.response[0, 0] / (np.exp(-s * delay) / (0.03 * s + 1.0)) - 1.0) <= found.error[0, 0]


@pytest.mark.parametrize(
    ("a", "b", "rise", "tau"),
    [(1.377, -0.601, 0.0766, 0.1835), (1.0, 1.0, 0.5, 0.18), (1.0, 1.0, -2.0, 0.3), (1.0, 1.0, 0.05, 1.0)],
)
def test_a_steady_drift_is_no_part_of_the_response_and_is_told(a: float, b: float, rise: float, tau: float) -> None:
    """A ramp puts −δ/π into the in-phase part of every period alike; it is none of what the input does."""

    class Drifting(StaticSession):
        def rows(self, time: Floats, sine: Sine) -> Rows:
            _, _, u = super().rows(time, sine)
            ramp = sine.amplitude**2 * (rise * sine.frequency * time + 0.3 * np.exp(-time / tau))
            return time, a * u + b * np.clip(u, -0.5, 0.5) + ramp, u

    found = nfr(FakeModel(lambda: Drifting(lambda u: u)), "u", "y", [2.0], 1.0)
    truth = a + b * 2.0 / math.pi * (math.asin(0.5) + 0.5 * math.sqrt(0.75))
    assert not abs(found.response[0, 0] / truth - 1.0) > found.error[0, 0]
    assert abs(found.response[0, 0] / truth - 1.0) <= 1e-3
    if tau < 1.0:
        assert f"drifts by {rise:.3g} in each period" in " ".join(found.warnings)


@pytest.mark.parametrize("height", [3.0, 50.0, 150.0, 300.0, 1000.0])
@pytest.mark.parametrize("lag_s", [0.0, 0.003, 0.31])
def test_edges_shorter_than_the_distance_of_rows_are_in_the_error(height: float, lag_s: float) -> None:
    """A saturation far beyond its limits is nearly a relay: its edges begin and end between two rows."""

    class Late(StaticSession):
        def rows(self, time: Floats, sine: Sine) -> Rows:
            _, _, u = super().rows(time, sine)
            turn = 2.0 * math.pi * sine.frequency * (time - lag_s)
            return time, np.clip(sine.amplitude * np.sin(turn), -1.0, 1.0), u

    found = nfr(FakeModel(lambda: Late(lambda u: u)), "u", "y", [0.5], height)
    part = 1.0 / height
    gain = 2.0 / math.pi * (math.asin(part) + part * math.sqrt(1.0 - part**2))
    truth = gain * np.exp(-1j * math.pi * lag_s)
    assert abs(found.response[0, 0] / truth - 1.0) <= found.error[0, 0] <= 0.02

"""The certificate of each point, against closed forms; the zero-input check."""

from __future__ import annotations

import csv
import io
import json
import math

import numpy as np
import pytest

import workbench as wb
from tests.fakes import EulerOscillator, FakeModel, Rows, SampledSession, StaticSession, lag, linear, oscillator
from workbench.core.values.arrays import Floats
from workbench.response.nfr.request import nfr
from workbench.response.periodic.fourier import distortion
from workbench.signals.kinds import Sine


def static(function: object) -> FakeModel:
    return FakeModel(lambda: StaticSession(function))  # type: ignore[arg-type]


def test_a_linear_model_does_not_distort() -> None:
    assert np.all(nfr(lag(0.3), "u", "y", [0.5, 3.0, 15.0], 1.0).thd < 1e-6)
    # Known as well as the response itself: what is left of the transient is no sine.
    resonant = nfr(oscillator(), "u", "y", [0.5, 3.0, 15.0], 1.0)
    defects = [certificate.defect for certificate in resonant.certificates[0] if certificate is not None]
    assert np.all(resonant.thd[0] < np.maximum(1e-6, np.array(defects, dtype=float)))
    with wb.load("fmu:FirstOrderLag", tolerance=1e-8) as fmu:
        assert np.all(nfr(fmu, "u", "y", [0.1, 1.0], 1.0).thd < 1e-6)


def test_a_cubic_has_a_third_harmonic_only() -> None:
    # sin³ = 3/4 sin − 1/4 sin 3
    certificate = nfr(static(lambda u: u**3), "u", "y", [1.0], 2.0).certificates[0][0]
    assert certificate is not None
    assert np.array(certificate.harmonics, dtype=float) == pytest.approx([0.0, 1 / 3, *[0.0] * 7], abs=1e-12)
    assert certificate.thd == pytest.approx(1 / 3)
    assert (certificate.errcrit, certificate.max_periods) == (0.1, 20)
    assert certificate.delta_phase_deg == pytest.approx(0.0, abs=1e-9)
    assert certificate.delta_gain == pytest.approx(0.0, abs=1e-12)


def test_the_third_harmonic_of_a_saturation() -> None:
    # Fourier series of a sine of amplitude A clipped at 1, with γ = asin(1/A).
    amplitude = 2.0
    g = math.asin(1.0 / amplitude)
    first = 2.0 * amplitude / math.pi * (g + 0.5 * math.sin(2.0 * g))
    third = 4.0 / math.pi * (
        amplitude * (math.sin(2.0 * g) / 4.0 - math.sin(4.0 * g) / 8.0) + math.cos(3.0 * g) / 3.0
    )  # fmt: skip
    result = nfr(static(lambda u: np.clip(u, -1.0, 1.0)), "u", "y", [1.0], amplitude)
    certificate = result.certificates[0][0]
    assert certificate is not None
    assert result.gain[0, 0] * amplitude == pytest.approx(first, rel=1e-3)
    assert certificate.harmonics[1] == pytest.approx(third / first, rel=5e-3)
    assert max(h or 0.0 for h in certificate.harmonics[::2]) < 1e-12  # an odd characteristic: no even ones


def test_the_transient_is_no_distortion() -> None:
    # A lag of 1 s at 10 Hz is far from settled when the point ends.
    certificate = nfr(lag(1.0), "u", "y", [10.0], 1.0).certificates[0][0]
    assert certificate is not None
    assert certificate.thd is not None
    assert certificate.thd < 1e-3
    assert certificate.drift is not None
    assert certificate.drift > 1e-2
    assert certificate.defect is not None
    assert certificate.defect < 1e-3


def test_averaged_points_tell_their_scatter() -> None:
    model = FakeModel(lambda: SampledSession([(1 / 208, 0.05), (1 / 131, 0.01)]))
    result = nfr(model, "u", "y", [15.407], 1.0, errcrit=0.08, max_periods=20)
    assert result.status == (("averaged",),)
    certificate = result.certificates[0][0]
    assert certificate is not None
    assert certificate.defect is not None
    assert 1e-3 < certificate.defect < 0.5


def test_co_simulation_is_checked_by_half_the_step() -> None:
    model = FakeModel(EulerOscillator, interface="cs")
    certificate = nfr(model, "u", "y", [10.0], 1.0).certificates[0][0]
    assert certificate is not None
    assert certificate.check == "step"
    assert certificate.check_gain is not None
    assert 0.0 < certificate.check_gain <= 0.005
    explicit = nfr(model, "u", "y", [10.0], 1.0, step=5e-4)
    assert explicit.certificates[0][0].check_phase_deg > 0.57  # type: ignore[union-attr, operator]


def test_model_exchange_is_checked_by_a_tighter_tolerance_where_asked_for() -> None:
    with wb.load("fmu:Rudder", tolerance=1e-3) as rudder:
        result = nfr(rudder, "delC", "del", [1.0], 1.0, verify=True)
    certificate = result.certificates[0][0]
    assert certificate is not None
    assert certificate.check == "tolerance"
    assert certificate.check_gain is not None
    assert 0.0 < certificate.check_gain < 0.05
    with pytest.raises(wb.InputError, match="verify"):
        nfr(lag(1.0), "u", "y", [1.0], 1.0, verify=True)


def test_orders_that_were_not_measured_are_unknown() -> None:
    assert distortion(np.array([0.0, 1.0, 0.0, 0.5, 0.0])) == (0.5, *[None] * 8)
    assert distortion(np.zeros(21)) == (None,) * 9


def test_dictionary_and_csv_carry_it() -> None:
    result = nfr(static(lambda u: u**3), "u", "y", [1.0, 2.0], [1.0, 2.0])
    found = json.loads(json.dumps(result.to_dict()))
    assert found["certificate"]["status"] == [["settled"] * 2] * 2
    assert found["certificate"]["thd"][1][0] == pytest.approx(1 / 3)
    assert np.shape(found["certificate"]["harmonics"]) == (2, 2, 9)
    stream = io.StringIO()
    result.to_csv(stream)
    row = next(csv.DictReader(stream.getvalue().splitlines()))
    assert float(row["h3"]) == pytest.approx(1 / 3)
    assert row["status"] == "settled"
    assert {"thd", "delta_phase_deg", "delta_gain", "defect", "drift", "check", "h2", "h10"} <= set(row)


def test_a_point_that_diverged_has_a_status_and_a_certificate() -> None:
    result = nfr(linear([[1.0]], [1.0], [1.0]), "u", "y", [1.0], 1.0, drift_check=False)
    assert result.status == (("failed",),)
    assert json.dumps(result.to_dict(), allow_nan=False)


def test_a_model_at_rest_gives_no_warning() -> None:
    result = nfr(lag(1.0), "u", "y", [1.0, 10.0], 1.0)
    assert result.warnings == ()
    assert result.zero_input is not None
    assert result.zero_input.movement == 0.0


class Wanderer(StaticSession):
    """y = u plus a ramp and a swing of its own."""

    def __init__(self, ramp: float, swing: float) -> None:
        super().__init__(lambda u: u)
        self.ramp, self.swing = ramp, swing

    def rows(self, time: Floats, sine: Sine) -> Rows:
        time, y, u = super().rows(time, sine)
        return time, y + self.ramp * time + self.swing * np.sin(2.0 * np.pi * 7.3 * time), u


def test_drift_and_swing_of_its_own_are_told_with_their_size() -> None:
    drifting = nfr(FakeModel(lambda: Wanderer(0.2, 0.0)), "u", "y", [1.0, 4.0], 1.0)
    assert drifting.zero_input is not None
    assert drifting.zero_input.drift == pytest.approx(0.2)
    assert len([w for w in drifting.warnings if "with zero input y moves by itself (drifts by 0.2 per s" in w]) == 1
    assert "20 % of the amplitude at 1 Hz" in drifting.warnings[-1]
    swinging = nfr(FakeModel(lambda: Wanderer(0.0, 0.3)), "u", "y", [1.0], 1.0)
    assert swinging.zero_input is not None
    assert swinging.zero_input.swing == pytest.approx(0.3, rel=0.2)
    assert any("swings by ±0.3" in w for w in swinging.warnings)
    small = nfr(FakeModel(lambda: Wanderer(0.0, 0.01)), "u", "y", [1.0], 1.0)
    assert small.warnings == ()


def test_an_unstable_model_is_told_before_its_points_are() -> None:
    result = nfr(linear([[40.0]], [1.0], [1.0], offset=1.0), "u", "y", [1.0], 1.0)
    assert result.failed
    assert nfr(linear([[40.0]], [1.0], [1.0]), "u", "y", [1.0], 1.0, drift_check=False).zero_input is None

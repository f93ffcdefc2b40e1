"""Co-simulation: the communication step is verified."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.fakes import EulerOscillator, FakeModel, Rows
from workbench.analysis.nfr import nfr
from workbench.errors import InputError
from workbench.session.base import Floats
from workbench.signals import Sine


def euler() -> FakeModel:
    return FakeModel(EulerOscillator, interface="cs")


def test_the_step_is_halved_until_it_no_longer_matters() -> None:
    result = nfr(euler(), "u", "y", [1.0, 10.0, 20.0, 60.0], 1.0)
    s = 2j * math.pi * result.frequency_hz
    quotient = result.response[0] * (s * s + 10.0 * s + 1e4)
    assert np.max(np.abs(np.abs(quotient) - 1.0)) < 0.005
    assert np.max(np.abs(np.degrees(np.angle(quotient)))) < 0.5
    assert np.all(result.step < 1e-3)
    assert not result.failed


def test_a_held_input_costs_no_phase() -> None:
    # A step of a twentieth of a period would turn the phase by 9 degrees, were it measured from the sine.
    class Follower(EulerOscillator):
        def rows(self, time: Floats, sine: Sine) -> Rows:
            t, _, u = super().rows(time, sine)
            return t, u, u

    result = nfr(FakeModel(lambda: Follower(0.0, 0.0), interface="cs"), "u", "y", [1.0], 1.0, step=0.05)
    assert result.response[0, 0] == pytest.approx(1.0)
    assert result.step[0, 0] == pytest.approx(0.05)


def test_an_answer_that_never_converges_fails_and_says_what_to_do() -> None:
    class StepDependent(EulerOscillator):
        def rows(self, time: Floats, sine: Sine) -> Rows:
            t, _, u = super().rows(time, sine)
            return t, u * (1.0 + 0.1 * math.log(time.size)), u

    result = nfr(FakeModel(lambda: StepDependent(0.0, 0.0), interface="cs"), "u", "y", [1.0], 1.0)
    assert np.isnan(result.gain[0, 0])
    assert "depends on the communication step" in result.failed[0].reason
    assert "--interface me" in result.failed[0].reason


def test_a_model_unstable_at_any_step_fails_with_that_reason() -> None:
    model = FakeModel(lambda: EulerOscillator(damping=-40.0), interface="cs")
    result = nfr(model, "u", "y", [5.0], 1.0)
    assert "grows without bound" in result.failed[0].reason


def test_an_explicit_step_is_kept_and_a_dependence_on_it_told() -> None:
    result = nfr(euler(), "u", "y", [10.0], 1.0, step=5e-4)
    assert result.step[0, 0] == pytest.approx(5e-4)
    assert len(result.warnings) == 1
    assert "half the communication step" in result.warnings[0]
    assert not nfr(euler(), "u", "y", [10.0], 1.0, step=1e-6).warnings


def test_an_explicit_step_at_which_it_diverges_fails() -> None:
    result = nfr(euler(), "u", "y", [1.0], 1.0, step=1e-2)
    assert result.failed[0].reason


def test_a_step_longer_than_a_quarter_period_is_refused() -> None:
    with pytest.raises(InputError, match=r"step: 0\.5 s is too long for 1 Hz"):
        nfr(euler(), "u", "y", [1.0], 1.0, step=0.5)


def test_a_carried_sweep_is_verified_too() -> None:
    result = nfr(euler(), "u", "y", [20.0, 10.0], 1.0, carry=True)
    s = 2j * math.pi * result.frequency_hz
    assert np.max(np.abs(np.abs(result.response[0] * (s * s + 10.0 * s + 1e4)) - 1.0)) < 0.005

"""What a transient that is still alive leaves in the stated error where no linear model helps."""

from __future__ import annotations

import cmath
import math
from typing import Any

import numpy as np
import pytest

import workbench as wb
from scripts.promises.nfr import Mode, Plant, measure
from workbench.response.nfr.settling import Settling, SettlingOutcome
from workbench.response.periodic.fourier import Period


@pytest.mark.parametrize(("frequency", "amplitude"), [(0.25, 0.3), (0.28, 0.3), (0.3, 0.3), (0.3, 0.5)])
def test_multipliers_that_change_as_the_transient_decays_are_in_the_error(frequency: float, amplitude: float) -> None:
    options: dict[str, Any] = {"max_periods": 60, "in_process": True}
    with wb.load("fmu:Duffing", "me", tolerance=1e-9) as model:  # solved for, not waited for
        (truth,) = wb.nfr(model, "u", "y", [frequency], amplitude, errcrit=1e-4, **options).response.ravel()
    with wb.load("fmu:Duffing", "cs", step=0.005) as model:
        result = wb.nfr(model, "u", "y", [frequency], amplitude, **options)
    assert result.status == (("settled",),)
    assert abs(result.response[0, 0] / truth - 1.0) <= result.error[0, 0] <= 0.01


@pytest.mark.parametrize("shift", [0.02, 0.05])
@pytest.mark.parametrize("turned", [1.0, 2.0, 2.8])
@pytest.mark.parametrize("left", [0.85, 0.95, 0.98])
def test_a_transient_that_moves_the_response_by_its_power_is_in_the_error(
    left: float, turned: float, shift: float
) -> None:
    # What a weakly nonlinear oscillator does: z = 1 + a + shift·|a|², a falls to `left` of itself and turns.
    settling, response, a = Settling(errcrit=0.1, most=100), None, 0.4 + 0.0j
    while response is None:
        z, third = 1.0 + a + shift * abs(a) ** 2, 0.3 * a * cmath.exp(0.4j)
        row = [0.2 * a.real, z.real, z.imag, third.real, third.imag, *np.zeros(6)]
        response = settling.add(Period(np.array(row), 1.0 + 0j, 1.0))
        a *= left * cmath.exp(1j * turned)
    assert response.outcome is SettlingOutcome.RESOLVED
    assert abs(response.value - 1.0) <= response.error <= 0.01


def test_a_slow_mode_that_quicker_ones_hide_leaves_no_small_error() -> None:
    # Light modes at 1 Hz, 2.35 Hz and 0.765 Hz: none of them can be told from the others in 200 periods.
    modes = (Mode(1.0, 1.97e-3, 1.11), Mode(2.349, 5.2e-4, 1.87), Mode(0.765, 1.48e-3, 0.62))
    more = (*modes, Mode(2.785, 1.2e-3, -0.89), Mode(0.72, 3.5e-4, 1.06))
    for of in (modes, more):
        found = measure(Plant(of, 0.99975), tolerance=1e-8, max_periods=200, blind=True, method="settle")
        assert found.status == "averaged"
        assert found.true <= found.stated or math.isnan(found.stated)

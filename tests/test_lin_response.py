"""Black boxes: pulses, Markov parameters, realisation."""

from __future__ import annotations

import numpy as np
import pytest

from tests.gemseo import gemseo_fmu, needs_gemseo
from workbench.analysis.lin import lin
from workbench.analysis.lin.realise import hold_inverse, realise
from workbench.errors import InputError
from workbench.model.load import load


def markov(A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray, count: int) -> np.ndarray:
    found, state = [D], B
    for _ in range(count - 1):
        found.append(C @ state)
        state = A @ state
    return np.array(found)


def test_a_realisation_is_what_it_was_made_of() -> None:
    random = np.random.default_rng(5)
    A = np.diag([0.95, 0.9, -0.5]) + np.array([[0, 0.1, 0], [-0.1, 0, 0], [0, 0, 0]])
    B, C, D = random.normal(size=(3, 2)), random.normal(size=(2, 3)) * [[1e6], [1e-6]], random.normal(size=(2, 2))
    found = realise(markov(A, B, C, D, 80), noise=1e-13)
    assert len(found.A) == 3
    assert sorted(np.linalg.eigvals(found.A), key=lambda z: (z.real, z.imag)) == pytest.approx(
        sorted(np.linalg.eigvals(A), key=lambda z: (z.real, z.imag)), abs=1e-8
    )
    assert found.error < 1e-9
    assert realise(markov(A, B, C, D, 80), noise=1e-13, order=1).error > 1e-3
    with pytest.raises(InputError, match="order must lie"):
        realise(markov(A, B, C, D, 9), noise=1e-13, order=9)


def test_a_hold_is_undone() -> None:
    A, B = np.array([[-1.0, 4.0], [-4.0, -1.0]]), np.array([[1.0], [2.0]])
    from scipy.linalg import expm

    block = np.zeros((3, 3))
    block[:2, :2], block[:2, 2:] = A, B
    full = expm(block * 0.1)
    back = hold_inverse(full[:2, :2], full[:2, 2:], 0.1)
    assert np.allclose(back[0], A)
    assert np.allclose(back[1], B)
    with pytest.raises(InputError, match=r"discrete pole -0\.5"):
        hold_inverse(np.array([[-0.5]]), np.array([[1.0]]), 0.1)


@needs_gemseo
@pytest.mark.parametrize("step", [0.001, 0.01, 0.05])
def test_explicit_euler_is_found_in_a_co_simulation(step: float) -> None:
    with load(gemseo_fmu("MassSpringSubSystem1"), "cs", step=step) as model:
        result = lin(model, inputs=["x2"]).result
    assert (result.method, result.dt) == ("response", step)
    expected = [1.0 - 1j * 2**0.5 * step, 1.0 + 1j * 2**0.5 * step]
    assert sorted(result.poles, key=lambda p: p.imag) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("interface", ["me", "cs"])
def test_a_lag_in_closed_form(interface: str) -> None:
    with load("fmu:FirstOrderLag", interface, tolerance=1e-9) as model:
        result = lin(model, method="response", period=0.1).result
        continuous = lin(model, method="response", period=0.1, continuous=True).result
    assert result.A.shape == (1, 1)
    assert result.A[0, 0] == pytest.approx(np.exp(-0.1), abs=1e-6)
    assert (result.C @ result.B)[0, 0] == pytest.approx(1.0 - np.exp(-0.1), abs=1e-6)
    assert continuous.dt == 0.0
    assert continuous.A[0, 0] == pytest.approx(-1.0, abs=1e-5)


def test_the_rudder_as_a_black_box_shows_its_poles() -> None:
    with load("fmu:Rudder", "me") as model:
        exact = lin(model, inputs=["delC"]).result
        found = lin(model, inputs=["delC"], method="response", period=0.002).result
    slow = exact.poles[np.abs(exact.poles) < 500.0]
    for pole in slow[np.abs(slow) > 10.0]:
        assert np.min(np.abs(found.continuous_poles - pole)) < 1e-3 * abs(pole)
    at = np.array([1.0, 10.0, 40.0])
    ratio = found.fundamental(at)[:, 0, 0] / exact.response(at)[:, 0, 0]
    assert np.max(np.abs(20.0 * np.log10(np.abs(ratio)))) < 0.3

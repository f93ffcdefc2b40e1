"""The period map and what it stands on: states set in a run, exponentials of many matrices, its derivative."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import cast

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import workbench as wb
from workbench.analysis.periodic.period_map import PeriodMap
from workbench.core.matrices import exponentials
from workbench.errors import InputError
from workbench.session.compiled import CompiledMeSession
from workbench.session.target import NotReachedError
from workbench.signals import Sine

Floats = NDArray[np.float64]
FORCED = {"u": Sine(amplitude=0.3, frequency=0.2)}


# -- states set in a run ----------------------------------------------------------------------


@pytest.mark.parametrize("by_replay", [False, True])
def test_after_a_jump_a_run_and_a_snapshot_go_on_from_there(by_replay: bool) -> None:
    points = np.linspace(2.1, 4.0, 20)
    with wb.load("fmu:Duffing", tolerance=1e-9) as model, model.open_session(signals=FORCED) as opened:
        session = cast("CompiledMeSession", opened)
        if by_replay:
            session.setup = replace(session.setup, state_works=lambda: False)
        session.advance(2.0, signals=FORCED)
        session.jump(np.array([0.7, -0.4]))
        np.testing.assert_array_equal(session.stand(), [0.7, -0.4])
        there = session.snapshot()
        first = session.advance(4.0, signals=FORCED, record=["y"], points=points)
        session.restore(there)
        assert session.time == pytest.approx(2.0)
        again = session.advance(4.0, signals=FORCED, record=["y"], points=points)

    def slope(t: float, z: Floats) -> list[float]:
        return [z[1], 0.3 * math.sin(0.4 * math.pi * t) - 0.05 * z[1] - z[0] - z[0] ** 3]

    truth = solve_ivp(slope, (2.0, 4.0), [0.7, -0.4], method="DOP853", rtol=1e-11, atol=1e-12, t_eval=points)
    np.testing.assert_array_equal(first.right_limits(points).values["y"], again.right_limits(points).values["y"])
    assert first.right_limits(points).values["y"] == pytest.approx(truth.y[0], abs=1e-7)


def test_a_state_that_does_not_take_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    with wb.load("fmu:Duffing") as model, model.open_session(signals=FORCED) as opened:
        session = cast("CompiledMeSession", opened)
        monkeypatch.setattr(session, "stand", lambda: np.array([0.7, 0.0]))
        with pytest.raises(NotReachedError, match=r"state 2 of 2 cannot be set: -0\.4 was asked for, it is 0"):
            session.jump(np.array([0.7, -0.4]))


def test_co_simulation_refuses_to_set_states() -> None:
    with (
        wb.load("fmu:Duffing", "cs") as model,
        model.open_session(signals=FORCED) as session,
        pytest.raises(InputError, match="co-simulation"),
    ):
        session.jump(np.array([0.7, -0.4]))


# -- exponentials -----------------------------------------------------------------------------


@pytest.mark.parametrize("size", [1e-3, 1.0, 30.0])
def test_exponentials_are_those_of_scipy(size: float) -> None:
    random = np.random.default_rng(3)
    stack = size * random.standard_normal((40, 6, 6)) / 6.0
    stack[0] = np.diag(np.full(5, size), 1)  # nilpotent
    stack[1] = np.diag([-1e4 * size, -1.0, 0.0, 0.1, 0.2, 0.3])  # stiff
    rounding = 4e-15 * max(1.0, float(np.abs(stack).sum(axis=1).max()))  # all are scaled for the largest of them
    for found, matrix in zip(exponentials(stack), stack, strict=True):
        truth = expm(matrix)
        assert np.abs(found - truth).max() <= rounding * np.abs(truth).max()


# -- the derivative of a period ---------------------------------------------------------------


def test_the_derivative_of_a_period_is_that_of_the_variational_equation() -> None:
    f, amplitude = 0.2, 0.3
    start = np.array([0.5, 0.1])
    with wb.load("fmu:Duffing", tolerance=1e-10) as model, model.open_session(signals=FORCED) as opened:
        lap = PeriodMap(cast("CompiledMeSession", opened), "y", "u").lap(f, amplitude, start, intervals=100)

    def slope(t: float, z: Floats) -> Floats:
        p = z[2:].reshape(2, 2)
        a = np.array([[0.0, 1.0], [-1.0 - 3.0 * z[0] ** 2, -0.05]])
        dv = amplitude * math.sin(2.0 * math.pi * f * t) - 0.05 * z[1] - z[0] - z[0] ** 3
        return np.array([z[1], dv, *(a @ p).ravel()])

    end = solve_ivp(slope, (0.0, 1.0 / f), [*start, 1.0, 0.0, 0.0, 1.0], method="DOP853", rtol=1e-12, atol=1e-13).y[
        :, -1
    ]
    assert lap.tangent is not None
    assert lap.x1 == pytest.approx(end[:2], abs=1e-8)
    assert lap.tangent.Phi == pytest.approx(end[2:].reshape(2, 2), abs=1e-5)
    assert abs(np.prod(lap.tangent.multipliers)) == pytest.approx(math.exp(-0.05 / f), rel=1e-6)  # Liouville

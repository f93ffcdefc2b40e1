"""The period map and what it stands on: states set in a run, exponentials of many matrices, its derivative."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import cast

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import block_diag, expm

import workbench as wb
from workbench.core.values.arrays import Floats
from workbench.core.values.matrices import exponentials
from workbench.errors import InputError, SimulationError
from workbench.response.periodic.fourier import Period
from workbench.response.periodic.monodromy import VariationalEquation
from workbench.response.periodic.period_map import Lap, PeriodMap, correction
from workbench.response.periodic.place import Family, arrive, stride_from
from workbench.response.periodic.special import _turning
from workbench.session.compiled import CompiledMeSession
from workbench.session.start_values import NotReachedError
from workbench.signals.kinds import Sine

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


# -- places on a branch -----------------------------------------------------------------------


class Curve(Family):
    """The map x → x + p − h(x), whose fixed points are the curve p = h(x).

    Args:
        h: the curve.
        slope: what the derivative says of the slope of h.
    """

    coarse, fine = 1, 1

    def __init__(self, h: Callable[[float], float], slope: Callable[[float], float]) -> None:
        super().__init__()
        self.h, self.slope = h, slope

    def lap(self, x: Floats, p: float, *, exact: bool = False) -> tuple[Lap, Floats]:
        one = np.ones(1)
        at = VariationalEquation(np.array([[1.0 - self.slope(float(x[0]))]]), np.zeros((3, 1)), 0.0 * one)
        x1 = x + p - self.h(float(x[0]))
        return Lap(x, x1, Period(np.zeros(3), 1.0 + 0.0j, 1.0), 0, one, tangent=at), one


@pytest.mark.parametrize("fold", [0.28, 0.3, 0.31])
def test_the_parameter_turns_back_at_the_top_of_a_parabola(fold: float) -> None:
    curve = Curve(lambda x: 0.5 - (x - fold) ** 2, lambda x: -2.0 * (x - fold))
    a = arrive(curve, np.array([0.25]), 0.5 - (0.25 - fold) ** 2)
    a = a if a.direction[0] > 0.0 else replace(a, direction=-a.direction)
    b = stride_from(curve, a, 0.1)
    assert a.x[0] < fold < b.x[0]
    found = _turning(curve, a, b)
    assert found is not None
    assert found.p == pytest.approx(0.5, abs=1e-8)
    assert found.x[0] == pytest.approx(fold, abs=1e-4)


def test_a_place_that_is_to_be_exact_has_twelve_steps_and_another_one_six() -> None:
    """On the line p = x, with a slope that is 10/7 of the true one: each step leaves 0.3 of the error."""
    line = Curve(lambda x: x, lambda _: 1.0 / 0.7)
    here = replace(arrive(line, np.array([0.5]), 0.5), direction=np.array([0.0, 1.0]))
    found = stride_from(line, here, 0.1, exact=True)
    assert found.p == pytest.approx(0.6, abs=1e-12)
    assert found.x[0] == pytest.approx(0.6, abs=1e-4)
    assert 6 < found.periods <= 12
    with pytest.raises(SimulationError, match="did not converge in 6 periods"):
        stride_from(line, here, 0.1)


@pytest.mark.parametrize("stands", [False, True])
def test_the_correction_closes_a_period_but_for_what_stands(stands: bool) -> None:
    """An affine map x1 = Φ·x0 + r of states of very different sizes, whose last state may integrate."""
    rng = np.random.default_rng(3)
    n, sizes = 6, 10.0 ** rng.uniform(-4.0, 4.0, 6)
    Phi = 0.3 * rng.normal(size=(n, n)) * sizes[:, None] / sizes
    Phi[:, -1], drift = (np.eye(n)[-1], 0.5 * sizes[-1]) if stands else (Phi[:, -1], 0.0)
    Phi[-1] = np.eye(n)[-1] if stands else Phi[-1]
    x0, r = sizes * rng.normal(size=n), sizes * rng.normal(size=n)
    r[-1] = drift if stands else r[-1]
    lap = Lap(x0, Phi @ x0 + r, Period(np.zeros(9), 1.0 + 0.0j, 1.0), 0, sizes)
    e, left = correction(lap, VariationalEquation(Phi, np.zeros((3, n)), np.zeros(n)))
    after = (Phi @ (x0 + e) + r - x0 - e) / sizes
    np.testing.assert_allclose(after, np.append(np.zeros(n - 1), drift / sizes[-1]), rtol=1e-12, atol=1e-9)
    assert left == pytest.approx(0.5 / np.linalg.norm(lap.defect / sizes) if stands else 0.0, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("slowest", [0.9, 1.0])
def test_the_correction_is_the_same_by_factors(slowest: float) -> None:
    """Φ of two modes out of five, the slower of which may stand."""
    rng = np.random.default_rng(4)
    V, sizes = rng.normal(size=(5, 5)), 10.0 ** rng.uniform(-4.0, 4.0, 5)
    U, W = (sizes[:, None] * V)[:, :2] * [slowest, -0.4], (np.linalg.inv(V) / sizes)[:2]
    lap = Lap(np.zeros(5), sizes * rng.normal(size=5), Period(np.zeros(9), 1.0 + 0.0j, 1.0), 0, sizes)
    whole = VariationalEquation(U @ W, np.zeros((3, 5)), np.zeros(5))
    (e, left), (wanted, over) = correction(lap, replace(whole, factors=(U, W))), correction(lap, whole)
    np.testing.assert_allclose(e / sizes, wanted / sizes, rtol=1e-10, atol=1e-10)
    assert left == pytest.approx(over, abs=1e-10)
    assert (over > 0.01) == (slowest == 1.0)


def test_a_pair_of_multipliers_is_kept_or_left_as_one() -> None:
    pair = 0.1 * np.array([[1.0, 1.0], [-1.0, 1.0]])  # 0.1 ± 0.1j
    for alone, count in ((5, 7), (4, 6), (6, 6)):  # real ones that are larger
        Phi = block_diag(np.diag(np.linspace(0.9, 0.5, alone)), pair, 0.01)
        kept = VariationalEquation(Phi, np.zeros((3, len(Phi))), np.zeros(len(Phi))).kept
        assert len(kept) == count
        assert sum(abs(z - 0.1 - 0.1j) < 1e-12 for z in kept) == sum(abs(z - 0.1 + 0.1j) < 1e-12 for z in kept)

"""Linear models: responses, feedback, series, hold: closed forms, exact arithmetic and other methods."""

from __future__ import annotations

import json
import math
import os
import pickle
import subprocess
import sys
from fractions import Fraction
from typing import Any

import control
import numpy as np
import pytest

from workbench.core.values import matrices
from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.linear import Linear, LinearPart
from workbench.core.values.matrices import held, resolvent, unheld
from workbench.core.values.operating_point import OperatingPoint
from workbench.core.values.poles import growth_rates, sides
from workbench.errors import InputError

FREQUENCY = np.geomspace(1e-3, 1e2, 25)


def random_linear(seed: int, *, dt: float = 0.0) -> Linear:
    rng = np.random.default_rng(seed)
    n, m, q = (int(rng.integers(low, high)) for low, high in ((1, 9), (1, 4), (1, 4)))
    A = rng.normal(size=(n, n))
    A = 0.9 * A / np.abs(np.linalg.eigvals(A)).max() if dt > 0.0 else A
    return Linear(A, rng.normal(size=(n, m)), rng.normal(size=(q, n)), rng.normal(size=(q, m)), dt=dt)


def lag(gain: float = 3.0, tau: float = 0.5) -> LinearPart:
    """gain/(1 + tau·s)."""
    return LinearPart(np.array([[-1.0 / tau]]), np.array([gain / tau]), np.array([1.0]))


# -- responses -----------------------------------------------------------------------------------


def test_response_of_a_lag() -> None:
    assert lag().response(FREQUENCY) == pytest.approx(3.0 / (1.0 + 1j * math.pi * FREQUENCY), rel=1e-14)
    assert lag().at(0.0) == pytest.approx(3.0)
    assert lag().at(math.inf) == 0.0


@pytest.mark.parametrize("dt", [0.0, 0.01])
@pytest.mark.parametrize("seed", range(8))
def test_response_of_several_inputs_and_outputs_is_python_controls(seed: int, dt: float) -> None:
    system = random_linear(seed, dt=dt)
    f = FREQUENCY[system.highest_hz > FREQUENCY]
    expected = np.moveaxis(system.to_state_space().frequency_response(2.0 * np.pi * f).complex, -1, 0)
    assert system.response(f) == pytest.approx(expected.reshape(len(f), *system.D.shape), rel=1e-9)


def test_response_of_one_pair_is_a_part_of_the_whole() -> None:
    system = random_linear(5)
    whole = system.response(FREQUENCY)
    for i, j in np.ndindex(system.D.shape):
        assert system.part(j, i).response(FREQUENCY) == pytest.approx(whole[:, i, j], rel=1e-12)
        assert system.part(j, i, sign=-1.0).response(FREQUENCY) == pytest.approx(-whole[:, i, j], rel=1e-12)


def test_response_without_states_is_the_direct_part() -> None:
    D = np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]])
    static = Linear(np.zeros((0, 0)), np.zeros((0, 2)), np.zeros((3, 0)), D)
    assert np.array_equal(static.response([0.0, 1.0, math.inf]), [D, D, D])
    assert len(static.poles) == 0
    assert static.is_stable


def test_response_on_a_pole_is_not_a_number_and_beside_it_is() -> None:
    oscillator = Linear(np.array([[0.0, 1.0], [-1.0, 0.0]]), np.array([[0.0], [1.0]]), np.eye(2), np.zeros((2, 1)))
    integrator = Linear(np.zeros((1, 1)), np.ones((1, 1)), np.ones((1, 1)), np.zeros((1, 1)))
    assert np.isnan(integrator.response([0.0, 1.0])[:, 0, 0]).tolist() == [True, False]
    assert integrator.response(1.0)[0, 0, 0] == pytest.approx(1.0 / (2j * math.pi))
    assert oscillator.response(0.0)[0, :, 0] == pytest.approx([1.0, 0.0])


def test_response_at_the_nyquist_frequency_is_real() -> None:
    """1/(z − a) at z = −1 is −1/(1 + a), exactly: rounding would look like a crossing of the real axis."""
    part = LinearPart(np.array([[0.5]]), np.ones(1), np.ones(1), dt=0.02)
    assert part.highest_hz == 25.0
    assert part.at(25.0) == -1.0 / 1.5


def exact(A: Floats, B: Floats, p: complex) -> Complex:
    """Return (pI − A)⁻¹ B by elimination with fractions, shape (n, 1)."""
    n = len(A)
    real = np.block([[p.real * np.eye(n) - A, -p.imag * np.eye(n)], [p.imag * np.eye(n), p.real * np.eye(n) - A]])
    rows = [[Fraction(v) for v in row] for row in np.column_stack([real, np.append(B[:, 0], np.zeros(n))]).tolist()]
    for i in range(2 * n):
        best = max(range(i, 2 * n), key=lambda r: abs(rows[r][i]))
        rows[i], rows[best] = rows[best], rows[i]
        rows[i] = [v / rows[i][i] for v in rows[i]]
        for r in range(2 * n):
            if r != i and rows[r][i]:
                rows[r] = [a - rows[r][i] * b for a, b in zip(rows[r], rows[i], strict=True)]
    x = np.array([float(row[-1]) for row in rows])
    return np.asarray((x[:n] + 1j * x[n:])[:, None])


@pytest.mark.parametrize("at_once", [0.0, math.inf])
def test_few_and_many_points_keep_their_digits_where_entries_differ_by_ten_decades(
    at_once: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(matrices, "_DIRECT", at_once)
    rng = np.random.default_rng(1)
    for _ in range(5):
        A, B = rng.normal(size=(4, 4)) * 10.0 ** rng.uniform(-5.0, 5.0, (4, 1)), rng.normal(size=(4, 2))
        points = np.asarray(1j * 10.0 ** rng.uniform(-3.0, 5.0, 3), dtype=np.complex128)
        found = resolvent(A, B, points)
        expected = np.array([np.hstack([exact(A, b[:, None], complex(p)) for b in B.T]) for p in points])
        assert np.abs(found / expected - 1.0).max() < 1e-11


def test_zeros_of_a_chain_of_lags_with_known_numerator() -> None:
    """(s + 1)(s² + 4)/((s + 2)(s + 3)(s + 5)(s + 7)), its states in units twelve decades apart."""
    system = control.ss(control.tf(np.poly([-1.0, 2j, -2j]).real, np.poly([-2.0, -3.0, -5.0, -7.0])))
    T = np.diag([1e-6, 1.0, 1e3, 1e6])
    part = LinearPart(T @ system.A @ np.linalg.inv(T), T @ system.B, system.C @ np.linalg.inv(T), system.D)
    assert sorted(part.invariant_zeros, key=lambda z: z.imag) == pytest.approx([-2j, -1.0, 2j], abs=1e-9)


@pytest.mark.parametrize("seed", range(6))
def test_zeros_block_a_motion(seed: int) -> None:
    """At a zero of a square system [A − zI, B; C, D] is singular; one with more outputs than inputs has none."""
    rng = np.random.default_rng(seed)
    A, B, C, D = (rng.normal(size=shape) for shape in ((5, 5), (5, 2), (2, 5), (2, 2)))
    found = Linear(A, B, C, D).invariant_zeros
    assert len(found) == 5
    for z in found:
        pencil = np.block([[A - z * np.eye(5), B], [C, D]])
        assert np.linalg.svd(pencil, compute_uv=False)[-1] < 1e-10
    assert len(Linear(A, B, rng.normal(size=(3, 5)), np.zeros((3, 2))).invariant_zeros) == 0


# -- what does not fit -----------------------------------------------------------------------------


def test_vectors_become_matrices() -> None:
    part = LinearPart(np.eye(2), np.ones(2), np.ones(2), 3.0)
    assert (part.B.shape, part.C.shape, part.D.shape) == ((2, 1), (1, 2), (1, 1))
    assert (part.b.tolist(), part.c.tolist(), part.d) == ([1.0, 1.0], [1.0, 1.0], 3.0)


def test_a_part_goes_to_another_process_and_back() -> None:
    part = pickle.loads(pickle.dumps(lag()))  # noqa: S301  made here
    assert part.response(FREQUENCY) == pytest.approx(lag().response(FREQUENCY))


def test_what_does_not_fit_is_refused() -> None:
    one, two = np.ones((1, 1)), np.ones((2, 2))
    with pytest.raises(InputError, match="matrix B must be 1 × 2, not 2 × 1"):
        Linear(one, np.ones((2, 1)), np.ones((2, 1)), two)
    with pytest.raises(InputError, match=r"state_names: 2 given \(a, b\), but the matrices have 1 state$"):
        Linear(one, one, one, one, state_names=("a", "b"))
    with pytest.raises(InputError, match="one input and one output"):
        LinearPart(two, two, two, two)
    with pytest.raises(InputError, match="the linear part is sampled"):
        LinearPart.from_lin(Linear(one, one, one, one, dt=0.1))


# -- feedback and series ---------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(8))
def test_feedback_satisfies_the_equations_of_the_loop(seed: int) -> None:
    """Closed by u = g·y + r the response H' solves H' = H + H[:, u]·g·H'[y, :]."""
    system, gain = random_linear(seed), 0.7
    q, m = system.D.shape
    closed = system.with_feedback(gain, input=m - 1, output=q - 1).response(FREQUENCY)
    before = system.response(FREQUENCY)
    right = before + gain * before[:, :, m - 1 :] @ closed[:, q - 1 :, :]
    assert closed == pytest.approx(right, rel=1e-8, abs=1e-10)


@pytest.mark.parametrize("direct", [0.0, 2.0, 1e9])
def test_sensitivities_of_a_lag(direct: float) -> None:
    loop = LinearPart(lag().A, lag().B, lag().C, direct)
    value = loop.response(FREQUENCY)
    assert loop.sensitivity().response(FREQUENCY) == pytest.approx(1.0 / (1.0 + value), rel=1e-12)
    assert loop.complementary().response(FREQUENCY) == pytest.approx(value / (1.0 + value), rel=1e-12)
    assert loop.poles_at(-1.0) == pytest.approx([-2.0 - 6.0 / (1.0 + direct)])
    assert loop.growth(-1.0) == pytest.approx(-2.0 - 6.0 / (1.0 + direct))


def test_a_loop_without_solution_is_refused() -> None:
    with pytest.raises(InputError, match="the closed loop has no solution"):
        LinearPart(lag().A, lag().B, lag().C, -1.0).sensitivity()
    with pytest.raises(InputError, match="the direct path through the plant makes it infinite"):
        LinearPart(lag().A, lag().B, lag().C, 0.5).with_feedback(2.0)


def test_series_multiplies_responses() -> None:
    first, second = (random_linear(seed).part() for seed in (1, 2))
    product = first.response(FREQUENCY) * second.response(FREQUENCY)
    assert second.behind(first).response(FREQUENCY) == pytest.approx(product, rel=1e-10)
    assert first.scaled(-2.0).response(FREQUENCY) == pytest.approx(-2.0 * first.response(FREQUENCY))


@pytest.mark.parametrize("seed", range(4))
def test_balanced_states_change_no_response(seed: int) -> None:
    system = random_linear(seed)
    T = np.diag(10.0 ** np.random.default_rng(seed).uniform(-6.0, 6.0, len(system.A)))
    other = Linear(T @ system.A @ np.linalg.inv(T), T @ system.B, system.C @ np.linalg.inv(T), system.D)
    even, factor = other.of_unit_size()
    assert other.balanced().response(FREQUENCY) == pytest.approx(system.response(FREQUENCY), rel=1e-9)
    assert factor * even.response(FREQUENCY) == pytest.approx(system.response(FREQUENCY), rel=1e-9)
    assert np.linalg.norm(even.B) == pytest.approx(1.0)


def test_a_balanced_model_claims_no_units_of_its_states() -> None:
    part = LinearPart(np.diag([-1.0, -2.0]), np.array([1e6, 1.0]), np.array([1.0, 1e-6]), state_names=("a", "b"),
                      input_names=("u",), output_names=("y",), units={"a": "m", "u": "N"},
                      operating_point=OperatingPoint(x={"a": 1.0, "b": 0.0}, u={"u": 0.0}))  # fmt: skip
    even = part.balanced()
    assert (even.units, even.operating_point) == ({"u": "N"}, None)


# -- from continuous to sampled and back -----------------------------------------------------------


def test_a_held_lag() -> None:
    """x(k + 1) = e^(−dt/tau) x + gain (1 − e^(−dt/tau)) u."""
    decay = math.exp(-0.2)
    sampled = lag().sampled(0.1)
    assert sampled.dt == 0.1
    assert (sampled.A[0, 0], sampled.B[0, 0]) == pytest.approx((decay, 3.0 * (1.0 - decay)))


@pytest.mark.parametrize("seed", range(6))
def test_the_hold_is_python_controls_and_is_undone(seed: int) -> None:
    system = random_linear(seed)
    A, B = held(system.A, system.B, 0.1)
    expected = control.c2d(control.ss(system.A, system.B, system.C, system.D), 0.1)
    assert pytest.approx(expected.A) == A
    assert pytest.approx(expected.B) == B
    back = unheld(A, B, 0.1)
    assert back[0] == pytest.approx(system.A, abs=1e-9)
    assert back[1] == pytest.approx(system.B, abs=1e-9)


@pytest.mark.parametrize(("pole", "why"), [(0.0, "a pole at z = 0"), (-0.5, "negative real axis")])
def test_no_continuous_model_has_such_samples(pole: float, why: str) -> None:
    with pytest.raises(InputError, match=why):
        unheld(np.array([[pole]]), np.ones((1, 1)), 0.1)


# -- poles and names -------------------------------------------------------------------------------


def test_sides_of_the_border() -> None:
    assert [list(x) for x in sides([-1.0, 1e-10j, 2.0], 0.0, relative=1e-9)] == [[0, 0, 1], [0, 1, 0]]
    assert [list(x) for x in sides([0.5, -1.0, 1.1], 0.1, relative=1e-9)] == [[0, 0, 1], [0, 1, 0]]
    assert [list(x) for x in sides([1e-6], 0.0, relative=0.0, rounding=1e-5)] == [[0], [1]]


def test_growth_rates_of_samples_are_those_of_the_continuous_poles() -> None:
    s = np.array([-1.0 + 2.0j, 0.3])
    assert growth_rates(np.exp(0.1 * s), 0.1) == pytest.approx([-1.0, 0.3])
    assert growth_rates(s, 0.0) == pytest.approx([-1.0, 0.3])


def test_python_control_has_the_names_without_dots() -> None:
    model = Linear(
        *(np.ones((1, 1)),) * 4, dt=0.5, state_names=("a.x",), input_names=("a.u",), output_names=("a.y",)
    ).to_state_space(name="my.model")
    assert (model.name, model.dt) == ("my_model", 0.5)
    assert (model.state_labels, model.input_labels, model.output_labels) == (["a_x"], ["a_u"], ["a_y"])


# -- threads -------------------------------------------------------------------------------------


def _threads(code: str) -> list[list[int]]:
    """Return the numbers of BLAS threads where code in a process of its own appends `now()` to `found`."""
    code = (
        "import json, numpy, sys, threadpoolctl; from workbench.core.machine.blas import one_thread\n"
        "def now(): return [a['num_threads'] for a in threadpoolctl.threadpool_info() if a['user_api'] == 'blas']\n"
        f"found = []\n{code}\nprint(json.dumps(found))"
    )
    environment = {k: v for k, v in os.environ.items() if not k.endswith("_NUM_THREADS")}
    told = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    found: list[list[int]] = json.loads(told.stdout)
    return found


def test_one_thread_is_one_of_libraries_loaded_since_the_last_time_too() -> None:
    code = (
        "with one_thread(): assert 'scipy.linalg' not in sys.modules\n"
        "import scipy.linalg\n"
        "with one_thread(): found.append(now())"
    )
    (found,) = _threads(code)
    assert found
    assert set(found) == {1}


def test_one_thread_is_one_of_libraries_loaded_within_too() -> None:
    code = (
        "with one_thread():\n"
        "    import scipy.linalg\n"
        "    with one_thread(): found.append(now())\n"
        "    found.append(now())\n"
    )
    assert [set(found) for found in _threads(code)] == [{1}, {1}]


def test_threads_are_given_back_by_the_last_of_contexts_that_overlap() -> None:
    code = (
        "threadpoolctl.threadpool_limits(2)\n"
        "first, second = one_thread(), one_thread()\n"
        "for enter in (first, second): enter.__enter__()\n"
        "for leave in (first, second): leave.__exit__(None, None, None); found.append(now())"
    )
    assert [set(found) for found in _threads(code)] == [{1}, {2}]


def test_a_mean_of_slow_samples_has_an_effect() -> None:
    """((1 + z⁻¹)/2)¹⁶ has gain 1 at rest, and vanishes to rounding near its Nyquist frequency of 0.102 Hz only."""
    taps = np.array([math.comb(16, k) for k in range(17)]) / 2.0**16
    names: dict[str, Any] = {"input_names": ("u",), "output_names": ("y",)}
    found = Linear(np.eye(16, k=-1), np.eye(16)[:, :1], taps[None, 1:], taps[:1, None], dt=0.5 / 0.102, **names)
    assert found.response(0.0)[0, 0, 0].real == pytest.approx(1.0)
    assert found.without_effect == ()


def test_what_has_no_effect_is_told_without_names_too() -> None:
    nothing = Linear(np.diag([-1.0, -2.0]), np.eye(2), np.array([[1.0, 0.0]]), np.zeros((1, 2)))
    assert nothing.without_effect == (("u2", "y1"),)


def test_poles_of_what_is_no_matrix_of_numbers_are_refused_in_one_line() -> None:
    """A file may have null in it."""
    with pytest.raises(InputError, match="matrix A must hold finite numbers"):
        _ = Linear(np.array([[np.nan]]), np.ones((1, 1)), np.ones((1, 1)), np.zeros((1, 1))).poles

"""Large models: what is sparse is used as such, gives what dense algebra gives, and is not believed where it lies."""

from __future__ import annotations

import ctypes
import gc
import math
import pickle
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import block_diag, expm

import workbench as wb
from tests.large_fmus import build_large
from workbench.core.values import large, matrices, modal
from workbench.core.values.arrays import Floats
from workbench.core.values.linear import Linear
from workbench.core.values.matrices import is_sparse, resolvent
from workbench.core.values.modal import poles_near, poles_of
from workbench.errors import SimulationError
from workbench.model.described_model import DescribedModel
from workbench.point.lin.page import lin_page
from workbench.response.nfr import period_solver as solved
from workbench.response.periodic.period_map import PeriodMap
from workbench.session import directional
from workbench.session.compiled import CompiledMeSession
from workbench.show.terminal import text_of

N = 80  # states: large enough to count as large


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("large")


def rod(n: int = N, path: float = 0.0) -> tuple[Floats, Floats]:
    """Return A and B of the rod; `path`: from its last cell to its first."""
    A = (np.diag(np.full(n, -2.0)) + np.diag(np.ones(n - 1), 1) + np.diag(np.ones(n - 1), -1)) * n**2
    A[-1, -1] = -float(n**2)
    A[0, -1] += path * n**2
    B = np.zeros(n)
    B[0] = n**2
    return A, B


def chain(n: int = N) -> Floats:
    """Return A of the chain."""
    half = n // 2
    K = (np.diag(np.full(half, -2.0)) + np.diag(np.ones(half - 1), 1) + np.diag(np.ones(half - 1), -1)) * half**2
    return np.block([[np.zeros((half, half)), np.eye(half)], [K, -0.2 * np.eye(half)]])


def run(file: Path, *, rtol: float = 1e-8, until: float = 0.7) -> tuple[Floats, int, CompiledMeSession]:
    """Return the states after a step of the input, and how many right-hand sides that took."""
    with wb.load(file, solver="gear", tolerance=rtol) as model, model.open_session() as session:
        assert isinstance(session, CompiledMeSession)
        session.advance(until, signals={"u": wb.Constant(1.0)}, record=["y"])
        return session.stand(), session.evaluations, session


def after_step(A: Floats, B: Floats, time: float) -> Floats:
    whole = np.zeros((len(A) + 1, len(A) + 1))
    whole[:-1, :-1], whole[:-1, -1] = A, B
    return np.asarray(expm(whole * time)[:-1, -1])


# -- gear --------------------------------------------------------------------------------------


def test_a_banded_newton_matrix_gives_the_exact_solution_with_few_evaluations(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = build_large(folder, "rod", N)
    x, few, session = run(file)
    assert session._sparsity is not None
    assert (session._sparsity.below, session._sparsity.above, session._sparsity.groups) == (1, 1, 3)
    np.testing.assert_allclose(x, after_step(*rod(), 0.7), atol=2e-7)
    monkeypatch.setattr(directional, "LARGE", 10**6)
    directional._known.clear()
    dense, many, session = run(file)
    assert session._sparsity is None
    np.testing.assert_allclose(x, dense, atol=2e-7)
    assert 3 * few < 2 * many


def test_states_in_another_order_are_a_narrow_band_too(folder: Path) -> None:
    """The chain has its positions first, then its velocities: no band as they stand."""
    x, _, session = run(build_large(folder, "chain", N))
    assert session._sparsity is not None
    assert session._sparsity.below + session._sparsity.above <= 6
    B = np.zeros(N)
    B[N // 2] = 1.0
    np.testing.assert_allclose(x, after_step(chain(), B, 0.7), atol=1e-6)


def test_a_description_that_lies_about_its_dependencies_costs_no_accuracy(folder: Path) -> None:
    x, _, session = run(build_large(folder, "lying", N))
    assert session._sparsity is not None
    np.testing.assert_allclose(x, after_step(*rod(path=0.25), 0.7), atol=2e-7)


@pytest.mark.skipif(
    sys.platform != "linux" or not hasattr(ctypes.CDLL(None), "mallinfo2"),
    reason="only the C library of GNU, from 2.33 on, tells how much of its heap is in use",
)
def test_many_sessions_with_a_band_leave_nothing_behind(folder: Path) -> None:
    def run_some() -> int:
        for _ in range(20):
            with model.open_session() as session:
                session.advance(0.01, signals={"u": wb.Constant(1.0)})
        return heap_in_use()

    with wb.load(build_large(folder, "lying", N), solver="gear") as model:
        run_some()
        before = run_some()
        grown = run_some() - before
    assert grown < 20 * 8 * N  # one vector of the states a session


class HeapFacts(ctypes.Structure):
    """struct mallinfo2 of the C library of GNU."""

    _fields_ = tuple(
        (name, ctypes.c_size_t)
        for name in (
            "arena", "ordblks", "smblks", "hblks", "hblkhd", "usmblks", "fsmblks", "uordblks", "fordblks", "keepcost",
        )
    )  # fmt: skip


def heap_in_use() -> int:
    gc.collect()
    ask = ctypes.CDLL(None).mallinfo2
    ask.restype = HeapFacts
    facts = ask()
    return int(facts.uordblks + facts.hblkhd)


@pytest.mark.parametrize(
    ("dependencies", "words"),
    [(True, "banded Newton matrix, 3 diagonals for 80 states, by 3 evaluations"), (False, "does not declare")],
)
def test_what_gear_does_is_said(folder: Path, monkeypatch: pytest.MonkeyPatch, dependencies: bool, words: str) -> None:
    monkeypatch.setattr(directional, "SLOW", N)
    file = build_large(folder / str(dependencies), "rod", N, dependencies=dependencies)
    with wb.load(file) as model:
        assert any(words in note for note in model.notes), model.notes


# -- linear models -----------------------------------------------------------------------------


@pytest.mark.parametrize("directional_derivatives", [True, False])
def test_columns_of_large_models_move_together(folder: Path, directional_derivatives: bool) -> None:
    file = build_large(folder / str(directional_derivatives), "rod", N, directional=directional_derivatives)
    with wb.load(file) as model:
        found = wb.lin(model, in_process=True).result
    A, B = rod()
    np.testing.assert_allclose(found.A, A, atol=1e-4 if not directional_derivatives else 1e-9)
    np.testing.assert_allclose(found.B[:, 0], B, atol=1e-4)
    assert found.method == ("exact" if directional_derivatives else "difference")
    assert not found.doubts
    assert sum(found.calls.values()) < N  # one by one it takes 160 of either


@pytest.mark.parametrize("directional_derivatives", [True, False])
def test_columns_that_the_description_lies_about_move_one_by_one(folder: Path, directional_derivatives: bool) -> None:
    file = build_large(folder / str(directional_derivatives), "lying", N, directional=directional_derivatives)
    with wb.load(file) as model:
        found = wb.lin(model, in_process=True).result
    np.testing.assert_allclose(found.A, rod(path=0.25)[0], atol=1e-4)


@pytest.mark.parametrize(("kind", "path", "most"), [("rod", 0.0, N), ("chain", 0.0, N), ("lying", 0.25, 4 * N)])
def test_trim_moves_unknowns_at_once_where_the_description_is_true(
    folder: Path, kind: str, path: float, most: int
) -> None:
    """One by one it takes two evaluations a state around the end alone."""
    with wb.load(build_large(folder, kind, N)) as model:
        found = wb.trim(model, fix={"u": 1.0}, in_process=True)
    assert found.converged
    assert found.evaluations < most
    assert (found.evaluations > 2 * N) == (kind == "lying")
    if kind != "chain":
        A, B = rod(path=path)
        np.testing.assert_allclose(list(found.operating_point.x.values()), -np.linalg.solve(A, B), rtol=1e-8)


def test_a_large_nonlinear_model_is_linearised_where_it_stands(folder: Path) -> None:
    x0 = {f"q[{i + 1}]": 0.5 + 0.01 * i for i in range(N // 2)}
    for directional_derivatives in (True, False):
        file = build_large(folder / str(directional_derivatives), "cubic", N, directional=directional_derivatives)
        with wb.load(file) as model:
            found = wb.lin(model, x0=x0, in_process=True).result
        A = chain()
        A[N // 2 :, : N // 2] -= np.diag(0.3 * np.array(list(x0.values())) ** 2)
        np.testing.assert_allclose(found.A, A, atol=1e-4)
        assert sum(found.calls.values()) < N


def test_sparse_elimination_gives_the_response_of_dense_algebra(monkeypatch: pytest.MonkeyPatch) -> None:
    A, B = rod(200)
    points = 2j * np.pi * np.array([0.01, 0.3, 5.0, 2000.0])
    assert is_sparse(A)
    sparse = resolvent(A, B[:, None], points)
    monkeypatch.setattr(matrices, "_LARGE", 10**6)
    assert not is_sparse(A)
    np.testing.assert_allclose(sparse, resolvent(A, B[:, None], points), rtol=1e-9, atol=1e-15)
    # At rest the rod has the temperature of its left end.
    np.testing.assert_allclose(resolvent(A, B[:, None], np.zeros(1, dtype=np.complex128))[0], 1.0, rtol=1e-9)


def test_a_point_on_a_pole_has_no_response() -> None:
    A = np.diag(np.arange(1.0, 201.0))
    assert is_sparse(A)
    found = resolvent(A, np.ones((200, 1)), np.array([3.0 + 0j, 0.5 + 0j]))
    assert np.isnan(found[0]).all()
    np.testing.assert_allclose(found[1, :, 0], 1.0 / (0.5 - np.arange(1.0, 201.0)))


def test_a_large_linear_model_is_sent_without_its_zeros() -> None:
    A, B = rod(200)
    C = np.zeros((1, 200))
    C[0, -1] = 1.0
    linear = Linear(A, B, C, np.zeros((1, 1)), input_names=("u",), output_names=("y",))
    sent = pickle.dumps(linear)
    assert len(sent) < 0.1 * A.nbytes
    again = pickle.loads(sent)  # noqa: S301 - our own
    np.testing.assert_array_equal(again.A, A)
    assert again.input_names == ("u",)


# -- poles and modes ---------------------------------------------------------------------------


def oscillators(*more: Floats) -> Floats:
    """200 oscillators of 5 … 60 Hz and other blocks, in states of unlike units and mixed order; sparse."""
    own = [_oscillator(f, 0.01) for f in np.linspace(5.0, 60.0, 200)]
    matrix, random = block_diag(*own, *more), np.random.default_rng(3)
    order, units = random.permutation(len(matrix)), 2.0 ** random.integers(-4, 5, len(matrix))
    found: Floats = matrix[order][:, order] * units[:, None] / units
    return found


def _oscillator(frequency: float, damping: float) -> Floats:
    w = 2.0 * np.pi * frequency
    return np.array([[0.0, 1.0], [-w * w, -2.0 * damping * w]])


def _twice(block: Floats) -> Floats:
    """Its poles are double, with one eigenvector each: a Jordan block."""
    return np.block([[block, np.eye(len(block))], [np.zeros_like(block), block]])


_BESIDE_1_HZ = 2.0 * np.pi * np.array([[1e-3, 1.0], [-1.0, 1e-3]])  # its poles are where the Arnoldi method looks from


@pytest.mark.parametrize(
    ("block", "about", "poles"),
    [
        (np.diag(np.ones(3), 1), 0.0, [0.0] * 4),
        (_BESIDE_1_HZ, 1.0, [2.0 * np.pi * (1e-3 + 1j)]),
        (_twice(_oscillator(0.5, 0.02)), 0.5, [np.pi * (-0.02 + 1j * math.sqrt(1.0 - 4e-4))] * 2),
        (block_diag(*[_oscillator(1.0, 0.02)] * 8), 1.0, [2.0 * np.pi * (-0.02 + 1j * math.sqrt(1.0 - 4e-4))] * 8),
    ],
    ids=["four integrators", "on the shift", "double, defective", "eight equal"],
)
def test_poles_that_coincide_or_lie_on_the_shift_are_all_found(
    block: Floats, about: float, poles: list[complex]
) -> None:
    found = poles_near(oscillators(block), len(poles) + 1, about)
    assert len(found) == len(poles) + 1
    near = found.value[np.argsort(np.abs(found.value - 2j * np.pi * about))[: len(poles)]]
    np.testing.assert_allclose(near, poles, atol=2e-3)
    assert np.abs(found.value - 2j * np.pi * about).max() > 10.0  # the last one is one of the others


@pytest.mark.parametrize("frequency", [0.0, 3.0, 40.0])
def test_poles_near_a_frequency_are_those_of_dense_algebra(monkeypatch: pytest.MonkeyPatch, frequency: float) -> None:
    monkeypatch.setattr(modal, "_LARGE", 100)
    A = chain(240)
    found = poles_near(A, 5, frequency)
    every = poles_of(A).nearest(5, 2j * np.pi * frequency)
    np.testing.assert_allclose(found.value, every.value, rtol=1e-8)
    assert (np.abs(found.value - every.value) <= found.uncertain + every.uncertain).all()
    # The closed form: s² + 0.2 s + ω² = 0 with ω = 2 √k sin(iπ / 2(m + 1)) of m masses between walls.
    half = 120
    stiff = (2.0 * half * np.sin(np.arange(1, half + 1) * np.pi / (2.0 * (half + 1)))) ** 2
    exact = -0.1 + 1j * np.sqrt(stiff - 0.01)
    nearest = exact[np.argsort(np.abs(exact - 2j * np.pi * frequency))[:5]]
    np.testing.assert_allclose(np.sort(found.value.imag), np.sort(nearest.imag), rtol=1e-8)
    np.testing.assert_allclose(found.left.conj().T @ found.right, np.eye(5), atol=1e-9)
    residual = A @ found.right - found.right * found.value
    assert np.abs(residual).max() <= 1e-8 * np.abs(A).max()


def test_no_pole_near_a_frequency_is_left_out() -> None:
    half, frequency = 300, 5.0
    found = poles_near(chain(2 * half), 50, frequency).value
    stiff = (2.0 * half * np.sin(np.arange(1, half + 1) * np.pi / (2.0 * (half + 1)))) ** 2
    exact = -0.1 + 1j * np.sqrt(stiff - 0.01)
    nearest = exact[np.argsort(np.abs(exact - 2j * np.pi * frequency))[:50]]
    np.testing.assert_allclose(np.sort(found.imag), np.sort(nearest.imag), rtol=1e-8)


@pytest.mark.parametrize("converges", [True, False])
def test_lin_shows_the_poles_asked_for_and_says_that_they_are_not_all(
    folder: Path, monkeypatch: pytest.MonkeyPatch, *, converges: bool
) -> None:
    monkeypatch.setattr(large, "_LARGE", 500)
    if not converges:
        monkeypatch.setattr(modal, "_arnoldi", never_found)
    half, frequency = 300, 5.0
    with wb.load(build_large(folder / str(converges), "chain", 2 * half)) as model:
        result = wb.lin(model, about=frequency, in_process=True).result
    stiff = (2.0 * half * np.sin(np.arange(1, half + 1) * np.pi / (2.0 * (half + 1)))) ** 2
    exact = -0.1 + 1j * np.sqrt(stiff - 0.01)
    nearest = exact[np.argsort(np.abs(exact - 2j * np.pi * frequency))[:50]]
    shown = result.shown_poles
    np.testing.assert_allclose(np.sort(shown.imag), np.sort([*nearest.imag, *-nearest.imag]), rtol=1e-6)
    assert "poles" not in vars(result)  # these cost n³
    text = text_of(lin_page(result), None)
    assert "100 of 600, the nearest to 5 Hz" in text
    assert "The oscillation of those shown damped least" in text
    assert any("whether another one is unstable is not known" in note for note in result.notes)
    written = result.to_dict()
    assert written["all_poles"] is False
    assert len(written["poles"]) == len(written["damping"]) == 100
    assert len(result.poles) == 600


def never_found(*_: object) -> None:
    raise SimulationError("the poles were not found")


def test_modes_follows_the_wanted_ones_only(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(modal, "_LARGE", 64)
    monkeypatch.setattr(matrices, "_LARGE", 64)
    n = 240
    with wb.load(build_large(folder, "cubic", n)) as model:
        assert isinstance(model, DescribedModel)
        few = wb.modes(model, vary="q[60]", values=[0.0, 2.0, 4.0], count=4, in_process=True)
    (found,) = few.sets
    assert len(found.modes) == 4
    assert any("only 4 modes are followed, those nearest to 0 Hz" in note for note in few.notes)
    for column, value in enumerate([0.0, 2.0, 4.0]):
        A = chain(n)
        A[n // 2 + 59, 59] -= 0.3 * value**2
        exact = poles_of(A).nearest(4, 0j).value
        row = [m.pole[list(found.value).index(value)] for m in found.modes]
        np.testing.assert_allclose(row, exact, rtol=1e-6, err_msg=str(column))


# -- frequency response ------------------------------------------------------------------------


def test_a_point_of_a_model_too_large_for_slopes_is_right(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a linear model and without slopes it is waited for."""
    monkeypatch.setattr(solved, "_MOST_STATES", N - 1)
    monkeypatch.setattr("workbench.response.nfr.prior_knowledge._MOST_STATES", N - 1)
    with wb.load(build_large(folder, "rod", N), tolerance=1e-7) as model:
        found = wb.nfr(model, "u", "y", frequencies=[0.5], amplitudes=[1.0], in_process=True)
    A, B = rod()
    exact = np.linalg.solve(2j * np.pi * 0.5 * np.eye(N) - A, B)[-1]
    assert found.response[0][0] == pytest.approx(exact, rel=1e-4)


def chain_gain(n: int, frequency: float) -> complex:
    """Return the response of the chain from its force to its last mass, by the determinant of a tridiagonal matrix."""
    stiffness, s = 0.25 * n * n, 2j * math.pi * frequency
    ratio = 2.0 * stiffness + s * s + 0.2 * s
    gain = 1.0 / ratio  # of one mass; each further one multiplies by stiffness over the quotient of determinants
    for _ in range(n // 2 - 1):
        ratio = 2.0 * stiffness + s * s + 0.2 * s - stiffness**2 / ratio
        gain *= stiffness / ratio
    return gain


@pytest.mark.parametrize("tolerance", [1e-6, 1e-8, 1e-9])
def test_a_point_of_many_light_modes_takes_a_period_and_its_error_holds(
    folder: Path, tolerance: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The states at the far end move by less than the integration looks at: no period closes better than the first."""
    n, periods = 200, 0
    lap = PeriodMap.lap

    def counted(*args: object, **kwargs: object) -> object:
        nonlocal periods
        periods += 1
        return lap(*args, **kwargs)  # type: ignore[arg-type]

    monkeypatch.setattr(PeriodMap, "lap", counted)
    frequencies = [0.02, 0.1, 0.3, 1.0]
    with wb.load(build_large(folder, "chain", n), tolerance=tolerance) as model:
        found = wb.nfr(model, "u", "y", frequencies=frequencies, amplitudes=[1.0], in_process=True)
    exact = np.array([chain_gain(n, f) for f in frequencies])
    assert (np.abs(found.response[0] / exact - 1.0) <= found.error[0]).all()
    assert (found.error[0] <= 0.01).all()
    assert periods <= 2 * len(frequencies)

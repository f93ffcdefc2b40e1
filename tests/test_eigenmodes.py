"""Modes of linear models: networks of storages and resistances, chains of which only the slow modes are found."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.core.values.arrays import Floats
from workbench.core.values.eigenmodes import Eigenmodes, symmetric_form
from workbench.core.values.matrices import held

QUICK = 100.0  # [1/s]
OVER = 69.1 / QUICK  # [s], after which 1e-30 is left of what is quicker


@pytest.mark.parametrize("seed", range(20))
def test_networks_of_storages_and_resistances_have_a_symmetric_form(seed: int) -> None:
    """C·dx/dt = −G x with a symmetric G, of one or several parts; its poles are those of the symmetric form."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 30))
    joined = np.triu(rng.uniform(0.1, 2.0, (n, n)) * (rng.uniform(size=(n, n)) < 2.0 / n), 1)
    G = np.diag((joined + joined.T).sum(axis=1) + rng.uniform(0.0, 1.0, n)) - joined - joined.T
    A = -G / (10.0 ** rng.uniform(-3.0, 3.0, n))[:, None]
    form = symmetric_form(A)
    assert form is not None
    d, at, values = form
    symmetric = np.zeros_like(A)
    symmetric[at] = values
    np.testing.assert_array_equal(symmetric, symmetric.T)
    np.testing.assert_allclose(symmetric * d[:, None] / d, A, rtol=1e-10, atol=0.0)
    np.testing.assert_allclose(np.linalg.eigvalsh(symmetric), np.sort(np.linalg.eigvals(A).real), rtol=1e-8, atol=1e-12)


@pytest.mark.parametrize(
    "A",
    [
        np.zeros((0, 0)),
        np.array([[0.0, 1.0], [-1.0, 0.0]]),  # it oscillates
        np.array([[-1.0, 1.0], [0.0, -1.0]]),  # one way only
        np.array([[-3.0, 1.0, 1.0], [2.0, -3.0, 1.0], [1.0, 2.0, -3.0]]),  # around and around
        np.diag(-2.0 * np.ones(30)) + np.diag(np.full(29, 0.1), 1) + np.diag(np.full(29, 10.0), -1),  # 10**29
        np.diag(np.full(499, 2.9), 1) + np.diag(np.full(499, 0.01), -1),  # carried along: 10**-614
        np.diag(np.full(499, 0.01), 1) + np.diag(np.full(499, 2.9), -1),
        np.array([[-1.0, 1e300], [1e-300, -1.0]]),
        np.array([[np.nan]]),
    ],
)
def test_other_matrices_have_no_symmetric_form_that_is_harmless(A: Floats) -> None:
    assert symmetric_form(A) is None


@pytest.mark.parametrize("corner", [0.0, 1.0])  # a chain, and one that is closed to a ring
@pytest.mark.parametrize("n", [1, 2, 3, 200])
def test_modes_are_those_of_chains_and_rings(n: int, corner: float) -> None:
    """Of x(i+1) + x(i−1) − 2 x(i): −4 sin²(kπ/(2n + 2)) for held ends; of a ring −4 sin²(kπ/n)."""
    S = np.diag(np.full(n, -2.0)) + np.diag(np.ones(n - 1), 1) + np.diag(np.ones(n - 1), -1)
    k = np.arange(1, n + 1)
    wanted = -4.0 * np.sin(k * np.pi / (2 * n + 2)) ** 2
    if corner and n > 2:
        S[0, -1] = S[-1, 0] = corner
        wanted = -4.0 * np.sin(k * np.pi / n) ** 2
    modes = Eigenmodes.of(S)
    assert modes is not None
    np.testing.assert_allclose(modes.poles, np.sort(wanted), rtol=0.0, atol=1e-13)
    np.testing.assert_allclose(modes.inverse @ modes.vectors, np.eye(n), rtol=0.0, atol=1e-13)
    np.testing.assert_allclose(S @ modes.vectors, modes.vectors * modes.poles, rtol=0.0, atol=1e-13)


def chain(seed: int, leak: float) -> tuple[Floats, np.random.Generator]:
    """Return A of a chain of storages of different sizes; without a leak it has a pole at 0."""
    rng, n = np.random.default_rng(seed), 260
    g, sizes = 1e3 * rng.uniform(0.5, 2.0, n - 1), 10.0 ** rng.uniform(-1.0, 1.0, n)
    S = np.diag(g, 1) + np.diag(g, -1)
    return (S - np.diag(S.sum(axis=1)) - np.diag(leak * np.eye(n)[0])) / sizes[:, None], rng


def some_and_all(A: Floats) -> tuple[Eigenmodes, Eigenmodes]:
    """Return the slow modes and all."""
    some, every = Eigenmodes.of(A, QUICK, 1.0), Eigenmodes.of(A)
    assert some is not None
    assert every is not None
    assert 3 * len(some.poles) < len(every.poles) == len(A)
    return some, every


@pytest.mark.parametrize("leak", [0.0, 50.0, -50.0])  # an integrator, a stable and an unstable one
@pytest.mark.parametrize("seed", range(2))
def test_held_inputs_of_a_chain_need_its_slow_modes_only(seed: int, leak: float) -> None:
    A, rng = chain(seed, leak)
    some, _ = some_and_all(A)
    c = rng.standard_normal(len(A))
    _, integral = held(A, np.eye(len(A)), OVER)
    wanted = c @ integral
    np.testing.assert_allclose(some.held(c, OVER), wanted, rtol=0.0, atol=1e-11 * np.abs(wanted).max())


@pytest.mark.parametrize("seed", range(2))
def test_the_bound_by_slow_modes_is_none_below_that_by_all(seed: int) -> None:
    """And not much above where the defects are smooth: quick modes have little of them."""
    A, rng = chain(seed, 50.0)
    some, every = some_and_all(A)
    rough = rng.standard_normal((len(A), 5))
    smooth = some.vectors @ rng.standard_normal((len(some.poles), 5))
    for defects, most in ((rough, 2.0), (smooth, 1.0 + 1e-9)):
        found, wanted = (m.bound(defects, -m.poles.real) for m in (some, every))
        assert (found >= wanted * (1.0 - 1e-9)).all()
        assert (found <= wanted * most).all()


def test_modes_that_the_slowest_is_not_much_slower_than_are_all_found() -> None:
    A, _ = chain(0, 50.0)
    modes = Eigenmodes.of(A, 1e-3, 1e9)
    assert modes is not None
    assert len(modes.poles) == len(A)
    assert modes.beyond == np.inf

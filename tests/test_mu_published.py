"""Bounds of µ and margins against published examples whose data can be written down, and closed forms.

Not here, for their data are in no book or paper at hand: the transport aircraft with 14 parameters, the flexible
structures of the toolboxes.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

import workbench as wb
from scripts.promises.mu import _support, two_complex
from workbench.core.values.arrays import Complex
from workbench.core.values.linear import Linear
from workbench.loops.mu.blocks import MuBlock
from workbench.loops.mu.lower import lower_bound
from workbench.loops.mu.peak import peak
from workbench.loops.mu.upper import upper_bound

MASS, DAMPING, STIFFNESS, SHARES = 3.0, 1.0, 2.0, (0.4, 0.2, 0.3)  # Gu, Petkov & Konstantinov, section 8.1


def mass_spring_damper(omega: float) -> tuple[Complex, list[complex]]:
    """Return M of rank one, and what each parameter adds to m s² + c s + k, over that."""
    s = 1j * omega
    terms = [p * w for p, w in zip((MASS * s * s, DAMPING * s, complex(STIFFNESS)), SHARES, strict=True)]
    reached = [-t / (MASS * s * s + DAMPING * s + STIFFNESS) for t in terms]
    return np.outer(np.ones(3), np.array(reached)), reached


@pytest.mark.parametrize("omega", [0.01, 0.3, math.sqrt(STIFFNESS / MASS), 0.83, 2.0, 50.0])
def test_mass_spring_and_damper_that_are_known_to_40_20_and_30_percent(omega: float) -> None:
    """1 - Σ δᵢ rᵢ = 0: complex δ need 1/Σ |rᵢ|, real ones the support of the segments ± rᵢ; two real, one complex."""
    m, r = mass_spring_damper(omega)
    for real in ((False,) * 3, (True,) * 3, (True, True, False)):
        blocks = [MuBlock(size=1, real=x) for x in real]
        segments = [x for x, is_real in zip(r, real, strict=True) if is_real]
        truth = _support(segments, sum(abs(x) for x, is_real in zip(r, real, strict=True) if not is_real))
        assert lower_bound(m, blocks).bound <= truth * (1.0 + 1e-6)
        bound = upper_bound(m, blocks).bound
        assert truth * (1.0 - 1e-6) <= bound <= sum(map(abs, r)) * (1.0 + 1e-3)
        if 0.1 < omega < 10.0:  # else M is nearly real, and µ of real numbers is not continuous there
            assert bound <= 1.06 * truth


def test_mass_spring_and_damper_are_lost_where_the_first_of_them_is_0() -> None:
    """Stable as long as m, c and k are positive: up to 1/0.4 times the ranges, where the mass is 0 (at ω = ∞)."""
    a = np.array([[0.0, 1.0], [-STIFFNESS / MASS, -DAMPING / MASS]])
    # m x'' = -k x - c x' - Σ wᵢ δᵢ (m x'', c x', k x); x'' itself goes through, which makes 1/m exact.
    through = np.array([STIFFNESS, DAMPING]) / MASS
    c = np.array([-SHARES[0] * through, [0.0, SHARES[1] * DAMPING / MASS], [SHARES[2] * STIFFNESS / MASS, 0.0]])
    b = np.array([[0.0] * 3, [-1.0] * 3])
    d = np.array([[-SHARES[0]] * 3, [0.0] * 3, [0.0] * 3])
    found = peak(Linear(a, b, c, d), [MuBlock(size=1, real=True)] * 3)
    assert 0.4 <= found.level <= 0.41


def test_the_matrix_whose_bound_is_not_mu() -> None:
    """Packard & Doyle (1993), section 9.2: four complex numbers; the bound is 1, µ is about 0.87."""
    root = math.sqrt(3.0)
    gamma, beta = 3.0 + root, root - 1.0
    a, b, d = math.sqrt(2.0 / gamma), 1.0 / math.sqrt(gamma), -math.sqrt(beta / gamma)
    f = (1 + 1j) / math.sqrt(gamma * beta)
    u = np.array([[a, 0.0], [b, b], [b, 1j * b], [d, f]])
    v = np.array([[0.0, a], [b, -b], [b, -1j * b], [-1j * f, -d]])
    assert np.allclose(u.conj().T @ u, np.eye(2))  # as published
    assert np.allclose(v.conj().T @ v, np.eye(2))
    m, blocks = u @ v.conj().T, [MuBlock(size=1)] * 4
    assert upper_bound(m, blocks).bound == pytest.approx(1.0, abs=1e-3)
    assert 0.85 <= lower_bound(m, blocks).bound <= 0.88


def test_two_complex_numbers_are_exact() -> None:
    """µ of 2 × 2 is its bound: for one matrix by the largest spectral radius over the phase between them."""
    m, blocks, truth = two_complex(np.random.default_rng(11))
    assert lower_bound(m, blocks).bound <= truth * (1.0 + 1e-6)
    assert upper_bound(m, blocks).bound == pytest.approx(truth, rel=1e-4)


def test_the_spinning_satellite_bears_a_tenth_in_both_channels() -> None:
    """Zhou, Doyle & Glover, section 9.6: s² + (2 + ε₁ + ε₂) s + 1 + ε₁ + ε₂ + (1 + a²) ε₁ ε₂; lost at 1/√(1 + a²)."""
    turn = 10.0
    t = np.array([[1.0, turn], [-turn, 1.0]])
    system = Linear(-np.eye(2), np.eye(2), -t, np.zeros((2, 2)))  # -T = -(I + a J)/(s + 1)
    truth = math.sqrt(1.0 + turn**2)
    for real in (True, False):
        level = peak(system, [MuBlock(size=1, real=real)] * 2).level
        assert truth <= level <= 1.02 * truth


def test_a_loop_with_three_parameters_after_de_gaston_and_safonov() -> None:
    """p₁ (s + 2)/(s (s + p₂) (s + p₃) (s + 10)), p₁ = 800 ± 10 %, p₂ = 4 ± 0.2, p₃ = 6 ± 0.3; truth at the corner.

    IEEE Trans. Automatic Control 33 (1988). Their figure is not repeated here: the roots of the polynomial are.
    """
    low, high = 1.0, 5.0
    while high - low > 1e-6:
        k = 0.5 * (low + high)
        below = np.polymul([1.0, 10.0, 0.0], np.polymul([1.0, 4.0 - 0.2 * k], [1.0, 6.0 - 0.3 * k]))
        stable = np.roots(np.polyadd(below, 800.0 * (1.0 + 0.1 * k) * np.array([1.0, 2.0]))).real.max() < 0.0
        low, high = (k, high) if stable else (low, k)
    parts = {
        "lead": wb.BlockComponent(name="lead", kind="transfer_function",
                                  parameters={"numerator": [1.0, 2.0], "denominator": [1.0, 10.0]}),
        "p1": 800.0, "p2": 4.0, "p3": 6.0,
        **{f"x{k}": wb.BlockComponent(name=f"x{k}", kind="integrator") for k in (1, 2, 3)},
        "error": wb.SumComponent(name="error", signs=(1, -1)),
        "in3": wb.SumComponent(name="in3", signs=(1, -1)), "in2": wb.SumComponent(name="in2", signs=(1, -1)),
    }  # fmt: skip
    wires = [
        ("x1.y", "error.u2"), ("error.y", "lead.u"), ("lead.y", "p1.u"), ("p1.y", "in3.u1"), ("x3.y", "p3.u"),
        ("p3.y", "in3.u2"), ("in3.y", "x3.u"), ("x3.y", "in2.u1"), ("x2.y", "p2.u"), ("p2.y", "in2.u2"),
        ("in2.y", "x2.u"), ("x2.y", "x1.u"),
    ]  # fmt: skip
    ranges = {"p1.gain": (720.0, 880.0), "p2.gain": (3.8, 4.2), "p3.gain": (5.7, 6.3)}
    with wb.connect(parts, wires, inputs={"r": "error.u1"}) as loop:
        told = wb.robust(loop, ranges, up_to=5.0, hold=True, in_process=True).stability
    assert 0.96 * low <= told.lower <= low
    assert low <= told.upper <= 1.005 * low

"""Limit cycles followed over a parameter: folds, ends, stability, parameters of FMUs."""

from __future__ import annotations

import math
from pathlib import Path

import control
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from workbench.analysis.limit_cycle.continuation import follow
from workbench.analysis.limit_cycle.family import gain_family

from tests.limit_cycle_loops import LAG, chain
from workbench.analysis.describing.describe import standard_block
from workbench.analysis.limit_cycle.floquet import multipliers
from workbench.analysis.limit_cycle.harmonic_balance import balance
from workbench.analysis.limit_cycle.request import limit_cycle
from workbench.core.linear import LinearPart
from workbench.errors import InputError
from workbench.model.described import DescribedModel
from workbench.system.connect import connect

Floats = NDArray[np.float64]


def test_the_fold_of_a_relay_with_a_dead_zone() -> None:
    """With one harmonic: N = (4M/πA)√(1 − (δ/A)²) is largest, 2M/πδ, at A = δ√2; gain/8 · N = 1 there."""
    plant = control.ss(LAG)
    part, block = (
        LinearPart(plant.A, plant.B[:, 0], plant.C[0]),
        standard_block("relay", {"level": 2.0, "dead_zone": 0.1}),
    )
    cycle = balance(part, (block,), frequency=0.27, amplitude=0.31, count=1)
    assert cycle is not None
    branch = follow(lambda g: gain_family(part, block, g), parameter="gain", start=1.0, limits=(0.3, 2.0), cycle=cycle)
    (fold,) = branch.folds
    assert fold.value == pytest.approx(8.0 * math.pi * 0.1 / 4.0, rel=1e-6)
    assert fold.fundamental == pytest.approx(0.1 * math.sqrt(2.0), rel=1e-4)
    # One harmonic does not solve the equations, and gives no multiplier 1 on the lower branch: nothing is told there.
    assert {p.stable for p in branch.points} == {True, None}
    assert all(p.stable is None for p in branch.points if p.fundamental < fold.fundamental)
    assert branch.points[0].value == pytest.approx(2.0)
    assert branch.points[-1].value == pytest.approx(2.0)
    for p in branch.points:
        assert p.value / 8.0 * block.gain(p.fundamental).real == pytest.approx(1.0, rel=1e-5)


def test_the_lower_branch_of_a_fold_is_unstable() -> None:
    """The same relay with seven harmonics, whose motions have the multiplier 1: above the fold stable, below not."""
    plant = control.ss(LAG)
    part = LinearPart(plant.A, plant.B[:, 0], plant.C[0])
    block = standard_block("relay", {"level": 2.0, "dead_zone": 0.1})
    cycle = balance(part, (block,), frequency=0.27, amplitude=0.31)
    assert cycle is not None
    branch = follow(lambda g: gain_family(part, block, g), parameter="gain", start=1.0, limits=(0.5, 1.1), cycle=cycle)
    (fold,) = branch.folds
    upper = [p.stable for p in branch.points if p.fundamental > 1.2 * fold.fundamental]
    lower = [p.stable for p in branch.points if p.fundamental < 0.9 * fold.fundamental]
    assert set(upper) == {True}
    assert True not in lower
    assert lower.count(False) > 0.5 * len(lower)


def test_cycles_of_fmus_over_a_parameter(tmp_path: Path) -> None:
    """The limit of a saturation scales the amplitude and nothing else; a time constant moves the frequency."""
    with chain() as system:
        result = limit_cycle(
            system,
            block="block",
            methods=("harmonic balance",),
            harmonics=3,
            vary={"c.tau": (0.5, 2.0), "gain": (0.85, 2.0)},
        )
    over_tau, over_gain = result.branches
    assert (over_tau.parameter, over_gain.parameter) == ("c.tau", "gain")
    for p in over_tau.points:
        # Im of (jω + 1)²(jωτ + 1) is zero at ω² = (2 + τ)/τ.
        assert p.frequency_hz == pytest.approx(math.sqrt((2.0 + p.value) / p.value) / (2.0 * math.pi), rel=0.01)
        assert p.stable
    assert over_gain.points[0].fundamental < over_gain.points[-1].fundamental
    result.plot(tmp_path / "a.png")
    over_tau.plot(tmp_path / "b.png")
    over_tau.to_csv(tmp_path / "b.csv")
    assert len((tmp_path / "b.csv").read_text(encoding="utf-8").splitlines()) == len(over_tau.points) + 1


def test_orbits_are_followed_to_both_bounds() -> None:
    """Of a loop whose harmonics hardly return, the frequency is the describing function's to 1 %."""
    with chain() as system:
        methods = ("describing function", "harmonic balance", "shooting")
        result = limit_cycle(system, block="block", methods=methods, vary={"c.tau": (0.5, 2.0)})
    (branch,) = result.branches
    values = [p.value for p in branch.points]
    assert (min(values), max(values)) == (0.5, 2.0)
    assert branch.ends == ("the parameter's bound", "the parameter's bound")
    for p in branch.points:
        # Im of (jω + 1)²(jωτ + 1) is zero at ω² = (2 + τ)/τ.
        assert p.frequency_hz == pytest.approx(math.sqrt((2.0 + p.value) / p.value) / (2.0 * math.pi), rel=0.01)
        assert p.stable
    assert branch.bifurcations == ()
    rows = list(result.rows())
    assert len(rows) == 1 + len(result.limit_cycles) + len(branch.points)
    assert {len(row) for row in rows} == {len(rows[0])}


def test_an_unknown_parameter_is_one_line() -> None:
    with chain() as system, pytest.raises(InputError, match=r"did you mean .*c\.tau"):
        limit_cycle(system, block="block", methods=("harmonic balance",), vary={"c.tua": (0.5, 2.0)})


def test_splitting_gives_the_same_multipliers() -> None:
    """Large systems are split into the linear part and the block; here both ways on the same cycle."""
    plant = control.ss(10.0 * LAG)
    part, block = LinearPart(plant.A, plant.B[:, 0], plant.C[0]), standard_block("saturation")
    cycle = balance(part, (block,), frequency=0.2757, amplitude=1.4555)
    assert cycle is not None
    padded = LinearPart(
        np.block([[part.A, np.zeros((3, 30))], [np.zeros((30, 3)), -np.eye(30)]]),
        np.append(part.b, np.zeros(30)),
        np.append(part.c, np.zeros(30)),
    )
    small, large = multipliers(part, (block,), cycle), multipliers(padded, (block,), cycle)
    assert np.abs(large[:2]) == pytest.approx(np.abs(small[:2]), rel=1e-4)


def test_cycles_over_a_parameter_of_the_block() -> None:
    """A dead band's or a saturation's own limits are followed with the block alone opened again."""
    with chain() as system:
        result = limit_cycle(
            system, block="block", methods=("harmonic balance",), harmonics=3, vary={"block.D": (0.9, 1.2)}
        )
    (branch,) = result.branches
    (cycle,) = result.limit_cycles
    # y = sat(D u): D u has the cycle of a loop with gain D.
    assert branch.points[0].value == pytest.approx(0.9)
    assert branch.points[-1].value == pytest.approx(1.2)
    assert branch.points[0].fundamental < cycle.fundamental < branch.points[-1].fundamental


def cubic_loop() -> DescribedModel:
    """Return c1 u + c3 u³, c3 < 0, around three lags and a gain of 16."""
    return connect(
        {"block": "fmu:AlgebraicExpression", "lags": control.ss(LAG)},
        [("lags.y", "block.u", {"gain": -16.0}), ("block.y", "lags.u")],
        start_values={
            "block.C[1]": 0.0, "block.C[2]": 0.0, "block.D": 1.0,
            "block.c0": 0.0, "block.c1": 0.7, "block.c2": 0.0, "block.c3": -0.1,
        },
    )  # fmt: skip


def test_two_nonlinear_blocks_in_one_loop() -> None:
    """The other block is taken at its slope by the describing function, and as it is by shooting: SciPy agrees."""
    with connect(
        {"block": "fmu:Saturation", "cubic": "fmu:AlgebraicExpression", "lags": control.ss(LAG)},
        [("lags.y", "block.u", {"gain": -16.0}), ("block.y", "cubic.u"), ("cubic.y", "lags.u")],
        start_values={
            "block.C[1]": 0.0, "block.C[2]": 0.0, "block.D": 1.0, "cubic.C[1]": 0.0, "cubic.C[2]": 0.0, "cubic.D": 1.0,
            "cubic.c0": 0.0, "cubic.c1": 1.0, "cubic.c2": 0.0, "cubic.c3": -0.3,
        },
    ) as system:  # fmt: skip
        result = limit_cycle(system, block="block", methods=("describing function", "shooting"))
    (orbit,) = [c for c in result.limit_cycles if c.method == "shooting"]

    def slope(_: float, x: Floats) -> Floats:
        v = min(max(-16.0 * x[2], -1.0), 1.0)
        return np.array([v - 0.3 * v**3 - x[0], x[0] - x[1], x[1] - x[2]])

    run = solve_ivp(slope, (0.0, 200.0), [0.1, 0.0, 0.0], rtol=1e-9, atol=1e-12, max_step=0.05, dense_output=True)
    rising = [t for t in np.arange(150.0, 200.0, 0.01) if run.sol(t)[2] < 0.0 <= run.sol(t + 0.01)[2]]
    passes = [brentq(lambda t: run.sol(t)[2], t, t + 0.01) for t in rising]
    assert 1.0 / orbit.frequency_hz == pytest.approx(float(np.mean(np.diff(passes))), rel=1e-5)
    assert orbit.amplitude == pytest.approx(16.0 * np.abs(run.sol(np.arange(150.0, 200.0, 0.01))[2]).max(), rel=1e-4)
    assert orbit.stable


def test_shooting_follows_a_cycle_to_its_hopf_point() -> None:
    """y = c1 u + c3 u³ around three lags: the equilibrium begins to oscillate at c1 = 1/2, 16 c1 = 8."""
    with cubic_loop() as system:
        result = limit_cycle(
            system, block="block", methods=("describing function", "shooting"), vary={"block.c1": (0.4, 0.72)}
        )
    (branch,) = result.branches
    (hopf,) = branch.hopf
    assert hopf.value == pytest.approx(0.5, abs=1e-6)
    assert hopf.frequency_hz == pytest.approx(math.sqrt(3.0) / (2.0 * math.pi), rel=1e-6)
    assert branch.ends[0] == "the cycle shrinks to a point"
    assert branch.points[-1].value == pytest.approx(0.72)
    assert all(p.stable for p in branch.points)


def test_a_branch_ends_where_its_cycle_vanishes() -> None:
    """y = c1 u + c3 u³, c3 < 0, around three lags: c1 + ¾ c3 A² = 1/2 with one harmonic, so that A = 0 at c1 = 1/2."""
    with cubic_loop() as system:
        result = limit_cycle(
            system, block="block", methods=("harmonic balance",), harmonics=1, vary={"block.c1": (0.4, 0.72)}
        )
    (branch,) = result.branches
    end = min(branch.points, key=lambda p: p.value)
    assert "the cycle shrinks to a point" in branch.ends
    assert end.value == pytest.approx(0.5, abs=1e-5)
    assert end.amplitude < 2e-3
    # The equilibrium solves the equations at every value; no point of the branch lies on it. Residuals of 1e-8 of the
    # first cycle's size are 1e-5 of one that is a thousand times smaller.
    for p in branch.points:
        assert 0.075 * p.fundamental**2 == pytest.approx(p.value - 0.5, abs=1e-5)

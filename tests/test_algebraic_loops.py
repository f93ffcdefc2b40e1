"""Algebraic loops of which some values have always been 0: every one that has a solution is solved."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import workbench as wb
from tests.misbehaving_fmus import build_misbehaving
from workbench.system.algebraic import AlgebraicLoop, solve_loop

FAST = 1.0 / 64.0


@pytest.mark.parametrize("seed", range(300))
def test_values_at_rest_keep_no_linear_loop_from_its_solution(seed: int) -> None:
    chance = np.random.default_rng(seed)
    n = int(chance.integers(2, 6))
    rest = int(chance.integers(1, n))
    gains, offset = np.zeros((n, n)), np.zeros(n)
    gains[:rest, :rest] = np.tril(chance.normal(size=(rest, rest)), -1)  # 0 wherever they begin at 0
    gains[rest:] = chance.normal(size=(n - rest, n)) * chance.choice([1e-3, 1.0, 1e3])
    offset[rest:] = chance.normal(size=n - rest) * 10.0 ** chance.uniform(-9.0, 3.0)
    order = chance.permutation(n)
    gains, offset = gains[np.ix_(order, order)], offset[order]
    loop = AlgebraicLoop(
        lambda v: gains @ v + offset, [str(i) for i in range(n)], np.zeros(n), np.ones(n), np.zeros((n, n)),
        np.zeros(1, np.int32),
    )  # fmt: skip
    truth = np.linalg.solve(np.eye(n) - gains, offset)
    assert solve_loop(loop, np.zeros(n), 0.0) == pytest.approx(truth, rel=1e-6, abs=1e-9 * np.abs(truth).max())


@pytest.mark.parametrize("seed", range(8))
def test_a_plant_at_rest_that_does_not_say_what_it_feeds_through(tmp_path: Path, seed: int) -> None:
    """dx/dt = u − x from x = 0 behind two gains, with feedback: by compiled code, and by lin."""
    fmu = build_misbehaving(tmp_path, "nothing", "never")
    chance = np.random.default_rng(seed)
    first, second = np.abs(chance.normal(size=2)).tolist()
    system = tmp_path / "loop.toml"
    system.write_text(
        f'components = {{plant = "{fmu}", e = {{sum = "+-"}}, k = {{gain = {first!r}}}, l = {{gain = {second!r}}}}}\n'
        'connections = {"e.u2" = "plant.y", "k.u" = "e.y", "l.u" = "k.y", "plant.u" = "l.y"}\n'
        'inputs.r = "e.u1"\noutputs.y = "plant.y"\n'
    )
    reference, gain = float(chance.normal()), first * second
    with wb.load(system, start_values={"r": reference}, tolerance=1e-9) as model:
        motion = wb.simulate(model, stop=FAST, points=[0.0, FAST], in_process=True)
        linear = wb.lin(model, inputs=["r"], outputs=["y"], in_process=True)
    moved = gain / (1.0 + gain) * -np.expm1(-(1.0 + gain) * FAST) * reference
    assert motion["y"][-1] == pytest.approx(moved, rel=1e-6)
    assert linear.A[0, 0] == pytest.approx(-(1.0 + gain), rel=1e-6)


def test_sampled_parts_in_a_circle_without_delay_are_named(tmp_path: Path) -> None:
    system = tmp_path / "sampled.toml"
    system.write_text(
        'components = {e = {sum = "+-"}, a = {A = [[0.5]], B = [[0.5]], C = [[0.0]], D = [[0.9]], dt = 0.1}}\n'
        'connections = {"e.u2" = "a.y", "a.u" = "e.y"}\ninputs.r = "e.u1"\noutputs.y = "a.y"\n'
    )
    with wb.load(system) as model, pytest.raises(wb.SimulationError, match="e, a act on each other within one sample"):
        wb.simulate(model, stop=0.5, inputs={"r": 1.0}, in_process=True)

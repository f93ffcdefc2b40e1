"""Cycles of random loops with a saturation, against the exact flow, which is linear from switching to switching."""

from __future__ import annotations

import control
import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

from workbench.core.values.arrays import Floats
from workbench.limit_cycles.limit_cycle.request import limit_cycle
from workbench.limit_cycles.limit_cycle.result import LimitCycle
from workbench.system.connect import connect

PARTS = 400  # of a period, between which a switching is looked for


def random_plant(random: np.random.Generator) -> tuple[control.StateSpace, float]:
    """Return a stable plant of order 3 … 5, and the gain from which on the loop oscillates."""
    while True:
        poles = [-(10.0 ** random.uniform(-0.5, 0.7)) for _ in range(int(random.integers(1, 4)))]
        w, zeta = 10.0 ** random.uniform(-0.3, 0.5), random.uniform(0.05, 0.7)
        poles += [w * complex(-zeta, np.sqrt(1.0 - zeta**2)), w * complex(-zeta, -np.sqrt(1.0 - zeta**2))]
        plant = control.tf([1.0], np.real(np.poly(poles)))
        critical = float(control.margin(plant)[0])
        if np.isfinite(critical):
            return control.ss(plant), critical


def exact_period(plant: control.StateSpace, gain: float, x: Floats, period: float) -> tuple[Floats, Floats]:
    """Return the states after a period of x' = Ax − B sat(gain·Cx), and the monodromy matrix."""
    a, b, c = np.asarray(plant.A), np.asarray(plant.B)[:, 0], np.asarray(plant.C)[0]
    n = len(x)

    def flow(mode: float, t: float) -> Floats:
        """Return the flow of (x, 1) where the saturation lets all through (0), or gives ±1."""
        whole = np.zeros((n + 1, n + 1))
        whole[:n, :n] = a - (gain * np.outer(b, c) if mode == 0.0 else 0.0)
        whole[:n, n] = -mode * b
        return np.asarray(expm(whole * t))

    def beyond(t: float, mode: float, z: Floats, level: float) -> float:
        return float(gain * (c @ (flow(mode, t) @ z)[:n]) - level)

    z, phi, left = np.append(x, 1.0), np.eye(n), period
    inside = float(np.clip(gain * (c @ x), -1.0, 1.0))
    mode = inside if abs(inside) == 1.0 else 0.0
    while left > 1e-13 * period:
        step, here = flow(mode, period / PARTS), z
        levels, crossed, k = [1.0, -1.0] if mode == 0.0 else [mode], [], 0
        for k in range(1, PARTS + 2):
            there = step @ here
            crossed = [s for s in levels if (gain * (c @ here[:n]) - s) * (gain * (c @ there[:n]) - s) < 0.0 and k > 1]
            if crossed or k * period / PARTS >= left:
                break
            here = there
        end, mode_after = left, mode
        if crossed:
            begin, s = (k - 1) * period / PARTS, crossed[0]
            end = brentq(beyond, begin, k * period / PARTS, args=(mode, z, s), xtol=1e-14)
            end, mode_after = (end, s if mode == 0.0 else 0.0) if end < left else (left, mode)
        over = flow(mode, end)
        z, phi, left, mode = over @ z, over[:n, :n] @ phi, left - end, mode_after
    return z[:n], phi


@pytest.mark.parametrize("seed", range(8))
def test_the_cycle_of_a_random_loop_closes_exactly(seed: int) -> None:
    random = np.random.default_rng(seed)
    plant, critical = random_plant(random)
    gain = critical * random.uniform(1.1, 6.0)
    with connect(
        {"block": "fmu:Saturation", "plant": plant},
        [("plant.y", "block.u", {"gain": -gain}), ("block.y", "plant.u")],
        start_values={"block.C[1]": 0.0, "block.C[2]": 0.0, "block.D": 1.0},
    ) as system:
        result = limit_cycle(
            system, block="block", methods=("harmonic balance", "shooting"), band=(0.005, 20.0), in_process=True
        )
    cycles: list[LimitCycle] = [c for c in result.limit_cycles if c.method == "shooting"]
    assert cycles
    for cycle in cycles:
        states = cycle.states or {}
        x = np.array([value for name, value in states.items() if name.startswith("plant.")])
        end, phi = exact_period(plant, gain, x, 1.0 / cycle.frequency_hz)
        size = float(np.max(np.abs(x)))
        assert np.max(np.abs(end - x)) < 1e-6 * size
        found = np.linalg.eigvals(phi)
        others = np.delete(found, np.argmin(np.abs(found - 1.0)))
        largest = float(np.max(np.abs(others)))
        assert cycle.multiplier == pytest.approx(largest, rel=1e-2, abs=1e-4)
        assert cycle.stable == (largest < 1.0)

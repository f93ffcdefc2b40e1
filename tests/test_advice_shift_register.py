"""Whether a signal is fixed by a shift register, against sequences whose recurrence is known."""

from __future__ import annotations

import numpy as np
import pytest

from tests.identification_data import DT
from workbench.data.advice.advise import advise
from workbench.data.advice.feedback import from_shift_register, linear_complexity
from workbench.data.experiment.experiment import make_experiment
from workbench.signals.kinds import Prbs


@pytest.mark.parametrize(("order", "hold"), [(5, 1), (9, 1), (11, 3), (15, 1)])
def test_the_order_of_a_shift_register_is_found(order: int, hold: int) -> None:
    """Bits that are held for h samples obey the recurrence of the register in steps of h: h n at most."""
    bits = np.repeat(np.resize(Prbs(hold=1.0, order=order, seed=7).bits(), 600), hold)
    assert linear_complexity(np.asarray(bits, dtype=int).tolist()) <= hold * order
    if hold == 1:
        assert linear_complexity(np.asarray(bits, dtype=int).tolist()) == order
    assert from_shift_register(np.where(bits, 3.0, -1.0))


def test_simple_recurrences() -> None:
    assert linear_complexity([0, 0, 0, 0]) == 0
    assert linear_complexity([1, 1, 1, 1]) == 1  # s(k) = s(k − 1)
    assert linear_complexity([0, 0, 0, 1]) == 4  # nothing shorter makes the 1
    assert linear_complexity([0, 1, 1, 0, 1, 1, 0, 1]) == 2  # s(k) = s(k − 1) + s(k − 2): Fibonacci modulo 2


@pytest.mark.parametrize("seed", range(5))
def test_coins_are_no_shift_register(seed: int) -> None:
    coins = np.random.default_rng(seed).integers(0, 2, 2000)
    assert abs(linear_complexity(coins.tolist()) - 1000) < 20  # the mean is n/2 + 2/9, the variance 86/81 (Rueppel)
    assert not from_shift_register(coins.astype(float))


@pytest.mark.parametrize("period", [7, 20, 101])
def test_a_limit_cycle_of_a_relay_is_no_shift_register(period: int) -> None:
    """It repeats itself, but by no recurrence shorter than half its period, wherever it switches off."""
    for on in range(1, period):
        wave = np.tile(np.repeat([1.0, -1.0], [on, period - on]), 600 // period + 5)
        assert not from_shift_register(wave)


def test_what_is_not_of_two_levels_is_no_shift_register() -> None:
    bits = np.asarray(Prbs(hold=1.0, order=9, seed=1).bits(), dtype=float)
    assert not from_shift_register(bits + 1e-3 * np.random.default_rng(0).standard_normal(len(bits)))
    assert not from_shift_register(np.ones(500))
    assert not from_shift_register(np.concatenate([bits[:200], [1.0 - bits[200]], bits[201:]]))  # one bit turned over


@pytest.mark.parametrize("seed", range(3))
def test_a_relay_that_reacts_within_the_sample_is_never_called_open_loop(seed: int) -> None:
    """u(k) = sign(r(k) − y(k)) with a shift register as r and the noise in y: two levels, and a closed loop."""
    random = np.random.default_rng(seed)
    bits = Prbs(hold=1.0, order=11, seed=3).bits()[:1500]
    r, noise = np.where(bits, 1.0, -1.0), 0.8 * random.standard_normal(1500)
    x, u, y = 0.0, np.zeros(1500), np.zeros(1500)
    for k in range(1500):
        y[k] = x + noise[k]
        u[k] = 1.0 if r[k] > y[k] else -1.0
        x = 0.9 * x + 0.1 * u[k]
    assert advise(make_experiment(DT, u, y)).finding("feedback").verdict != "good"


@pytest.mark.parametrize("seed", range(3))
def test_a_shift_register_through_a_plant_with_feedthrough_is_open_loop(seed: int) -> None:
    """y(k) = 0.5 u(k) + x(k) + white noise, x(k + 1) = 0.9 x(k) + 0.3 u(k); coins in its place leave it unknown."""
    random = np.random.default_rng(seed)
    register = np.where(Prbs(hold=1.0, order=11, seed=seed + 1).bits()[:1500], 1.0, -1.0)
    for u, verdict in ((register, "good"), (random.choice([-1.0, 1.0], 1500), "unknown")):
        x, y = 0.0, np.zeros(1500)
        for k in range(1500):
            y[k] = 0.5 * u[k] + x + 0.5 * random.standard_normal()
            x = 0.9 * x + 0.3 * u[k]
        assert advise(make_experiment(DT, u, y)).finding("feedback").verdict == verdict

"""Systems with several sample rates against their closed form."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from tests.multirate import Node, Rate, System, random_system

ONE = np.ones(1)


def counter(period: Fraction) -> Node:
    """Return y = the number of instants before this one."""
    return Node("b", "matrices", np.eye(1), ONE, ONE, rate=Rate(period))


def test_the_truth_counts() -> None:
    """A counter at 0.1 s that is read every 0.3 s shows 0, 3, 6, …: coinciding samples see each other's new outputs."""
    read = Node("a", "hold", np.zeros((0, 0)), np.zeros(0), np.zeros(0), 1.0, Rate(Fraction(3, 10)))
    system = System((counter(Fraction(1, 10)), read), np.array([[0.0, 0.0], [1.0, 0.0]]), np.array([1.0, 0.0]))
    times = [Fraction(3, 10) * k for k in range(6)]
    assert system.truth.simulate(times)[:, 1].tolist() == [0.0, 3.0, 6.0, 9.0, 12.0, 15.0]
    assert system.basic_period == Fraction(3, 10)


@pytest.mark.parametrize("seed", range(8))
def test_the_truth_agrees_with_itself(seed: int) -> None:
    """The map over a basic period, applied again and again, is where the event simulation goes."""
    system = random_system(seed, fmus=False)
    A, B, C, D = system.truth.period_map()
    T, s = system.basic_period, np.zeros(len(A))
    found = []
    for _ in range(12):
        found.append(C @ s + D)
        s = A @ s + B
    exact = system.truth.simulate([T * k for k in range(12)])
    assert np.allclose(found, exact, rtol=1e-9, atol=1e-12)

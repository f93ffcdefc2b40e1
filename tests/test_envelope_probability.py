"""The probability of a requirement: how often its interval holds, and how many points a width takes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from workbench.study.envelope.probability import probability, samples_for, together, wilson
from workbench.study.envelope.sampling import shares

# -- the interval -------------------------------------------------------------------------------


def test_wilson_solves_its_equation() -> None:
    """The ends are the probabilities at which the estimate is z standard deviations off."""
    for met, n, confidence in ((3, 20, 0.95), (50, 64, 0.9), (1, 1000, 0.99)):
        z = stats.norm.ppf(0.5 + confidence / 2.0)
        for end in wilson(met, n, confidence):
            assert abs(met / n - end) == pytest.approx(z * math.sqrt(end * (1.0 - end) / n), rel=1e-9)
    assert wilson(0, 50, 0.95)[0] == 0.0
    assert wilson(50, 50, 0.95)[1] == 1.0
    assert wilson(0, 0, 0.95) == (0.0, 1.0)


@pytest.mark.parametrize("n", [16, 64, 256])
def test_wilson_covers_with_its_confidence_on_average(n: int) -> None:
    """Exactly, by the binomial distribution: over all probabilities, and nowhere between 0.1 and 0.9 much less."""
    p = np.linspace(0.0005, 0.9995, 1000)
    ends = np.array([wilson(met, n, 0.95) for met in range(n + 1)])
    counts = stats.binom.pmf(np.arange(n + 1)[:, None], n, p)
    inside = (ends[:, :1] <= p) & (p <= ends[:, 1:])
    covered = np.sum(counts * inside, axis=0)
    assert covered.mean() == pytest.approx(0.95, abs=0.01)
    assert covered[(p > 0.1) & (p < 0.9)].min() > 0.92
    assert covered.min() > 0.83  # near 0 and 1, as docs/methods/envelope.md says


# The requirement x·y ≤ c of two uniform parameters is met with the probability c − c ln c.
CUT = 0.3
TRUTH = CUT - CUT * math.log(CUT)


def covered(plan: str, trials: int, points: int) -> float:
    hits = 0
    for seed in range(trials):
        place = shares(plan, points, 2, seed)
        found = probability(None, [bool(m) for m in place[:, 0] * place[:, 1] <= CUT], confidence=0.95, width=None)
        hits += found.low <= TRUTH <= found.high
    return hits / trials


@pytest.mark.parametrize("points", [32, 128])
def test_the_interval_of_independent_points_covers_in_19_of_20_trials(points: int) -> None:
    found = covered("random", 1500, points)
    assert abs(found - 0.95) < 0.02  # three standard deviations of 1500 trials are 0.017


def test_the_interval_of_other_plans_is_too_wide_for_a_smooth_border() -> None:
    """What the page says of them; a promise is made of independent points only."""
    assert covered("latin", 300, 64) >= 0.95
    assert covered("sobol", 300, 64) >= 0.95


def test_what_was_not_measured_widens_the_interval_on_both_sides() -> None:
    found = probability("f", [True] * 6 + [False] * 2 + [None] * 2, confidence=0.95, width=0.1)
    assert (found.low, found.high) == (wilson(6, 10, 0.95)[0], wilson(8, 10, 0.95)[1])
    assert (found.estimate, found.more) == (0.75, None)


def test_failures_with_probabilities_cover_together() -> None:
    weights, truths = [0.7, 0.2, 0.1], [0.9, 0.5, 0.05]
    rng, hits = np.random.default_rng(5), 0
    for _ in range(400):
        passed = [[bool(x) for x in rng.random(40) < t] for t in truths]
        found = together(passed, weights, confidence=0.95)
        hits += bool(found.low <= np.dot(weights, truths) <= found.high)
    assert hits / 400 >= 0.95


# -- how many more ------------------------------------------------------------------------------


@pytest.mark.parametrize("p", [0.0, 0.03, 0.5, 0.9])
@pytest.mark.parametrize("width", [0.5, 0.1, 0.01])
def test_so_many_points_and_no_fewer_give_the_width(p: float, width: float) -> None:
    n = samples_for(p, width, 0.95)

    def wide(m: int) -> float:
        low, high = wilson(p * m, m, 0.95)
        return high - low

    assert wide(n) <= width
    assert n == 1 or wide(n - 1) > width


def test_more_points_are_told_beside_those_there_are() -> None:
    found = probability(None, [True] * 30 + [False] * 10, confidence=0.95, width=0.1)
    assert found.more == samples_for(0.75, 0.1, 0.95) - 40 > 0
    assert probability(None, [True] * 30 + [False] * 10, confidence=0.95, width=0.9).more == 0

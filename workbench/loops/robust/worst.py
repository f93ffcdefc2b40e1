"""Worst cases: parameter sets that are looked for on the uncertain model, and judged by the model linearised there."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence

import numpy as np
from scipy.optimize import minimize

from workbench.core.values.arrays import Floats
from workbench.core.values.linear import Linear
from workbench.core.values.matrices import rounding_of_poles
from workbench.core.values.poles import continuous, damped_frequency_hz, growth_rates, sides
from workbench.loops.robust.family import Place, UncertainFamily
from workbench.loops.robust.result import WorstPlace
from workbench.loops.robust.uncertain import UncertainModel

__all__ = ["destabilising", "is_unstable", "promising", "slowest", "worst_place"]

_CORNERS = 8  # of so many parameters all corners are tried, of more as many at random
_KEPT = 6  # directions that are followed with the model itself
_STEPS = 8  # along each, at a time
_CLOSE = 2e-3  # relative: how near the border an unstable set is
_BELOW = 0.99  # of the smallest unstable set: one that is not smaller than this is no other
_RELATIVE = 1e-7  # of a pole's size: what its distance from the border is known to


def promising(model: UncertainModel, badness: Callable[[Floats], float], *, seed: int = 0) -> list[Floats]:
    """Return shares of the half widths at which the uncertain model is worst, the worst first.

    All corners are tried, or some, and points inside; the best are improved by L-BFGS-B.

    Args:
        model: over a box.
        badness: of a matrix N.
        seed: of random points.
    """
    count = len(model.box.half)
    random = np.random.default_rng(seed)
    if count <= _CORNERS:
        tried = [np.array(s) for s in itertools.product((-1.0, 1.0), repeat=count)]
    else:
        tried = list(random.choice([-1.0, 1.0], (2**_CORNERS, count)))
    tried += list(random.uniform(-1.0, 1.0, (4 * count, count)))

    def good(share: Floats) -> float:
        return -badness(model.matrix(share))

    tried.sort(key=good)
    best = [
        np.asarray(minimize(good, s, method="L-BFGS-B", bounds=[(-1.0, 1.0)] * count, options={"maxiter": 15}).x)
        for s in tried[:2]
    ]
    result: list[Floats] = []
    for share in sorted([*best, *tried[: 2 * _KEPT]], key=good):
        if not any(np.allclose(share, other, atol=1e-3) for other in result):
            result.append(share)
    return result[:_KEPT]


def slowest(matrix: Floats, states: int, dt: float) -> float:
    """Return the growth rate of the slowest pole of N [1/s].

    Args:
        matrix: N = [A B; C D].
        states: number of states.
        dt: period [s]; 0: continuous.
    """
    return float(growth_rates(np.linalg.eigvals(matrix[:states, :states]), dt).max(initial=-math.inf))


def is_unstable(linear: Linear) -> bool:
    """Whether a pole is beyond the border of stability by more than its error."""
    return bool(sides(linear.poles, linear.dt, relative=_RELATIVE, rounding=rounding_of_poles(linear.A))[0].any())


def is_stable(linear: Linear) -> bool:
    """Whether all poles are on the good side of the border by more than their error."""
    outside, border = sides(linear.poles, linear.dt, relative=_RELATIVE, rounding=rounding_of_poles(linear.A))
    return not (outside.any() or border.any())


def destabilising(family: UncertainFamily, shares: Sequence[Floats], least: float, most: float) -> Place | None:
    """Return the smallest deviations found at which the model itself is unstable; None: at none that was tried.

    The model is linearised along each direction, from the size that is proved on, then between the last stable and
    the first unstable one.

    Args:
        family: of linear models.
        shares: directions.
        least: size up to which the model is stable.
        most: largest size.
    """
    best: Place | None = None
    begin = max(least, 0.02 * most)
    for direction in _directions(shares):
        end = most if best is None else _BELOW * _size(best)
        if not begin < end:
            break
        sizes = np.geomspace(begin, end, _STEPS)
        if best is not None:
            sizes = sizes[-1:]  # only what is worse is followed
        models = family.at([tuple(k * direction) for k in sizes])
        first = next((i for i, m in enumerate(models) if m is not None and is_unstable(m)), None)
        if first is None:
            continue
        low, high = float(sizes[first - 1]) if first else least, float(sizes[first])
        while high - low > _CLOSE * high:
            middle = 0.5 * (low + high)
            (linear,) = family.at([tuple(middle * direction)])
            if linear is not None and is_unstable(linear):
                high = middle
            else:
                low = middle
        best = tuple(float(x) for x in high * direction)
    return best


def _directions(shares: Sequence[Floats]) -> list[Floats]:
    """Return the shares with the largest deviation 1, each direction once."""
    result: list[Floats] = []
    for share in shares:
        largest = float(np.abs(share).max(initial=0.0))
        if largest > 0.0 and not any(np.allclose(share / largest, other, atol=1e-2) for other in result):
            result.append(share / largest)
    return result


def _size(place: Place) -> float:
    return max(map(abs, place), default=0.0)


def worst_place(family: UncertainFamily, place: Place) -> WorstPlace:
    """Return what is told of a parameter set.

    Args:
        family: which has a linear model there.
        place: deviations.
    """
    (linear,) = family.at([place])
    if linear is None:
        raise ValueError(place)
    poles = linear.poles
    k = int(np.argmax(growth_rates(poles, linear.dt))) if len(poles) else 0
    pole = complex(poles[k]) if len(poles) else complex("nan")
    frequency = float(damped_frequency_hz(continuous(pole, linear.dt))) if len(poles) else math.nan
    return WorstPlace(
        parameters=family.values(place), size=_size(place), frequency_hz=frequency,
        pole=complex(pole.real, abs(pole.imag)), poles=poles, unstable=is_unstable(linear),
    )  # fmt: skip

"""Plant requirements that exclude each other: whether `tune` names the pair, and says nothing where there is none.

Random loops with a PI or PID controller and six requirements that are computed here from polynomials. Two of them are
given limits that grids over the gains cannot meet together, by a tenth of their scale at least, though each is met by
itself; the limits of the other four leave room beside either one. In as many loops more the limits are those of gains
that exist, and no conflict may be told.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np

from scripts.promises.tune import RandomLoop, best_of_grid, random_loop, tuned_loop
from workbench.core.values.arrays import Floats

__all__ = ["KINDS", "PlantedConflict", "excesses", "feasible", "measures", "named", "planted", "run"]

_ROOM = 0.15  # of its scale: what a requirement has left beside each of the pair
_USABLE = 4.0  # peak of |S|
_APART = 0.1  # of their scales: how far the pair is from being met, at least


def _norm(into: str, out: str) -> dict[str, Any]:
    return {"analysis": "linear", "kind": "h-infinity norm", "inputs": [into], "outputs": [out]}


_T = {"analysis": "linear", "kind": "gain", "input": "r", "output": "y"}
# Name → its table in a study without the limit, whether that is a lower one, and the scale in which a distance from it
# counts; 0: the limit itself, see the page about tuning.
KINDS: Mapping[str, tuple[dict[str, Any], bool, float]] = {
    "robust": ({"analysis": "loop", "kind": "peak sensitivity"}, False, 0.0),
    "disturbance": (_norm("d", "y"), False, 0.0),
    "small": (_norm("r", "u"), False, 0.0),
    "follows": (_T, True, 6.0),
    "quiet": (_T, False, 6.0),
    "quick": ({"analysis": "linear", "kind": "stability"}, False, 0.0),
}
_NAMES = tuple(KINDS)
_LOWER = np.array([-1.0 if lower else 1.0 for _, lower, _ in KINDS.values()])


@dataclass(frozen=True, eq=False)
class PlantedConflict:
    """A loop with requirements.

    Attributes:
        loop: which.
        requirements: of the study.
        pair: that exclude each other; empty: all can be met.
        excess: least value of the worse of the pair over the grids; at most 0: they can be met.
    """

    loop: RandomLoop
    requirements: Mapping[str, Mapping[str, Any]]
    pair: frozenset[str]
    excess: float


def _frequencies(loop: RandomLoop) -> tuple[float, float]:
    """Return where the output is to follow, and where it is to be quiet [Hz]."""
    rate = float(np.exp(np.log(np.abs(np.roots(loop.denominator))).mean())) / (2.0 * np.pi)
    return 0.5 * rate, 4.0 * rate


def measures(loop: RandomLoop, gains: Floats) -> Floats:
    """Return the six numbers in their units, infinite where the loop is unstable, shape (k, 6).

    Args:
        loop: which.
        gains: shape (k, n).
    """
    above, below = loop.polynomials(gains)
    f = np.concatenate([_frequencies(loop), np.geomspace(1e-4, 1e2, 1200)])
    s = 2j * np.pi * f
    plant = np.polyval(loop.numerator, s) / np.polyval(loop.denominator, s)
    result = np.full((len(gains), len(KINDS)), np.inf)
    for k, numerator in enumerate(above):
        poles = np.roots(np.polyadd(np.polymul(below, loop.denominator), np.polymul(numerator, loop.numerator)))
        rightmost = poles.real.max()
        if rightmost < 0.0:
            controller = np.polyval(numerator, s) / np.polyval(below, s)
            inverse = 1.0 / (1.0 + controller * plant)
            db = 20.0 * np.log10(np.abs(controller * plant * inverse)[:2])
            norms = (np.abs(h).max() for h in (inverse, plant * inverse, controller * inverse))
            result[k] = [*norms, *db, rightmost]
    return result


def excesses(found: Floats, limits: Floats) -> Floats:
    """Return distances beyond the limits over their scales, at most 0 where they are met, shape (k, 6).

    Args:
        found: see `measures`.
        limits: shape (6,).
    """
    scales = np.array([scale or abs(limit) for (_, _, scale), limit in zip(KINDS.values(), limits, strict=True)])
    beyond = np.where(np.isfinite(found), _LOWER * (found - limits) / scales, np.inf)
    return np.asarray(beyond, dtype=np.float64)


def _grid(loop: RandomLoop) -> Floats:
    axes = [np.linspace(a, b, 9 if loop.pid else 25) for a, b in zip(np.log(loop.low), np.log(loop.high), strict=True)]
    return np.asarray(np.exp(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))))


def _written(limits: Floats, loop: RandomLoop) -> dict[str, dict[str, Any]]:
    follow, quiet = _frequencies(loop)
    places: dict[str, dict[str, Any]] = {"follows": {"frequency": follow}, "quiet": {"frequency": quiet}}
    return {
        name: {**table, **places.get(name, {}), "min" if lower else "max": float(limit)}
        for (name, (table, lower, _)), limit in zip(KINDS.items(), limits, strict=True)
    }


def _with_room(limits: Floats, room: float) -> Floats:
    """Return limits that are wider by a part of their scales."""
    scales = np.array([scale or abs(limit) for (_, _, scale), limit in zip(KINDS.values(), limits, strict=True)])
    return np.asarray(limits + _LOWER * room * scales, dtype=np.float64)


def _limits(found: Floats, pair: tuple[int, int], random: np.random.Generator) -> Floats | None:
    """Return limits of which a pair excludes each other on a grid, and no other pair; None: it cannot be had."""
    i, j = pair
    own = _LOWER * found  # the less the better
    limits = np.quantile(own, 0.5, axis=0)
    limits[i] = np.quantile(own[:, i], random.uniform(0.05, 0.3))
    inside = own[:, i] <= limits[i]
    beside, alone = own[inside, j].min(), own[:, j].min()
    limits[j] = alone + random.uniform(0.3, 0.6) * (beside - alone)
    others = [k for k in range(len(KINDS)) if k not in pair]
    for p in pair:  # what the others are, mostly, at the half of the gains that meets one of the pair best
        best = own[own[:, p] <= np.quantile(own[own[:, p] <= limits[p], p], 0.5)]
        here = np.quantile(best[:, others], 0.6, axis=0)
        limits[others] = here if p == i else np.maximum(limits[others], here)
    limits = _LOWER * limits
    limits[others] = _with_room(limits, _ROOM)[others]
    beyond = excesses(found, limits)
    apart = {(a, b): float(np.maximum(beyond[:, a], beyond[:, b]).min()) for a, b in combinations(range(len(KINDS)), 2)}
    if apart.pop(pair) <= 1.5 * _APART or max(apart.values()) > -0.5 * _ROOM or beyond.min(axis=0).max() > -0.05:
        return None
    return limits


def planted(number: int) -> PlantedConflict:
    """Return a loop with a pair that excludes each other.

    Args:
        number: of it; seeds all that is random.
    """
    random = np.random.default_rng([number, 47])
    for attempt in range(1000):
        loop = random_loop(4 * (97 * attempt + number) + int(random.integers(3)), 2 + number % 3)
        a, b = sorted(random.choice(len(KINDS), 2, replace=False).tolist())
        found = measures(loop, _grid(loop))
        found = found[np.isfinite(found[:, 0])]
        limits = _limits(found, (a, b), random) if len(found) > 50 else None
        if limits is None:
            continue
        excess, _ = best_of_grid(loop, partial(_worse, loop, limits, (a, b)), 3)
        if excess > _APART:
            return PlantedConflict(loop, _written(limits, loop), frozenset({_NAMES[a], _NAMES[b]}), excess)
    raise ValueError(f"no conflict could be planted with number {number}")


def _worse(loop: RandomLoop, limits: Floats, pair: tuple[int, int], gains: Floats) -> Floats:
    return np.asarray(excesses(measures(loop, gains), limits)[:, list(pair)].max(axis=1))


def feasible(number: int) -> PlantedConflict:
    """Return a loop whose requirements are met by some gains with |S| below 4, a twentieth of their scales to spare.

    At gains that are nearly unstable the set that meets all is a needle, which a local search may not find.

    Args:
        number: of it; seeds all that is random.
    """
    random = np.random.default_rng([number, 48])
    while True:
        loop = random_loop(4 * number + int(random.integers(3)), 2 + number % 3)
        found = measures(loop, _grid(loop))
        found = found[found[:, 0] < _USABLE]
        if len(found):
            limits = _with_room(found[random.integers(len(found))], 0.05)
            excess = float(excesses(found, limits).max(axis=1).min())
            return PlantedConflict(loop, _written(limits, loop), frozenset(), excess)


def named(case: PlantedConflict) -> tuple[frozenset[str], float]:
    """Return which requirements `tune` says to exclude each other, and by how much.

    Args:
        case: loop and requirements.
    """
    found = tuned_loop(case.loop, case.requirements, hard=_NAMES).conflict
    return (frozenset(), 0.0) if found is None else (frozenset(found.requirements), found.excess)


def run(*, cases: int = 20, seed: int = 0) -> int:
    """Measure all of it, and return 1 if a promise is not kept.

    Args:
        cases: loops with a conflict, and as many without.
        seed: number of the first one.
    """
    begin, right, pairs, wide = time.process_time(), 0, set(), 0.0
    for number in range(seed, seed + cases):
        case = planted(number)
        told, excess = named(case)
        right += told == case.pair
        pairs.add(case.pair)
        wide = max(wide, abs(excess - case.excess))
        if told != case.pair:
            print(f"loop {number}: {sorted(case.pair)} exclude each other by {case.excess:.3g}, told: {sorted(told)}")
    silent = 0
    for number in range(seed, seed + cases):
        case = feasible(number)
        told, _ = named(case)
        silent += not told
        if told:
            print(f"loop {number}: can be met, told: {sorted(told)}")
    print(f"{cases} planted conflicts, {len(pairs)} different pairs: the pair is named in {right}; the excess differs "
          f"from that of a grid by {wide:.2g} of its scale at most")  # fmt: skip
    print(f"{cases} sets that can be met: no conflict is told in {silent}; {time.process_time() - begin:.0f} s CPU")
    return int(right < cases or silent < cases)

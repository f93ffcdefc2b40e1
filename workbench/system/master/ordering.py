"""In which order a master steps: Gauss-Seidel, each unit with what those before it have just reached, or Jacobi.

Source: M. Busch, Continuous approximation techniques for co-simulation methods, ZAMM 96 (2016); C. Gomes et al.,
Co-simulation: a survey, ACM Computing Surveys 51 (2018), section 4.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from itertools import permutations

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from workbench.system.master.units import Units

__all__ = ["ORDERS", "Order", "choose_order"]

Order = tuple[tuple[int, ...], ...]  # stages; the units of one stage do not see what the others reach

_MOST_TRIED = 6  # units of one loop: of all their orders the best is taken; beyond that, one after the other
_DIRECT, _SMOOTH = 10.0, 1.0  # what a value from the step before costs: passed straight on, or integrated


def choose_order(wanted: str, units: Units, held: Collection[int] = ()) -> tuple[str, Order]:
    """Return the name of the method and the stages.

    Args:
        wanted: "auto" or a name in `ORDERS`.
        units: what is stepped.
        held: units whose outputs stand still over a step: they go first.
    """
    name = "gauss-seidel" if wanted == "auto" else wanted
    return name, ORDERS[name](units, held)


def _jacobi(units: Units, held: Collection[int]) -> Order:
    """Side by side, but sampled units first: what they hold over a step is known at its start."""
    first = tuple(sorted(held))
    rest = tuple(k for k in range(len(units.units)) if k not in held)
    return tuple(stage for stage in (first, rest) if stage)


def _gauss_seidel(units: Units, held: Collection[int]) -> Order:
    """Units that stop at their own events or hold their outputs first; then along the connections."""
    costs = _costs(units)
    early = [k for k, u in enumerate(units.units) if u.event_mode or k in held]
    rest = [k for k in range(len(units.units)) if k not in early]
    return tuple((k,) for some in (early, rest) for loop in _sorted_loops(some, costs) for k in _best(loop, costs))


# The methods; `auto` takes the first.
ORDERS: Mapping[str, Callable[[Units, Collection[int]], Order]] = {"gauss-seidel": _gauss_seidel, "jacobi": _jacobi}


def _costs(units: Units) -> dict[tuple[int, int], float]:
    """Return what it costs to step the second unit of a pair without knowing what the first one reaches."""
    costs: dict[tuple[int, int], float] = {}
    for i in units.outer():
        pair = units.ends(i)
        costs[pair] = costs.get(pair, 0.0) + (_DIRECT if units.direct[i] else _SMOOTH)
    return costs


def _sorted_loops(numbers: Sequence[int], costs: Mapping[tuple[int, int], float]) -> list[list[int]]:
    """Return the strong components among some units, sources first."""
    if not numbers:
        return []
    place = {k: i for i, k in enumerate(numbers)}
    graph = np.zeros((len(numbers), len(numbers)))
    for a, b in costs:
        if a in place and b in place:
            graph[place[a], place[b]] = 1.0
    count, label = connected_components(csr_matrix(graph), directed=True, connection="strong")
    left = [[numbers[int(i)] for i in np.flatnonzero(label == k)] for k in range(count)]
    ordered: list[list[int]] = []
    while left:
        free = next(c for c in left if not any((a, b) in costs for o in left if o is not c for a in o for b in c))
        left.remove(free)
        ordered.append(free)
    return ordered


def _best(loop: Sequence[int], costs: Mapping[tuple[int, int], float]) -> Sequence[int]:
    """Return the order in which the fewest and mildest values come from the step before."""
    if len(loop) > _MOST_TRIED:
        return loop

    def cost(order: Sequence[int]) -> float:
        return sum(costs.get((a, b), 0.0) for i, b in enumerate(order) for a in order[i + 1 :])

    return min(permutations(loop), key=cost)

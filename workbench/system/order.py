"""In which order the connections of a system are evaluated, from what the components say about feed-through.

A connection must be evaluated after those whose value reaches its source without delay. Connections that reach each
other so are an algebraic loop and are solved together. The rest is sorted into levels; what is on one level is read
and written together, which saves calls.

Source: R. Tarjan, Depth-first search and linear graph algorithms, SIAM J. Comput. 1 (1972), for strong components;
F. Cellier, E. Kofman, Continuous System Simulation, 2006, chapter 7, for their use.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from workbench.fmi.variable import FLOAT_TYPES, Variable
from workbench.fmi.wiring import AlgebraicGroup, Wire, Wiring, wiring

__all__ = ["feeds_through", "plan"]

Graph = NDArray[np.bool_]


def plan(connections: Sequence[Wire], *, parts: int) -> Wiring:
    """Return the connections between so many parts, with their orders of evaluation."""
    graph = _reach(connections)
    moving = [i for i, c in enumerate(connections) if not c.discrete]
    events = _groups(_without_discrete_loops(graph, connections), list(range(len(connections))))
    order, in_circle = _sequence(connections, events, graph, parts)
    continuous = _groups(graph[np.ix_(moving, moving)], moving)
    return wiring(connections, events, continuous, order=order, in_circle=in_circle)


def feeds_through(source: Variable, through: Variable) -> bool:
    """Whether an output depends on an input of the same component without delay; yes if nothing is declared."""
    return source.dependencies is None or through.name in source.dependencies


def _sequence(
    connections: Sequence[Wire], events: Sequence[AlgebraicGroup], graph: Graph, parts: int
) -> tuple[tuple[int, ...], tuple[bool, ...]]:
    """Return in which order parts handle an event, and which are in a circle of them.

    A part comes after those that can change what it sees at that instant. In a circle there is no such order: there
    those are first whose outputs need nothing from the others.
    """
    needed = dict.fromkeys([*(connections[i].from_component for g in events for i in g.members), *range(parts)])
    place = {part: k for k, part in enumerate(needed)}
    acts = np.zeros((parts, parts), dtype=bool)
    for j, c in enumerate(connections):
        acts[place[c.from_component], place[c.to_component]] |= bool(graph[:, j].any()) or not _smooth(c.source)
    label = _components(acts)
    level = _levels(acts, label, int(label.max()) + 1 if len(label) else 0)
    order = sorted(needed, key=lambda part: (level[label[place[part]]], label[place[part]], place[part]))
    alone = np.bincount(label, minlength=1) == 1
    return tuple(order), tuple(bool(acts[k, k] or not alone[label[k]]) for k in (place[p] for p in range(parts)))


def _smooth(source: Variable) -> bool:
    """Whether an output is made of continuous states alone, which an event of others does not move."""
    return source.variability == "continuous" and source.type in FLOAT_TYPES and bool(source.dependencies)


def _reach(connections: Sequence[Wire]) -> Graph:
    """Return where the value of connection i reaches the source of connection j, shape (n, n)."""
    graph = np.zeros((len(connections), len(connections)), dtype=bool)
    by_source: dict[int, list[int]] = {}
    for j, connection in enumerate(connections):
        by_source.setdefault(connection.from_component, []).append(j)
    for i, before in enumerate(connections):
        for j in by_source.get(before.to_component, ()):
            graph[i, j] = feeds_through(connections[j].source, before.destination)
    return graph


def _without_discrete_loops(graph: Graph, connections: Sequence[Wire]) -> Graph:
    """Cut loops at values that are not continuous numbers: the event iteration goes round those until they stand."""
    discrete = np.array([c.discrete for c in connections], dtype=bool)
    label = _components(graph)
    same = label[:, None] == label[None, :]
    kept: Graph = graph & ~(same & (discrete[:, None] | discrete[None, :]))
    return kept


def _components(graph: Graph) -> NDArray[np.int32]:
    """Return a number for each node, the same within a strong component."""
    if not len(graph):
        return np.zeros(0, dtype=np.int32)
    # Slow to import, and every command imports this module.
    from scipy.sparse import csr_matrix  # noqa: PLC0415
    from scipy.sparse.csgraph import connected_components  # noqa: PLC0415

    label: NDArray[np.int32] = connected_components(csr_matrix(graph), directed=True, connection="strong")[1]
    return label


def _groups(graph: Graph, numbers: Sequence[int]) -> list[AlgebraicGroup]:
    """Sort the nodes of `graph`, which are the connections `numbers`, into groups in order of evaluation."""
    label = _components(graph)
    count = int(label.max()) + 1 if len(label) else 0
    members: list[list[int]] = [np.flatnonzero(label == k).tolist() for k in range(count)]
    level = _levels(graph, label, count)
    groups: list[AlgebraicGroup] = []
    for height in range(max(level, default=-1) + 1):
        here = [k for k in range(count) if level[k] == height]
        loops = [k for k in here if len(members[k]) > 1 or graph[members[k][0], members[k][0]]]
        plain = sorted(numbers[i] for k in here if k not in loops for i in members[k])
        if plain:
            groups.append(AlgebraicGroup(tuple(plain)))
        groups += [AlgebraicGroup(tuple(numbers[i] for i in members[k]), loop=True) for k in loops]
    return groups


def _levels(graph: Graph, label: NDArray[np.int32], count: int) -> list[int]:
    """Return for each strong component the longest way to it from one that depends on none."""
    before: list[set[int]] = [set() for _ in range(count)]
    for i, j in zip(*np.nonzero(graph), strict=True):
        if label[i] != label[j]:
            before[label[j]].add(int(label[i]))
    level: dict[int, int] = {}
    while len(level) < count:
        for k in range(count):
            if k not in level and all(b in level for b in before[k]):
                level[k] = 1 + max((level[b] for b in before[k]), default=-1)
    return [level[k] for k in range(count)]

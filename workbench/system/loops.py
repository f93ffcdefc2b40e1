"""The closed loops of a system: components that drive each other through its connections."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse.csgraph import connected_components

from workbench.core.values.closed_loop import ClosedLoop

if TYPE_CHECKING:
    from workbench.system.components import Opened

__all__ = ["closed_loops"]


def closed_loops(opened: Opened, signals: Sequence[str], *, until: float) -> tuple[ClosedLoop, ...]:
    """Return every group of components that drive each other, and what signals have to do with it.

    Components are taken as wholes: a signal at any of their variables counts, whether or not the equations inside pass
    it on.

    Args:
        opened: the system.
        signals: its inputs, outputs, or variables of its components.
        until: connections that close later than that [s] are open.
    """
    count = len(opened.parts)
    graph = np.zeros((count, count), dtype=bool)
    for wire in opened.resolved.wires:
        if wire.closes_at < until:
            graph[wire.from_component, wire.to_component] = True
    reach = _reach(graph)
    _, group = connected_components(graph, directed=True, connection="strong")
    places = {name: _components(opened, name) for name in signals}
    loops = []
    for members in (np.flatnonzero(group == k) for k in dict.fromkeys(group.tolist())):
        first = int(members[0])
        if not reach[first, first]:
            continue
        drives = [n for n, at in places.items() if any(reach[i, first] or i in members for i in at)]
        inside = [n for n, at in places.items() if n not in opened.resolved.inputs and set(at) & set(members.tolist())]
        moved = [n for n, at in places.items() if n not in opened.resolved.inputs and reach[first, list(at)].any()]
        loops.append(
            ClosedLoop(
                system=opened.description.name,
                components=tuple(opened.parts[i].name for i in members.tolist()),
                acting=tuple(drives),
                inside=tuple(inside),
                showing=tuple(moved),
            )
        )
    return tuple(loops)


def _reach(graph: np.ndarray[tuple[int, int], np.dtype[np.bool_]]) -> np.ndarray[tuple[int, int], np.dtype[np.bool_]]:
    """Return which component drives which, over any number of connections (Warshall)."""
    reach = graph.copy()
    for k in range(len(reach)):
        reach |= np.outer(reach[:, k], reach[k])
    return reach


def _components(opened: Opened, name: str) -> tuple[int, ...]:
    """Return the components that a signal belongs to: those that an input of the system drives."""
    if name in opened.resolved.inputs:
        return tuple(port.component for port in opened.resolved.inputs[name])
    if name in opened.resolved.outputs:
        return (opened.resolved.outputs[name].component,)
    return tuple(i for i, part in enumerate(opened.parts) if name.startswith(f"{part.name}."))

"""What a master steps: each co-simulation component by itself, model exchange components that are connected as one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from workbench.fmi.description import DefaultExperiment, ModelDescription
from workbench.fmi.variable import FLOAT_TYPES, Variable
from workbench.fmi.wiring import Wire
from workbench.system.components import OpenComponent
from workbench.system.composite import Ports
from workbench.system.description import Port, Resolved, SystemDescription
from workbench.system.joint_description import joint_description, joint_ports
from workbench.system.order import feeds_through

__all__ = ["MasterUnit", "ModelExchangeGroup", "Units", "find_units", "moves"]


@dataclass(frozen=True, eq=False)
class ModelExchangeGroup:
    """Model exchange components that are one ordinary differential equation.

    Attributes:
        connections: those between them, numbered by their places in the group.
        description: of the group; its inputs are those that come from outside, by full name.
        ports: its variables' places.
    """

    connections: tuple[Wire, ...]
    description: ModelDescription
    ports: Ports


@dataclass(frozen=True, eq=False)
class MasterUnit:
    """What is stepped as one.

    Attributes:
        name: of the component; of a group, the names of all with " + " between them.
        members: its components' numbers.
        incoming, outgoing: numbers of the connections from and to other units.
        group: None for a co-simulation component.
        event_mode: it stops by itself at its events.
    """

    name: str
    members: tuple[int, ...]
    incoming: tuple[int, ...]
    outgoing: tuple[int, ...]
    group: ModelExchangeGroup | None
    event_mode: bool


@dataclass(frozen=True, eq=False)
class Units:
    """All of them.

    Attributes:
        units: in the components' order.
        of: component → its unit's number, shape (number of components,).
        connections: of the whole system.
        direct: connection → those out of its destination's unit that it reaches without time passing.
    """

    units: tuple[MasterUnit, ...]
    of: tuple[int, ...]
    connections: tuple[Wire, ...]
    direct: Mapping[int, frozenset[int]]

    def outer(self) -> list[int]:
        """Return the connections between different units."""
        return [i for u in self.units for i in u.incoming]

    def ends(self, connection: int) -> tuple[int, int]:
        """Return the units that a connection leads from and to."""
        c = self.connections[connection]
        return self.of[c.from_component], self.of[c.to_component]


def moves(variable: Variable) -> bool:
    """Whether a variable can change between events."""
    return variable.type in FLOAT_TYPES and variable.variability == "continuous"


def find_units(parts: Sequence[OpenComponent], connections: Sequence[Wire], resolved: Resolved) -> Units:
    """Divide a system.

    Args:
        parts: its components.
        connections: between them.
        resolved: its inputs and outputs.
    """
    label = _labels(parts, connections)
    numbers = {root: k for k, root in enumerate(dict.fromkeys(label))}
    of = tuple(numbers[root] for root in label)
    units = tuple(_unit(k, of, parts, connections, resolved) for k in range(len(numbers)))
    return Units(units, of, tuple(connections), _direct(of, connections))


def _labels(parts: Sequence[OpenComponent], connections: Sequence[Wire]) -> list[int]:
    """Return a number for each component, the same for those that are one equation."""
    joined = np.zeros((len(parts), len(parts)))
    for c in connections:
        if parts[c.from_component].interface == parts[c.to_component].interface == "me":
            joined[c.from_component, c.to_component] = 1.0
    label: list[int] = connected_components(csr_matrix(joined), directed=False)[1].tolist()
    return label


def _unit(
    number: int, of: Sequence[int], parts: Sequence[OpenComponent], connections: Sequence[Wire], resolved: Resolved
) -> MasterUnit:
    members = tuple(i for i, k in enumerate(of) if k == number)
    first = parts[members[0]]
    crossing = [i for i, c in enumerate(connections) if of[c.from_component] != of[c.to_component]]
    incoming = tuple(i for i in crossing if of[connections[i].to_component] == number)
    is_group = first.interface == "me"
    return MasterUnit(
        name=" + ".join(parts[i].name for i in members),
        members=members,
        incoming=incoming,
        outgoing=tuple(i for i in crossing if of[connections[i].from_component] == number),
        group=_group(members, parts, connections, incoming, resolved) if is_group else None,
        event_mode=not is_group and first.description.interfaces["cs"].event_mode,
    )


def _group(
    members: Sequence[int],
    parts: Sequence[OpenComponent],
    connections: Sequence[Wire],
    incoming: Sequence[int],
    resolved: Resolved,
) -> ModelExchangeGroup:
    place = {component: k for k, component in enumerate(members)}
    inner = tuple(
        replace(c, from_component=place[c.from_component], to_component=place[c.to_component])
        for c in connections
        if {c.from_component, c.to_component} <= place.keys()
    )
    ends = [(connections[i].to_component, connections[i].destination) for i in incoming]
    ends += [(p.component, p.variable) for ports in resolved.inputs.values() for p in ports if p.component in place]
    inputs = {f"{parts[i].name}.{v.name}": (Port(place[i], v),) for i, v in ends}
    mine = [parts[i] for i in members]
    seen = Resolved(wires=inner, inputs=inputs, outputs={})
    described = SystemDescription(
        name=" + ".join(p.name for p in mine),
        components=tuple(p.component for p in mine),
        default_experiment=DefaultExperiment(),
    )
    return ModelExchangeGroup(inner, joint_description(described, mine, seen), joint_ports(mine, seen))


def _direct(of: Sequence[int], connections: Sequence[Wire]) -> dict[int, frozenset[int]]:
    """Return for each connection between units those that leave the unit it enters and show it without delay."""
    n = len(connections)
    after = [
        [
            j
            for j, d in enumerate(connections)
            if d.from_component == c.to_component and feeds_through(d.source, c.destination)
        ]
        for c in connections
    ]
    crosses = [of[c.from_component] != of[c.to_component] for c in connections]
    return {i: frozenset(_reached(i, after, crosses)) for i in range(n) if crosses[i]}


def _reached(start: int, after: Sequence[Sequence[int]], crosses: Sequence[bool]) -> set[int]:
    """Return the crossing connections that follow `start` along those inside the unit."""
    result, waiting, seen = set[int](), [start], {start}
    while waiting:
        for j in after[waiting.pop()]:
            if crosses[j]:
                result.add(j)
            elif j not in seen:
                seen.add(j)
                waiting.append(j)
    return result

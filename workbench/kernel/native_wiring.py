"""The connections of a system as the kernel's structures; the arrays are those of the wiring."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workbench.fmi.instance import Instance
from workbench.fmi.variable import Variable
from workbench.fmi.wiring import AlgebraicGroup, Wire, Wiring
from workbench.kernel.native_access import join_access, native_access
from workbench.kernel.structs import Access, Link, System, Wires

__all__ = ["native_wiring"]

_DOUBLES = ("Real", "Float64")
_VECTORS = 7  # see `loop_doubles` in algebraic.c


def native_wiring(system: System, instances: Sequence[Instance], wiring: Wiring) -> object:
    """Put `wiring` into `system`; returns what must live as long as it."""
    kept: list[Any] = [wiring]
    memory = iter(range(len(wiring.known)))
    moving = [_link(instances, wiring, g, next(memory) if g.loop else -1, kept) for g in wiring.continuous]
    links = [_link(instances, wiring, g, next(memory) if g.loop else -1, kept) for g in wiring.events]
    for name, result in (("moving", moving), ("links", links)):
        array = (Link * max(len(result), 1))(*result)
        kept.append(array)
        setattr(system, name, ctypes.addressof(array))
        setattr(system, f"n_{name}", len(result))
    system.wires = _wires(wiring, kept)
    order = np.array(wiring.order, dtype=np.uintp)
    kept.append(order)
    system.order = order.ctypes.data
    return kept


def _wires(wiring: Wiring, kept: list[Any]) -> Wires:
    connections = wiring.connections
    numbers = {
        "gains": [c.gain for c in connections],
        "offsets": [c.offset for c in connections],
        "closes_at": [c.closes_at for c in connections],
        "typical": [abs(c.destination.nominal or 1.0) for c in connections],
        "fresh": [0.0] * len(connections),
    }
    arrays: dict[str, NDArray[Any]] = {name: np.array(values) for name, values in numbers.items()}
    arrays["to"] = np.array([c.to_component for c in connections], dtype=np.int32)
    kept.append(arrays)
    arrays |= {"values": wiring.values, "sizes": wiring.sizes, "seen": wiring.seen, "closed": wiring.closed}
    return Wires(n=len(connections), **{name: a.ctypes.data for name, a in arrays.items()})


def _link(instances: Sequence[Instance], wiring: Wiring, group: AlgebraicGroup, memory: int, kept: list[Any]) -> Link:
    connections = [wiring.connections[i] for i in group.members]
    members = np.array(group.members, dtype=np.uintp)
    link = Link(
        source=_access(instances, [(c.from_component, c.source) for c in connections], group, kept),
        destination=_access(instances, [(c.to_component, c.destination) for c in connections], group, kept),
        members=members.ctypes.data,
        n=len(members),
    )
    kept.append(members)
    if group.loop:
        n = len(members)
        work = np.zeros(_VECTORS * n + n * n)
        kept.append(work)
        link.work = work.ctypes.data
        link.jacobian = wiring.jacobians[memory].ctypes.data
        link.known = wiring.known[memory:].ctypes.data
        _offer_derivatives(link, instances, connections, kept)
    return link


def _offer_derivatives(link: Link, instances: Sequence[Instance], connections: Sequence[Wire], kept: list[Any]) -> None:
    """Let the kernel use directional derivatives of the components that claim them, once it has found them true."""
    exact = [_claims(instances[c.to_component]) for c in connections]
    ends = [(c.from_component, c.source) for c in connections] + [(c.to_component, c.destination) for c in connections]
    scalar = all(v.type in _DOUBLES and v.value_reference not in instances[k].description.shapes for k, v in ends)
    if not any(exact) or not scalar:
        return
    arrays: dict[str, NDArray[Any]] = {
        "from": np.array([c.from_component for c in connections], dtype=np.int32),
        "to": np.array([c.to_component for c in connections], dtype=np.int32),
        "unknowns": np.array([c.source.value_reference for c in connections], dtype=np.uint32),
        "knowns": np.array([c.destination.value_reference for c in connections], dtype=np.uint32),
        "asked": np.zeros(len(connections), dtype=np.uint32),
        "exact": np.array(exact, dtype=np.int32),
    }
    kept.append(arrays)
    for name, array in arrays.items():
        setattr(link, name, array.ctypes.data)


def _claims(instance: Instance) -> bool:
    """Whether a component offers directional derivatives."""
    return instance.capabilities.directional_derivatives


def _access(
    instances: Sequence[Instance], wanted: Sequence[tuple[int, Variable]], group: AlgebraicGroup, kept: list[Any]
) -> Access:
    """Return access to variables of several components, in columns that are the connections' numbers."""
    parts = []
    for number in dict.fromkeys(n for n, _ in wanted):
        places = [i for i, (n, _) in enumerate(wanted) if n == number]
        access = instances[number].access([wanted[i][1] for i in places])
        parts.append(native_access(access, columns=[group.members[i] for i in places], component=number))
    native, owned = join_access(parts)
    kept.append(owned)
    return native

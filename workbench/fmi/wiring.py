"""How several instances are connected: what the façade of a system hands to those who evaluate it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from workbench.core.values.arrays import Floats
from workbench.core.values.calendar import is_due
from workbench.fmi.variable import FLOAT_TYPES, Variable

__all__ = ["AlgebraicGroup", "Wire", "Wiring", "wiring"]


@dataclass(frozen=True)
class Wire:
    """A connection that was checked, units converted: destination = gain · source + offset.

    Attributes:
        source, destination: the variables, as their FMUs name them.
        from_component, to_component: their parts' numbers.
        gain, offset: factor and constant.
        closes_at: time [s] from which on it passes values; the destination sees 0 before.
        ends: names of source and destination in the system, "component.variable".
    """

    source: Variable
    destination: Variable
    from_component: int
    to_component: int
    gain: float = 1.0
    offset: float = 0.0
    closes_at: float = -math.inf
    ends: tuple[str, str] = ("", "")

    @property
    def label(self) -> str:
        """How messages name it."""
        return " → ".join(self.ends)

    @property
    def discrete(self) -> bool:
        """Whether its value can change at events only."""
        source = self.source
        moves = source.type in FLOAT_TYPES and source.variability not in ("discrete", "fixed", "constant", "tunable")
        return not (moves and self.destination.is_continuous_input)


@dataclass(frozen=True)
class AlgebraicGroup:
    """Connections that are evaluated together.

    Attributes:
        members: numbers of the connections.
        loop: they depend on each other without delay: their values are solved for.
    """

    members: tuple[int, ...]
    loop: bool = False


@dataclass(frozen=True, eq=False)
class Wiring:
    """Connections, the order in which they are evaluated, and the values on them.

    The arrays are shared: Python and the kernel work on the same memory, so that a saved state taken in Python holds
    for both.

    Attributes:
        connections: n of them.
        events: groups in the order of evaluation at events.
        continuous: the same in continuous time: those whose values can change there.
        values: what the destinations see, shape (n,).
        sizes: largest magnitude each value has had, shape (n,).
        closed: 1 where the connection passes values, shape (n,).
        jacobians: ∂(residual)/∂(value) of each loop of `continuous`, then of `events`, shape (m, m) each.
        known: 1 where that Jacobian can be used, shape (number of loops,).
        order: the parts, those first whose outputs the others need: in this order they handle an event.
        in_circle: whether what a part shows at an instant may change what it sees there.
        seen: what each destination saw when its part last handled an event, shape (n,).
    """

    connections: tuple[Wire, ...]
    events: tuple[AlgebraicGroup, ...]
    continuous: tuple[AlgebraicGroup, ...]
    values: Floats
    sizes: Floats
    closed: NDArray[np.int32]
    jacobians: tuple[Floats, ...]
    known: NDArray[np.int32]
    order: tuple[int, ...]
    in_circle: tuple[bool, ...]
    seen: Floats

    def switch(self, time: float) -> None:
        """Close what is due at `time` [s]; only at events."""
        self.closed[:] = [is_due(c.closes_at, time) for c in self.connections]

    def switches_after(self, time: float) -> list[float]:
        """Return when connections close after `time` [s]."""
        return [c.closes_at for c in self.connections if not is_due(c.closes_at, time)]

    def forget(self) -> None:
        """Drop the Jacobians: what is computed next must not depend on the past."""
        self.known[:] = 0

    def anew(self) -> Wiring:
        """Return the same connections in the same order, with values of their own."""
        return wiring(self.connections, self.events, self.continuous, order=self.order, in_circle=self.in_circle)

    def loops(self) -> list[AlgebraicGroup]:
        """Return the loops in the order of `jacobians`."""
        return [g for g in (*self.continuous, *self.events) if g.loop]


def wiring(
    connections: Sequence[Wire],
    events: Sequence[AlgebraicGroup],
    continuous: Sequence[AlgebraicGroup],
    *,
    order: tuple[int, ...],
    in_circle: tuple[bool, ...],
) -> Wiring:
    """Return a wiring with all values at zero and all Jacobians to be found."""
    n = len(connections)
    loops = [g for g in (*continuous, *events) if g.loop]
    return Wiring(
        connections=tuple(connections),
        events=tuple(events),
        continuous=tuple(continuous),
        values=np.zeros(n),
        sizes=np.zeros(n),
        closed=np.ones(n, dtype=np.int32),
        jacobians=tuple(np.zeros((len(g.members), len(g.members))) for g in loops),
        known=np.zeros(len(loops), dtype=np.int32),
        order=order,
        in_circle=in_circle,
        seen=np.zeros(n),
    )

"""Exact derivatives of a system from those of its parts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.errors import SimulationError
from workbench.fmi.instance import Instance
from workbench.fmi.variable import Variable
from workbench.fmi.wiring import AlgebraicGroup, Wire, Wiring
from workbench.system.order import feeds_through

__all__ = ["SystemJacobian"]

Port = tuple[int, Variable]


class SystemJacobian:
    """How derivatives and outputs of a system move when states and inputs move: the chain rule along the connections.

    With s the movement of the connected values, s_i = gain_i · Σ ∂source_i/∂(what moves), group by group; in an
    algebraic loop (I − K) s = s_free, with K measured column by column.

    Args:
        parts: the components, in continuous time.
        wiring: their connections.
    """

    def __init__(self, parts: Sequence[Instance], wiring: Wiring) -> None:
        self._parts = parts
        self._wiring = wiring

    def along(self, moved: Sequence[tuple[Port, float]], wanted: Sequence[Port]) -> Floats:
        """Return the movement of `wanted`, shape (len(wanted),), when `moved` move by their seeds."""
        seeds: list[dict[str, tuple[Variable, float]]] = [{} for _ in self._parts]
        for (number, variable), seed in moved:
            seeds[number][variable.name] = (variable, seed)
        for group in self._wiring.continuous:
            self._pass_on(group, seeds)
        result = np.zeros(len(wanted))
        for number, own in enumerate(seeds):
            # All of a part at once: one product of matrices, or one call of the FMU.
            own_rows = [i for i, (owner, v) in enumerate(wanted) if owner == number and v.name not in own]
            if own and own_rows:
                result[own_rows] = self._of_part(number, [wanted[i][1] for i in own_rows], own)
        for i, (owner, variable) in enumerate(wanted):
            if variable.name in seeds[owner]:
                result[i] = seeds[owner][variable.name][1]
        return result

    def _pass_on(self, group: AlgebraicGroup, seeds: list[dict[str, tuple[Variable, float]]]) -> None:
        connections = [self._wiring.connections[i] for i in group.members]
        if group.loop:
            moves = self._loop(connections, seeds)
        else:
            moves = np.array([self._through(c, seeds) for c in connections])
        for connection, move in zip(connections, moves, strict=True):
            destination = connection.destination
            seeds[connection.to_component][destination.name] = (destination, float(move))

    def _loop(self, connections: Sequence[Wire], seeds: list[dict[str, tuple[Variable, float]]]) -> Floats:
        free = np.array([self._through(c, seeds) for c in connections])
        gains = np.zeros((len(connections), len(connections)))
        for j, before in enumerate(connections):
            one: list[dict[str, tuple[Variable, float]]] = [{} for _ in self._parts]
            one[before.to_component][before.destination.name] = (before.destination, 1.0)
            for i, after in enumerate(connections):
                if after.from_component == before.to_component and feeds_through(after.source, before.destination):
                    gains[i, j] = self._through(after, one)
        try:
            return np.linalg.solve(np.eye(len(connections)) - gains, free)
        except np.linalg.LinAlgError:
            names = ", ".join(c.label for c in connections)
            raise SimulationError(f"the algebraic loop through {names} has a gain of 1: it has no derivative") from None

    def _through(self, connection: Wire, seeds: list[dict[str, tuple[Variable, float]]]) -> float:
        number = self._wiring.connections.index(connection)
        if not self._wiring.closed[number]:
            return 0.0
        return connection.gain * self._one((connection.from_component, connection.source), seeds)

    def _one(self, port: Port, seeds: Sequence[dict[str, tuple[Variable, float]]]) -> float:
        number, variable = port
        own = seeds[number]
        if variable.name in own:
            return own[variable.name][1]
        return float(self._of_part(number, [variable], own)[0]) if own else 0.0

    def _of_part(self, number: int, wanted: Sequence[Variable], own: dict[str, tuple[Variable, float]]) -> Floats:
        knowns, seeds = [v for v, _ in own.values()], [seed for _, seed in own.values()]
        return np.asarray(self._parts[number].directional_derivative(wanted, knowns, seeds), dtype=np.float64)

"""Passing values on along connections, group by group, loops solved on the way: the readable reference.

The compiled twin is workbench/kernel/system.c.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.errors import SimulationError
from workbench.fmi.access import VariableAccess
from workbench.fmi.instance import Instance
from workbench.fmi.variable import Variable
from workbench.fmi.wiring import AlgebraicGroup, Wiring
from workbench.session.algebraic_error import too_early
from workbench.session.forcing import convert
from workbench.system.algebraic import AlgebraicLoop, solve_loop

__all__ = ["Propagation"]

_SAME = 1e-8  # relative: what FMUs that iterate inside may differ by when asked again
_ENOUGH = 64  # evaluations in continuous time, after which the order of the connections is believed
_Part = tuple[VariableAccess, list[int]]  # of one component, and where its variables stand in the group


class Propagation:
    """Reads sources, writes destinations.

    Args:
        parts: the components.
        wiring: their connections.
    """

    def __init__(self, parts: Sequence[Instance], wiring: Wiring) -> None:
        self._parts = parts
        self._wiring = wiring
        memory = iter(range(len(wiring.known)))
        self._continuous = [_Bundle(parts, wiring, g, next(memory) if g.loop else -1) for g in wiring.continuous]
        self._ordered = 0
        self._at_events = [_Bundle(parts, wiring, g, next(memory) if g.loop else -1) for g in wiring.events]

    def run(self, time: float, *, events: bool, initial: bool = False) -> None:
        """Pass on all values that may have changed.

        Args:
            time: for messages [s].
            events: at events: all of them.
            initial: before initialisation has ended; FMI 1.0 has no outputs then.

        Raises:
            SimulationError: a value is not finite, a loop has no solution, or an output depends on an input that its
                FMU does not declare.
        """
        for bundle in self._at_events if events else self._continuous:
            if not (initial and bundle.old):
                bundle.run(time)
        if not events and self._ordered < _ENOUGH:
            self._ordered += 1
            for bundle in self._continuous:
                bundle.check_order()


class _Bundle:
    """One group, with prepared access.

    Attributes:
        old: some source is an FMI 1.0 FMU.
    """

    def __init__(self, parts: Sequence[Instance], wiring: Wiring, group: AlgebraicGroup, memory: int) -> None:
        self._wiring = wiring
        self._members = np.array(group.members, dtype=int)
        connections = [wiring.connections[i] for i in group.members]
        self._gains = np.array([c.gain for c in connections])
        self._offsets = np.array([c.offset for c in connections])
        self._sources = _accesses(parts, [(c.from_component, c.source) for c in connections])
        self._destinations = _accesses(parts, [(c.to_component, c.destination) for c in connections])
        self._labels = [c.label for c in connections]
        self._typical = np.array([abs(c.destination.nominal or 1.0) for c in connections])
        self._memory = memory
        self._time = 0.0
        self.old = any(parts[c.from_component].version == 1 for c in connections)

    def run(self, time: float) -> None:
        self._time = time
        values, sizes = self._wiring.values, self._wiring.sizes
        if self._memory < 0:
            values[self._members] = self._read()
            self._write(values[self._members])
            return
        own = sizes[self._members]
        loop = AlgebraicLoop(
            respond=self._respond,
            labels=self._labels,
            sizes=own,
            typical=self._typical,
            jacobian=self._wiring.jacobians[self._memory],
            known=self._wiring.known[self._memory : self._memory + 1],
        )
        values[self._members] = solve_loop(loop, values[self._members], time)
        sizes[self._members] = own

    def check_order(self) -> None:
        """Raise where a value passed on is no longer its source's: an input that moves it came later."""
        if self._memory >= 0:
            return
        was, now = self._wiring.values[self._members], self._read()
        moved = np.flatnonzero(np.abs(now - was) > _SAME * (np.abs(now) + np.abs(was) + self._typical))
        if len(moved):
            raise too_early(self._labels[moved[0]], self._time)

    def _respond(self, values: Floats) -> Floats:
        self._write(values)
        return self._read(finite=False)

    def _read(self, *, finite: bool = True) -> Floats:
        """Return what the destinations are to see."""
        raw = np.empty(len(self._members))
        for access, places in self._sources:
            raw[places] = access.read()
        values: Floats = np.where(self._wiring.closed[self._members] > 0, self._gains * raw + self._offsets, 0.0)
        if finite and not np.isfinite(values).all():
            bad = int(np.flatnonzero(~np.isfinite(values))[0])
            raise SimulationError(f"{self._labels[bad]} passes {values[bad]:g}, not a finite number", time=self._time)
        return values

    def _write(self, values: Floats) -> None:
        for access, places in self._destinations:
            access.write([convert(v, float(values[i])) for v, i in zip(access.variables, places, strict=True)])


def _accesses(parts: Sequence[Instance], wanted: Sequence[tuple[int, Variable]]) -> list[_Part]:
    result = []
    for number in dict.fromkeys(n for n, _ in wanted):
        places = [i for i, (n, _) in enumerate(wanted) if n == number]
        result.append((parts[number].access([wanted[i][1] for i in places]), places))
    return result

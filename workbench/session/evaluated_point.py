"""Where a model exchange instance stands: states and inputs at one instant, every relation evaluated there."""

from __future__ import annotations

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.errors import InputError
from workbench.fmi.instance import EventInfo, Instance
from workbench.fmi.variable import Variable
from workbench.session.forcing import convert

__all__ = ["Stand", "named_states"]


class Stand:
    """Takes an instance in continuous time elsewhere without time passing.

    States and continuous inputs can be set in continuous time; the other inputs at events only. In continuous time an
    FMU keeps its relations (which branch of an `if`), so an event has to follow before they are those of the new place.

    Args:
        instance: of model exchange.

    Attributes:
        inputs: those that are numbers, m of them.
        slow: which of them may change at events only.
    """

    def __init__(self, instance: Instance) -> None:
        self._instance = instance
        known = instance.description.variables
        self.inputs = tuple(v for v in known if v.causality == "input" and v.type in instance.TYPES and v.is_number)
        fast = [i for i, v in enumerate(self.inputs) if v.is_continuous_input]
        self.slow = [i for i, v in enumerate(self.inputs) if not v.is_continuous_input]
        self._access = instance.access(self.inputs)
        self._writers = [(part, instance.access([self.inputs[i] for i in part])) for part in (fast, self.slow)]

    @property
    def has_relations(self) -> bool:
        """Whether an event could change anything."""
        return self._instance.nz > 0 or bool(self.slow)

    def read(self) -> tuple[Floats, Floats]:
        """Return states, shape (n,), and inputs, shape (m,)."""
        self._instance.get_states()
        values = self._access.read() if self.inputs else []
        return self._instance.x.copy(), np.array([float(v) for v in values], dtype=np.float64)

    def put(self, time: float, x: Floats, u: Floats) -> None:
        """Set time [s], states and continuous inputs."""
        instance = self._instance
        if len(x) != instance.nx or len(u) != len(self.inputs):
            raise InputError(f"{instance.nx} states and {len(self.inputs)} inputs are needed")
        instance.set_time(time)
        instance.x[:] = x
        instance.set_states()
        self._write(0, u)

    def event(self, u: Floats) -> EventInfo:
        """Set the other inputs and evaluate every relation where the instance stands."""
        self.enter(u)
        info = self._instance.iterate_events()
        self._instance.enter_continuous_mode()
        return info

    def enter(self, u: Floats) -> None:
        """Enter event mode and set the other inputs."""
        self._instance.enter_event_mode()
        self._write(1, u)

    def _write(self, which: int, u: Floats) -> None:
        indices, access = self._writers[which]
        if indices:
            access.write([convert(self.inputs[i], float(u[i])) for i in indices])


def named_states(instance: Instance) -> tuple[Variable, ...]:
    """Return the states in the order of the state vector; FMI 1.0 does not name them."""
    states = instance.description.states
    if len(states) == instance.nx:
        return states
    return tuple(Variable(name=f"state[{i}]") for i in range(1, instance.nx + 1))

"""Model exchange components of a mixed system under one façade; they are made and initialised by the master."""

# ruff: noqa: ANN401 - saved states have no type
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workbench.fmi.instance import NO_EVENT, EventInfo, Instance
from workbench.system.composite import CompositeInstance
from workbench.system.master.units import ModelExchangeGroup
from workbench.system.order import plan

__all__ = ["GroupInstance"]


@dataclass(frozen=True, eq=False)
class _GroupState:
    """What stands on the connections of a group; its components are saved by the master."""

    values: NDArray[np.float64]
    sizes: NDArray[np.float64]
    closed: NDArray[np.int32]


class GroupInstance(CompositeInstance):
    """A composite of components that belong to the master: they are not started, saved or closed here.

    Args:
        parts: of the group, the master's own.
        group: how they are connected.

    Attributes:
        settled: what the last joint event iteration ended with.
    """

    def __init__(self, parts: Sequence[Instance], group: ModelExchangeGroup) -> None:
        wiring = plan(group.connections, parts=len(parts))
        super().__init__(parts, wiring, group.description, group.ports, source=group.description.model_name)
        self.settled = NO_EVENT
        self._first = True

    def enter_initialisation(self, start_time: float, tolerance: float | None) -> None:
        self.time = start_time
        self._wiring.switch(start_time)

    def exit_initialisation(self) -> None:
        self._size_buffers(sum(p.nx for p in self.parts), sum(p.nz for p in self.parts))
        self.touch()

    def iterate_events(self) -> EventInfo:
        """Iterate, but not at the start: the master has done it, with all others."""
        if self._first:
            self._first = False
            return self.settled
        return super().iterate_events()

    def close(self) -> None:
        self._closed = True

    def get_state(self) -> Any:
        wiring = self._wiring
        return _GroupState(wiring.values.copy(), wiring.sizes.copy(), wiring.closed.copy())

    def set_state(self, state: Any) -> None:
        wiring = self._wiring
        wiring.values[:], wiring.sizes[:], wiring.closed[:] = state.values, state.sizes, state.closed
        wiring.forget()
        self._events = False
        self.touch()

    def free_state(self, state: Any) -> None:
        """There is nothing to free."""

"""Sessions on a group of model exchange components whose events at communication points are the master's affair."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence

from workbench.core.values.arrays import Floats
from workbench.kernel.structs import Me
from workbench.session.base import Recorded, Snapshot
from workbench.session.compiled import CompiledMeSession
from workbench.session.me import MeSession
from workbench.signals.kinds import Signal

__all__ = ["CompiledGroupSession", "GroupSession"]


class GroupSession(MeSession):
    """What the master uses of them."""

    def advance(
        self,
        until: float,
        *,
        signals: Mapping[str, Signal],
        record: Sequence[str] = (),
        points: Floats | None = None,
    ) -> Recorded:
        found = super().advance(until, signals=signals, record=record, points=points)
        del self._calls[:-1]  # replay begins with the master
        return found

    def snapshot(self) -> Snapshot:
        found = super().snapshot()
        self._states.clear()  # there is nothing to free
        return found

    @abstractmethod
    def due(self) -> float:
        """Return the time of the next time event [s]."""

    @abstractmethod
    def go_on(self, next_time: float, inputs: Mapping[str, float]) -> None:
        """Start the solver anew after an event that the master made.

        Args:
            next_time: of the next time event [s].
            inputs: what the components see now.
        """

    def _take(self, inputs: Mapping[str, float]) -> None:
        """Note what the components see now."""
        self._seen.update(inputs)
        self.forcing.written = [self._seen[n] for n in self.forcing.names]


class CompiledGroupSession(GroupSession, CompiledMeSession):
    """`GroupSession` with its loop and its solver in compiled code."""

    @property
    def native(self) -> Me:
        """The kernel's session, which the kernel's master steps."""
        return self._native

    def due(self) -> float:
        return float(self._native.next_time)

    def go_on(self, next_time: float, inputs: Mapping[str, float]) -> None:
        self._take(inputs)
        self._native.next_time = next_time
        self._forget()

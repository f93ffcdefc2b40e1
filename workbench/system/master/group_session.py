"""Sessions on a group of model exchange components whose events at communication points are the master's affair."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

from workbench.session.base import Floats, Record, Snapshot
from workbench.session.compiled import CompiledMeSession
from workbench.session.me import MeSession
from workbench.signals import Signal

__all__ = ["GROUP_SESSIONS", "GroupSession"]


class GroupSession(Protocol):
    """What the master uses of them.

    Attributes:
        time: [s].
    """

    time: float

    def advance(
        self,
        until: float,
        *,
        signals: Mapping[str, Signal],
        record: Sequence[str] = (),
        points: Floats | None = None,
    ) -> Record: ...

    def snapshot(self) -> Snapshot: ...

    def restore(self, snapshot: Snapshot) -> None: ...

    def close(self) -> None: ...

    def due(self) -> float:
        """Return the time of the next time event [s]."""
        ...

    def go_on(self, next_time: float, inputs: Mapping[str, float]) -> None:
        """Start the solver anew after an event that the master made.

        Args:
            next_time: of the next time event [s].
            inputs: what the components see now.
        """
        ...


class _Me(MeSession):
    def advance(
        self,
        until: float,
        *,
        signals: Mapping[str, Signal],
        record: Sequence[str] = (),
        points: Floats | None = None,
    ) -> Record:
        found = super().advance(until, signals=signals, record=record, points=points)
        del self._calls[:-1]  # replay begins with the master
        return found

    def snapshot(self) -> Snapshot:
        found = super().snapshot()
        self._states.clear()  # there is nothing to free
        return found

    def due(self) -> float:
        return self._next_time

    def go_on(self, next_time: float, inputs: Mapping[str, float]) -> None:
        self._seen.update(inputs)
        self.forcing.written = [self._seen[n] for n in self.forcing.names]
        self._next_time = next_time
        self.instance.get_states()
        self._forget()


class _CompiledMe(CompiledMeSession):
    def advance(
        self,
        until: float,
        *,
        signals: Mapping[str, Signal],
        record: Sequence[str] = (),
        points: Floats | None = None,
    ) -> Record:
        found = super().advance(until, signals=signals, record=record, points=points)
        del self._calls[:-1]
        return found

    def snapshot(self) -> Snapshot:
        found = super().snapshot()
        self._states.clear()
        return found

    def due(self) -> float:
        return float(self._native.next_time)

    def go_on(self, next_time: float, inputs: Mapping[str, float]) -> None:
        self._seen.update(inputs)
        self.forcing.written = [self._seen[n] for n in self.forcing.names]
        self._native.next_time = next_time
        self._forget()


# Driver → session of a group.
GROUP_SESSIONS: Mapping[str, type[_Me | _CompiledMe]] = {"compiled": _CompiledMe, "python": _Me}

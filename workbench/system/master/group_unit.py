"""A group of model exchange components: one ordinary differential equation between communication points.

Events at communication points are the master's affair.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace

from workbench.core.values.arrays import Floats
from workbench.errors import SimulationError
from workbench.kernel.structs import Me
from workbench.session.base import Recorded, Snapshot
from workbench.session.compiled import CompiledMeSession
from workbench.session.me import MeSession
from workbench.session.setup import Setup
from workbench.signals.kinds import Signal
from workbench.system.master.group_instance import GroupInstance

__all__ = ["CompiledGroupSession", "GroupSession", "GroupUnit"]


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
        result = super().advance(until, signals=signals, record=record, points=points)
        del self._calls[:-1]  # replay begins with the master
        return result

    def snapshot(self) -> Snapshot:
        result = super().snapshot()
        self._states.clear()  # there is nothing to free
        return result

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


class GroupUnit:
    """One group; the kernel steps it, with the solver of its session.

    Args:
        name: of the group.
        instance: its components; the session begins with the first event iteration.
        members: its components' numbers in the system.
        solver, rtol: of the session.
        kind: class of the session.

    Attributes:
        members: see above.
    """

    def __init__(
        self,
        name: str,
        instance: GroupInstance,
        members: Sequence[int],
        *,
        solver: str,
        rtol: float,
        kind: type[GroupSession] = CompiledGroupSession,
    ) -> None:
        self.name = name
        self._kind = kind
        self.instance = instance
        self.members = tuple(members)
        variables = {v.name: v for v in instance.description.variables}
        self._inlet = instance.access([v for v in variables.values() if v.causality == "input"])
        self._setup = Setup(
            open_instance=lambda: instance,
            variables=variables,
            rtol=rtol,
            solver=solver,
            state_works=lambda: True,
        )
        self._session: GroupSession | None = None

    @property
    def session(self) -> GroupSession:
        """The session, once it is open."""
        if self._session is None:
            raise SimulationError(f"{self.name} is not initialised, or closed")
        return self._session

    @property
    def compiled(self) -> CompiledGroupSession:
        """The session that the kernel steps."""
        session = self.session
        if not isinstance(session, CompiledGroupSession):
            raise SimulationError(f"{self.name} is not advanced by compiled code")
        return session

    def failed(self) -> Exception:
        """Return what the kernel has noted for the group, as an exception that names it."""
        return _of(self.name, self.compiled.loop.failed())

    def due(self) -> float:
        """Return the time of the next time event [s]."""
        return math.inf if self._session is None else self._session.due()

    def settle(self, time: float) -> None:
        """Go on from the joint event iteration that has just ended at `time` [s]."""
        instance = self.instance
        if self._session is None:
            self._session = self._kind(replace(self._setup, start_time=time))
        else:
            instance.enter_continuous_mode()
        inputs = {v.name: float(x) for v, x in zip(self._inlet.variables, self._standing(), strict=True)}
        self.session.go_on(instance.settled.next_time, inputs)

    def _standing(self) -> list[float]:
        return self._inlet.read() if self._inlet.variables else []

    def stands(self, time: float) -> None:
        """Note that the kernel has advanced the components to `time` [s]."""
        session = self.compiled
        session.loop.reapply()
        session.time = self.instance.time = time
        self.instance.touch()

    def snapshot(self) -> Snapshot:
        """Save what the components' own states do not hold."""
        return self.session.snapshot()

    def restore(self, snapshot: Snapshot) -> None:
        """Go back; the components are back already."""
        self.session.restore(snapshot)

    def close(self) -> None:
        """Free the solver."""
        session, self._session = self._session, None
        if session is not None:
            session.close()


def _of(name: str, error: Exception) -> Exception:
    """Return an error with the group's name in its message."""
    if not isinstance(error, SimulationError):
        return error
    result = type(error)(str(error) if name in str(error) else f"{name}: {error}")
    result.time = error.time
    return result

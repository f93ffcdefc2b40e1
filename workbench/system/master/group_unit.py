"""A group of model exchange components: one ordinary differential equation between communication points."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from workbench.errors import SimulationError
from workbench.session.base import Snapshot
from workbench.session.fmu import Setup
from workbench.system.master.group_instance import GroupInstance
from workbench.system.master.group_session import CompiledGroupSession, GroupSession

__all__ = ["GroupUnit"]

SESSION: type[GroupSession] = CompiledGroupSession


class GroupUnit:
    """One group; the kernel steps it, with the solver of its session.

    Args:
        name: of the group.
        instance: its components; the session begins with the first event iteration.
        members: its components' numbers in the system.
        solver, rtol: of the session.

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
    ) -> None:
        self.name = name
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
            self._session = SESSION(replace(self._setup, start_time=time))
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
    found = type(error)(str(error) if name in str(error) else f"{name}: {error}")
    found.time = error.time
    return found

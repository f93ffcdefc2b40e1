"""A session on a system with co-simulation components."""

from __future__ import annotations

from workbench.session.cs import CsSession
from workbench.session.rows import Rows
from workbench.system.master.instance import MasterInstance

__all__ = ["MasterSession"]

_SAME = 1e-9  # of the communication step: instants closer than this are one


class MasterSession(CsSession):
    """Steps the whole system from one communication point to the next.

    Communication points are those of `CsSession`, and the instants at which something is known to happen in a
    component: samples, time events, connections that close; components with a constant step know only their grid.
    """

    @property
    def master(self) -> MasterInstance:
        """The system's instance."""
        instance = self.instance
        if not isinstance(instance, MasterInstance):
            raise TypeError(f"a master is needed, not {type(instance).__name__}")
        return instance

    def _to_target(self, target: float, until: float, longest: float, rows: Rows) -> None:
        while self.time < target:
            self._to_stop(self._next_stop(target, longest), until, longest, rows)

    def _next_stop(self, target: float, longest: float) -> float:
        if not self.instance.capabilities.variable_step:
            return target
        stop = self.master.next_stop(self.time + _SAME * longest)
        return target if stop >= target - _SAME * longest else stop

    def _to_stop(self, stop: float, until: float, longest: float, rows: Rows) -> None:
        super()._to_target(stop, until, longest, rows)

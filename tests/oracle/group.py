"""The oracle's sessions on groups of model exchange components among co-simulation ones."""

from __future__ import annotations

from collections.abc import Mapping

from tests.oracle.me import OracleMeSession
from workbench.system.master.group_unit import GroupSession

__all__ = ["OracleGroupSession"]


class OracleGroupSession(GroupSession, OracleMeSession):
    """`GroupSession` step by step in Python."""

    def due(self) -> float:
        return self._next_time

    def go_on(self, next_time: float, inputs: Mapping[str, float]) -> None:
        self._take(inputs)
        self._next_time = next_time
        self.instance.get_states()
        self._forget()

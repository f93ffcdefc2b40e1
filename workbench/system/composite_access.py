"""Reading and writing variables of a system: each part reads and writes its own."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from workbench.fmi.access import Access
from workbench.fmi.variable import Value, Variable
from workbench.session.forcing import convert

if TYPE_CHECKING:
    from workbench.system.composite import CompositeInstance

__all__ = ["CompositeAccess"]


class CompositeAccess(Access):
    """Variables of several parts in one list; a system's input is written to all that it drives."""

    def __init__(self, instance: CompositeInstance, variables: Sequence[Variable]) -> None:
        self.variables = tuple(variables)
        self.blocks, self.order = [], []  # those of the parts' own accesses
        self._instance = instance
        ports = [instance.ports(v) for v in self.variables]
        self._readers = self._group([(p[0], i) for i, p in enumerate(ports)])
        self._writers = self._group([(port, i) for i, p in enumerate(ports) for port in p])

    def _group(self, pairs: Sequence[tuple[tuple[int, Variable], int]]) -> list[tuple[Access, list[int]]]:
        """Return for each part its access, and where its variables stand in the list."""
        found = []
        for part in dict.fromkeys(number for (number, _), _ in pairs):
            own = [(variable, i) for (number, variable), i in pairs if number == part]
            access = self._instance.parts[part].access([v for v, _ in own])
            found.append((access, [i for _, i in own]))
        return found

    def read(self) -> list[Any]:
        self._instance.refresh()
        values: list[Any] = [None] * len(self.variables)
        for access, indices in self._readers:
            for i, value in zip(indices, access.read(), strict=True):
                values[i] = value
        return values

    def write(self, values: Sequence[Value]) -> None:
        for access, indices in self._writers:
            access.write([_fitting(v, values[i]) for v, i in zip(access.variables, indices, strict=True)])
        self._instance.touch()


def _fitting(variable: Variable, value: Value) -> Value:
    """Return `value` as the part's variable takes it."""
    return value if isinstance(value, str) or not variable.is_number else convert(variable, float(value))

"""Names in a system: "component.variable", where both parts may hold dots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from workbench.errors import InputError, suggest
from workbench.fmi.variable import Variable
from workbench.system.description import Port

__all__ = ["NameTable"]


class NameTable:
    """Finds components and their variables by full name.

    Args:
        components: names, in the system's order.
        variables: of each component.
    """

    def __init__(self, components: Sequence[str], variables: Sequence[Sequence[Variable]]) -> None:
        self._index: Mapping[str, int] = {name: k for k, name in enumerate(components)}
        self._variables: Sequence[Mapping[str, Variable]] = [{v.name: v for v in group} for group in variables]

    def find(self, name: str, *, kind: str | None = None) -> Port:
        """Return the variable "component.variable"; for an alias what it is one of, whose dependencies are declared.

        Args:
            name: of the variable.
            kind: causality that near names are looked for among ("input", "output"); None: any.

        Raises:
            InputError: no such component or variable; near names are in the message.
        """
        component, variable = self.split(name)
        result = self._variables[self._index[component]].get(variable)
        if result is None:
            raise InputError(self._unknown(component, variable, kind))
        k = self._index[component]
        return Port(k, self._variables[k][result.alias_of or variable])

    def elements(self, name: str) -> list[Port]:
        """Return the elements of the array "component.variable", in order; empty where there is no such array."""
        component, variable = self.split(name)
        k = self._index[component]
        return [Port(k, v) for v in self._variables[k].values() if v.name.startswith(f"{variable}[")]

    def split(self, name: str) -> tuple[str, str]:
        """Return component and variable of a full name.

        Raises:
            InputError: no such component, or two readings that both exist.
        """
        if "." not in name:
            raise InputError(f"'{name}' names no component: write 'component.variable'; {suggest(name, self._index)}")
        readings = self._readings(name)
        if not readings:
            component = name.partition(".")[0]
            raise InputError(f"'{component}' (in '{name}') is not a component; {suggest(component, self._index)}")
        existing = [r for r in readings if r[1] in self._variables[self._index[r[0]]]]
        if len(existing) > 1:
            both = " and ".join(f"'{v}' of '{c}'" for c, v in existing)
            raise InputError(f"'{name}' can be read as {both}; rename one of the components")
        return (existing or readings)[0]

    def _readings(self, name: str) -> list[tuple[str, str]]:
        """Return the ways to read a full name whose component exists, the longest component first."""
        dots = [k for k, letter in enumerate(name) if letter == "."]
        return [(name[:k], name[k + 1 :]) for k in reversed(dots) if name[:k] in self._index]

    def _unknown(self, component: str, variable: str, kind: str | None) -> str:
        group = self._variables[self._index[component]].values()
        known = [v.name for v in group if kind is None or v.causality == kind]
        what = f"not an {kind}" if kind else "not a variable"
        return f"'{variable}' is {what} of component '{component}'; {suggest(variable, known)}"

"""On which states and inputs of a system a variable of one of its components depends, along the connections."""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Mapping, Sequence

from workbench.fmi.variable import Variable
from workbench.system.components import OpenComponent
from workbench.system.description import Resolved

__all__ = ["SystemDependencies", "states_of"]

Names = dict[str, None]  # a set that keeps its order


class SystemDependencies:
    """Puts together what the components declare of their outputs and derivatives.

    What is not declared may depend on every state and input of its own component, as FMI has it. Connections that
    close later or pass values at events only count as well: too much is safe, too little is not.

    Args:
        parts: the components.
        resolved: their connections, and what the system's inputs drive.
    """

    def __init__(self, parts: Sequence[OpenComponent], resolved: Resolved) -> None:
        self._parts, self._wires = parts, resolved.wires
        self._states = [{v.name: {f"{p.name}.{v.name}": None} for v in states_of(p)} for p in parts]
        self._driven: list[dict[str, Names]] = [{} for _ in parts]
        for name, ports in resolved.inputs.items():
            for port in ports:
                for alias in self._same(port.component, port.variable):
                    self._driven[port.component].setdefault(alias, {})[name] = None
        self._follow()

    def of(self, component: int, variable: Variable) -> tuple[str, ...]:
        """Return the full names of the states and inputs of the system on which a variable depends.

        Args:
            component: its number.
            variable: as the component names it.
        """
        return tuple(self._behind(component, variable))

    def _behind(self, component: int, variable: Variable) -> Names:
        known: Mapping[str, Names] = ChainMap(self._states[component], self._driven[component])
        if variable.name in known:
            return known[variable.name]
        if variable.causality == "input":
            return {}  # nothing drives it
        depends = variable.dependencies
        if depends is None or self._parts[component].description.shapes:
            depends = tuple(known)
        return {name: None for d in depends for name in known.get(d, ())}

    def _follow(self) -> None:
        """Take along what reaches the source of each connection, until nothing more is found; loops end, too."""
        ends = [self._same(w.to_component, w.destination) for w in self._wires]
        for wire, names in zip(self._wires, ends, strict=True):
            for name in names:
                self._driven[wire.to_component].setdefault(name, {})
        grown = True
        while grown:
            grown = False
            for wire, names in zip(self._wires, ends, strict=True):
                result = self._behind(wire.from_component, wire.source)
                for name in names:
                    own = self._driven[wire.to_component][name]
                    before = len(own)
                    own.update(result)
                    grown |= len(own) > before

    def _same(self, component: int, variable: Variable) -> list[str]:
        """Return an input's names: a component may have several for it."""
        described = self._parts[component].description
        own = (v for v in described.variables if v.causality == "input")
        return [v.name for v in own if _place(v) == _place(variable)]


def _place(variable: Variable) -> tuple[int, int, str]:
    return variable.value_reference, variable.element, variable.type


def states_of(part: OpenComponent) -> tuple[Variable, ...]:
    """Return one variable for each state of a component; FMI 1.0 does not name them."""
    known, count = part.description.states, part.description.state_count
    return (*known, *(Variable(f"state[{i + 1}]") for i in range(len(known), count)))

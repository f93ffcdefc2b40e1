"""Systems inside a system file: their components take their place, under names with the system's before them."""

from __future__ import annotations

import weakref
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from workbench.errors import InputError, suggest
from workbench.fmi.archive import Unpacked
from workbench.system.description import Component, Connection, SystemDescription

__all__ = ["Inner", "embed"]


@dataclass(frozen=True)
class Inner:
    """A system that stands as a component.

    Attributes:
        name: of that component; an inner component "plant" becomes "name.plant".
        system: its description.
    """

    name: str
    system: SystemDescription

    def component(self, component: Component) -> Component:
        """Return an inner component under its outer name."""
        return replace(component, name=f"{self.name}.{component.name}")

    def connection(self, connection: Connection) -> Connection:
        """Return an inner connection in outer names."""
        source, destination = (f"{self.name}.{n}" for n in (connection.source, connection.destination))
        return replace(connection, source=source, destination=destination)

    def find(self, variable: str, kind: str) -> tuple[str, ...]:
        """Return the outer names of what an input or output of the inner system stands for.

        Args:
            variable: an input or output of the inner system, or "component.variable" in it.
            kind: "input" or "output".

        Raises:
            InputError: no such name; near ones are in the message.
        """
        own = {**self.system.inputs, **{n: (v,) for n, v in self.system.outputs.items()}}
        if variable in own:
            return tuple(f"{self.name}.{target}" for target in own[variable])
        if any(variable.startswith(f"{c.name}.") for c in self.system.components):
            return (f"{self.name}.{variable}",)
        known = self.system.inputs if kind == "input" else self.system.outputs
        raise InputError(f"'{variable}' is not an {kind} of the system '{self.name}'; {suggest(variable, known)}")


def embed(outer: SystemDescription, parts: Sequence[Component | Inner]) -> SystemDescription:
    """Return `outer` with `parts` as its components, those of inner systems among them.

    Args:
        outer: connections, inputs and outputs may name inputs and outputs of inner systems.
        parts: in the order of the file.

    Raises:
        InputError: an inner system has no such input or output.
    """
    inner = {p.name: p for p in parts if isinstance(p, Inner)}
    own = tuple(c for connection in outer.connections for c in _connections(connection, inner))
    return replace(
        outer,
        components=tuple(c for p in parts for c in _components(p)),
        connections=(*(p.connection(c) for p in inner.values() for c in p.system.connections), *own),
        inputs={n: tuple(e for t in targets for e in _ends(t, inner, "input")) for n, targets in outer.inputs.items()},
        outputs={n: _ends(target, inner, "output")[0] for n, target in outer.outputs.items()},
        notes=(*outer.notes, *(f"{p.name}: {note}" for p in inner.values() for note in _notes(p.system))),
        units={**{n: u for p in inner.values() for n, u in p.system.units.items()}, **outer.units},
        folder=_together([p.system.folder for p in inner.values()]),
    )


def _notes(system: SystemDescription) -> tuple[str, ...]:
    lost = ", ".join(system.master.given())
    return (*system.notes, f"of its master is not used, the whole system has one: {lost}") if lost else system.notes


def _components(part: Component | Inner) -> tuple[Component, ...]:
    return tuple(part.component(c) for c in part.system.components) if isinstance(part, Inner) else (part,)


def _connections(connection: Connection, inner: Mapping[str, Inner]) -> list[Connection]:
    (source,) = _ends(connection.source, inner, "output")
    return [replace(connection, source=source, destination=d) for d in _ends(connection.destination, inner, "input")]


def _ends(name: str, inner: Mapping[str, Inner], kind: str) -> tuple[str, ...]:
    for part in sorted(inner.values(), key=lambda p: len(p.name), reverse=True):
        if name.startswith(f"{part.name}."):
            return part.find(name.removeprefix(f"{part.name}."), kind)
    return (name,)


def _together(folders: Sequence[Unpacked | None]) -> Unpacked | None:
    """Return one owner of several unpacked packages: the others live at least as long as the first."""
    owned = [f for f in folders if f is not None]
    if len(owned) > 1:
        weakref.finalize(owned[0], _close, owned[1:])
    return owned[0] if owned else None


def _close(folders: Sequence[Unpacked]) -> None:
    for folder in folders:
        folder.close()

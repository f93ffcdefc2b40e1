"""Flatten an SSD: connections that pass the connectors of nested systems become connections between components."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

from workbench.core.values.conversion import Unit, is_same_unit, known_unit, named_conversion
from workbench.errors import InputError
from workbench.system.description import Connection, GainComponent
from workbench.system.files.ssp_tree import Hop, Key, SspComponent

__all__ = ["ConnectionPath", "FlatSystem", "Flattener", "full_name"]

_ROOT: tuple[str, ...] = ()


def full_name(key: Key) -> str:
    """Return "component.variable" of a connector."""
    return ".".join((*key[0], key[1]))


@dataclass(frozen=True)
class ConnectionPath:
    """The hops from an origin (output of a component, or connector of the root system) to an end."""

    origin: Key
    hops: tuple[Hop, ...]

    @property
    def is_plain(self) -> bool:
        """Whether values pass unchanged but for their units."""
        return all(h.convert and h.closes_at is None and (h.gain, h.offset) == (1.0, 0.0) for h in self.hops)


@dataclass
class FlatSystem:
    """What the flattener found; `adaptors` stand between the root's connectors and components where values change."""

    connections: list[Connection] = field(default_factory=list)
    inputs: dict[str, list[str]] = field(default_factory=dict)
    outputs: dict[str, str] = field(default_factory=dict)
    adaptors: list[GainComponent] = field(default_factory=list)


class Flattener:
    """Walks back from every driven connector to where its value comes from.

    Args:
        root: the tree.
        unit_of: unit of a component's variable or a system's connector; None: none known.
        units: definitions in the SSD.
        notes: remarks are appended.
    """

    def __init__(
        self,
        root: SspComponent,
        unit_of: Callable[[Key], str | None],
        units: Mapping[str, Unit],
        notes: list[str],
    ) -> None:
        self.nodes = {node.path: node for node in root.walk()}
        self.root = root
        self.unit_of = unit_of
        self.units = units
        self.notes = notes
        self.incoming: dict[Key, list[Hop]] = {}
        for node in self.nodes.values():
            for hop in node.hops:
                self.incoming.setdefault(hop.end, []).append(hop)

    def chains(self, end: Key, passed: tuple[Key, ...] = ()) -> Iterator[ConnectionPath]:
        """Yield what drives `end`.

        Raises:
            InputError: connectors of systems that drive each other in a circle.
        """
        if end in passed:
            circle = " → ".join(full_name(k) for k in reversed((*passed, end)))
            raise InputError(f"connectors drive each other in a circle: {circle}")
        for hop in self.incoming.get(end, []):
            node = self.nodes[hop.start[0]]
            if not node.is_system or node.path == _ROOT:
                yield ConnectionPath(hop.start, (hop,))
                continue
            before = list(self.chains(hop.start, (*passed, end)))
            if not before and not self._is_parameter(hop.start):
                self.notes.append(f"{full_name(hop.end)} is connected to {full_name(hop.start)}, which nothing drives")
            for chain in before:
                yield ConnectionPath(chain.origin, (*chain.hops, hop))

    def _is_parameter(self, key: Key) -> bool:
        connector = self.nodes[key[0]].connectors.get(key[1])
        return connector is not None and connector.kind in ("parameter", "calculatedParameter", "structuralParameter")

    def is_parameter_chain(self, chain: ConnectionPath) -> bool:
        """Whether a chain hands over a parameter, which is not a connection in a simulation.

        Raises:
            InputError: the parameter is one that a component calculates.
        """
        if not self._is_parameter(chain.origin) and not self._is_parameter(chain.hops[-1].end):
            return False
        if not self.nodes[chain.origin[0]].is_system:
            names = f"{full_name(chain.origin)} → {full_name(chain.hops[-1].end)}"
            raise InputError(f"connection {names}: a component's calculatedParameter is not passed on")
        return True

    # -- connections, inputs, outputs -----------------------------------------------------------------

    def flat(self) -> FlatSystem:
        """Return connections, inputs and outputs of the flat system."""
        flat = FlatSystem()
        to_components = [
            (end, chain)
            for end in self.incoming
            if not self.nodes[end[0]].is_system
            for chain in self.chains(end)
            if not self.is_parameter_chain(chain)
        ]
        for end, chain in to_components:
            if chain.origin[0] != _ROOT:
                flat.connections.append(self._connection(chain, full_name(chain.origin), full_name(end)))
        for name in dict.fromkeys(chain.origin[1] for _, chain in to_components if chain.origin[0] == _ROOT):
            self._input(name, [(e, c) for e, c in to_components if c.origin == (_ROOT, name)], flat)
        for end in self.incoming:
            if end[0] == _ROOT:
                self._output(end, flat)
        self._note_unused(flat)
        return flat

    def _note_unused(self, flat: FlatSystem) -> None:
        by_kind: Mapping[str, Mapping[str, object]] = {"input": flat.inputs, "output": flat.outputs}
        for name, connector in self.root.connectors.items():
            known = by_kind.get(connector.kind or "")
            if known is not None and name not in known:
                self.notes.append(f"{connector.kind} '{name}' of the system is connected to nothing; left out")

    def _input(self, name: str, driven: list[tuple[Key, ConnectionPath]], flat: FlatSystem) -> None:
        unit = self.unit_of((_ROOT, name))
        if all(chain.is_plain and self._alike(unit, self.unit_of(end)) for end, chain in driven):
            flat.inputs[name] = [*flat.inputs.get(name, []), *(full_name(end) for end, _ in driven)]
            return
        adaptor = self._adaptor(f"{name}_in", flat, u=unit, y=unit)
        flat.inputs[name] = [*flat.inputs.get(name, []), f"{adaptor}.u"]
        for end, chain in driven:
            flat.connections.append(self._connection(chain, f"{adaptor}.y", full_name(end)))

    def _output(self, end: Key, flat: FlatSystem) -> None:
        chains = [c for c in self.chains(end) if not self.is_parameter_chain(c)]
        if len(chains) > 1:
            names = " and ".join(full_name(c.origin) for c in chains)
            raise InputError(f"the output {end[1]} of the system has two sources, {names}; it takes one")
        for chain in chains:
            unit = self.unit_of(end)
            if chain.origin[0] == _ROOT:
                flat.outputs[end[1]] = self._pass_through(chain, unit, flat)
            elif chain.is_plain and self._alike(self.unit_of(chain.origin), unit):
                flat.outputs[end[1]] = full_name(chain.origin)
            else:
                adaptor = self._adaptor(f"{end[1]}_out", flat, u=unit, y=unit)
                flat.connections.append(self._connection(chain, full_name(chain.origin), f"{adaptor}.u"))
                flat.outputs[end[1]] = f"{adaptor}.y"

    def _pass_through(self, chain: ConnectionPath, unit: str | None, flat: FlatSystem) -> str:
        """Return the output of a gain that leads an input of the root system to an output."""
        gain, offset = self._numbers(chain)
        if offset:
            raise InputError(f"{chain.origin[1]} → {full_name(chain.hops[-1].end)}: an offset is not read here")
        name = chain.origin[1]
        adaptor = self._adaptor(f"{name}_through", flat, gain=gain, u=self.unit_of(chain.origin), y=unit)
        flat.inputs.setdefault(name, []).append(f"{adaptor}.u")
        return f"{adaptor}.y"

    def _adaptor(self, name: str, flat: FlatSystem, *, gain: float = 1.0, u: str | None, y: str | None) -> str:
        taken = {".".join(path) for path in self.nodes} | {a.name for a in flat.adaptors}
        while name in taken:
            name += "_"
        units = {port: unit for port, unit in (("u", u), ("y", y)) if unit}
        flat.adaptors.append(GainComponent(name=name, gain=gain, units=units))
        return name

    def _alike(self, left: str | None, right: str | None) -> bool:
        if left is None or right is None or left == right:
            return True
        a, b = known_unit(left, self.units), known_unit(right, self.units)
        return a is not None and b is not None and is_same_unit(a, b)

    # -- chains -----------------------------------------------------------------------------------------

    def _connection(self, chain: ConnectionPath, source: str, destination: str) -> Connection:
        """Return a chain as one connection; its units are converted later where nothing else happens on the way."""
        if chain.is_plain:
            return Connection(source=source, destination=destination)
        times = [h.closes_at for h in chain.hops if h.closes_at is not None]
        last = chain.hops[-1]
        is_single = len(chain.hops) == 1
        gain, offset = (last.gain, last.offset) if is_single else self._numbers(chain)
        return Connection(
            source=source,
            destination=destination,
            gain=gain,
            offset=offset,
            convert=is_single and last.convert,
            closes_at=max(times, default=None),
        )

    def _numbers(self, chain: ConnectionPath) -> tuple[float, float]:
        """Return factor and offset of a chain, units and transformations hop by hop."""
        factor, offset = 1.0, 0.0
        unit = self.unit_of(chain.origin)
        for hop in chain.hops:
            following = self.unit_of(hop.end)
            a, b = self._convert(hop, unit, following) if hop.convert else (1.0, 0.0)
            factor, offset = hop.gain * a * factor, hop.gain * (a * offset + b) + hop.offset
            unit = following or unit
        return factor, offset

    def _convert(self, hop: Hop, unit: str | None, following: str | None) -> tuple[float, float]:
        if unit is None or following is None or unit == following:
            return 1.0, 0.0
        result = named_conversion(unit, following, self.units)
        if result is None:
            raise InputError(
                f"connection {full_name(hop.start)} → {full_name(hop.end)}: {unit} cannot be converted to {following}; "
                "define both in the SSD's Units or set suppressUnitConversion"
            )
        return result

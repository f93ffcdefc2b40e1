"""Connections of a system: their names, directions, types and units, checked against the components."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

from workbench.errors import InputError, article
from workbench.fmi.variable import FLOAT_TYPES, Variable
from workbench.fmi.wiring import Wire
from workbench.system.connection_units import UnitCheck, all_units, declared_unit
from workbench.system.description import Component, Connection, FmuComponent, Port, Resolved, SystemDescription
from workbench.system.names import NameTable

__all__ = ["as_written", "resolve", "settled"]


def resolve(description: SystemDescription, variables: Sequence[Sequence[Variable]]) -> Resolved:
    """Check a system against the variables of its components and return its wires.

    Args:
        description: the system as written down.
        variables: of each component, in the order of `description.components`.

    Raises:
        InputError: one line with the file, the connection, what is wrong and what to do: an unknown component or
            variable (with near names), two sources for one input, an output as destination, an input as source, units
            or types that do not fit.
    """
    try:
        return _Resolver(description, variables).resolved()
    except InputError as error:
        raise InputError(f"{description.source or f'system {description.name}'}: {error}") from None


def settled(description: SystemDescription, resolved: Resolved) -> SystemDescription:
    """Return the same system with every unit converted already, so that it resolves without the FMUs' files.

    Args:
        description: as it was resolved.
        resolved: what `resolve` returned for it.
    """
    return replace(description, connections=as_written(resolved.wires), units=all_units(description))


def as_written(wires: Sequence[Wire]) -> tuple[Connection, ...]:
    """Return connections that resolve to the same wires."""
    return tuple(
        Connection(
            source=w.ends[0],
            destination=w.ends[1],
            gain=w.gain,
            offset=w.offset,
            convert=False,
            closes_at=None if w.closes_at == -math.inf else w.closes_at,
        )
        for w in wires
    )


class _Resolver:
    """One pass over a description; `drivers` remembers what drives each input."""

    def __init__(self, description: SystemDescription, variables: Sequence[Sequence[Variable]]) -> None:
        self.description, self._full = description, description.full_name
        self.variables = variables
        names = [c.name for c in description.components]
        _check_unique(names)
        self.table = NameTable(names, variables)
        self.units = UnitCheck(description)
        self.drivers: dict[tuple[int, str], str] = {}

    def resolved(self) -> Resolved:
        wires = tuple(w for c in self.description.connections for w in self._wires(c))
        inputs = {name: self._input(name, targets) for name, targets in self.description.inputs.items()}
        outputs = {name: self._output(name, target) for name, target in self.description.outputs.items()}
        self._check_system_names(inputs, outputs)
        return Resolved(wires, inputs, outputs, (*self.units.notes, *self._unconnected()))

    # -- connections --------------------------------------------------------------------------

    def _wires(self, connection: Connection) -> list[Wire]:
        where = f"connection {connection.source} → {connection.destination}"
        try:
            _check_numbers(connection)
            ends = self._ends(connection)
            return [self._wire(connection, source, target) for source, target in ends]
        except InputError as error:
            raise InputError(f"{where}: {error}") from None

    def _ends(self, connection: Connection) -> list[tuple[Port, Port]]:
        """Return the scalar ends: one pair, or one for each element of two arrays of one size."""
        sources, targets = self.table.elements(connection.source), self.table.elements(connection.destination)
        if sources and targets:
            if len(sources) != len(targets):
                raise InputError(f"{len(sources)} elements to {len(targets)} elements; connect element by element")
            return list(zip(sources, targets, strict=True))
        source = self.table.find(connection.source, kind="output")
        return [(source, self.table.find(connection.destination, kind="input"))]

    def _wire(self, connection: Connection, source: Port, target: Port) -> Wire:
        _check_source(source.variable)
        _check_destination(target.variable)
        _check_types(connection, source.variable, target.variable)
        self._claim(target, connection.source)
        factor, offset = self.units.transformation(connection, source, target)
        return Wire(
            source.variable,
            target.variable,
            source.component,
            target.component,
            factor,
            offset,
            -math.inf if connection.closes_at is None else connection.closes_at,
            (self._full(source), self._full(target)),
        )

    def _claim(self, target: Port, driver: str) -> None:
        key = (target.component, target.variable.name)
        if key in self.drivers:
            name = self._full(target)
            raise InputError(
                f"the input {name} has two sources, {self.drivers[key]} and {driver}; an input takes one (add them in "
                "a sum component)"
            )
        self.drivers[key] = driver

    # -- inputs and outputs of the system ----------------------------------------------------------

    def _input(self, name: str, targets: Sequence[str]) -> tuple[Port, ...]:
        try:
            if not targets:
                raise InputError("drives nothing; name a component input")
            ports = tuple(self._driven(name, target) for target in targets)
            self._check_alike(ports)
        except InputError as error:
            raise InputError(f"input {name}: {error}") from None
        return ports

    def _driven(self, name: str, target: str) -> Port:
        port = self._element(target, kind="input")
        _check_destination(port.variable)
        if not port.variable.is_number:
            raise InputError(f"{target} is {article(port.variable.type)}; only numbers can be forced from outside")
        self._claim(port, f"the system's input {name}")
        return port

    def _check_alike(self, ports: Sequence[Port]) -> None:
        """Refuse a system input that drives inputs of several units or types: its own would not be known."""
        first = ports[0]
        for port in ports[1:]:
            if _kind(port.variable) != _kind(first.variable):
                raise InputError(
                    f"drives {self._full(first)} ({first.variable.type}) and {self._full(port)} "
                    f"({port.variable.type}); give them system inputs of their own"
                )
            self.units.check_same(first, port, f"drives {self._full(first)} and {self._full(port)}")

    def _output(self, name: str, target: str) -> Port:
        try:
            port = self._element(target, kind="output")
            if not port.variable.is_number:
                raise InputError(f"{target} is {article(port.variable.type)}; only numbers can be shown")
        except InputError as error:
            raise InputError(f"output {name}: {error}") from None
        return port

    def _element(self, name: str, *, kind: str) -> Port:
        result = self.table.elements(name)
        if result and result[0].variable.name != name:
            raise InputError(f"{name} is an array; name one element, such as {self._full(result[0])}")
        return self.table.find(name, kind=kind)

    def _check_system_names(self, inputs: Mapping[str, tuple[Port, ...]], outputs: Mapping[str, Port]) -> None:
        both = sorted(set(inputs) & set(outputs))
        if both:
            raise InputError(f"'{both[0]}' is an input and an output of the system; rename one of them")
        every = ((k, v) for k, group in enumerate(self.variables) for v in group)
        taken = {self._full(Port(k, v)): (k, v.alias_of or v.name) for k, v in every}
        shown = {**{n: p[0] for n, p in inputs.items()}, **outputs}
        for name, port in shown.items():
            if taken.get(name, (port.component, port.variable.name)) != (port.component, port.variable.name):
                raise InputError(f"'{name}' names an input or output of the system and a variable; rename the former")

    # -- notes ------------------------------------------------------------------------------------

    def _unconnected(self) -> Iterable[str]:
        free = [
            self._full(Port(k, v)) + _start(self.description.components[k], v)
            for k, group in enumerate(self.variables)
            for v in group
            if v.causality == "input" and v.type != "Clock" and (k, v.name) not in self.drivers
        ]
        if free:
            shown = ", ".join(free[:12]) + (f", … ({len(free)} in all)" if len(free) > 12 else "")
            yield f"not connected, these inputs keep their start values: {shown}"


def _start(component: Component, variable: Variable) -> str:
    """Return where an input stands, for a note: the value that the system sets, else the FMU's."""
    start = component.set.get(variable.name, variable.start) if isinstance(component, FmuComponent) else variable.start
    if start is None:
        return ""
    unit = declared_unit(component, variable)
    value = f"{start:g}" if isinstance(start, float) else str(start)
    return f" = {value}{f' {unit}' if unit and unit != '1' else ''}"


def _check_unique(names: Sequence[str]) -> None:
    if not names:
        raise InputError("has no components")
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"two components are called '{name}'; rename one")


def _check_numbers(connection: Connection) -> None:
    for what in ("gain", "offset", "closes_at"):
        value = getattr(connection, what)
        if value is not None and not math.isfinite(value):
            raise InputError(f"{what} must be a finite number, not {value}")


def _check_source(variable: Variable) -> None:
    if variable.causality == "output":
        return
    if variable.causality == "input":
        raise InputError(f"'{variable.name}' is an input, which drives nothing; the source must be an output")
    raise InputError(f"'{variable.name}' is {article(variable.causality)} variable; the source must be an output")


def _check_destination(variable: Variable) -> None:
    if variable.causality == "input":
        return
    if variable.causality == "output":
        raise InputError(f"'{variable.name}' is an output and cannot be driven; the destination must be an input")
    if variable.causality in ("parameter", "structuralParameter"):
        raise InputError(f"'{variable.name}' is a parameter, not an input; give its value in the component's 'set'")
    raise InputError(f"'{variable.name}' is {article(variable.causality)} variable; the destination must be an input")


# -- types ---------------------------------------------------------------------------------------


def _kind(variable: Variable) -> str:
    if variable.type in FLOAT_TYPES:
        return "real"
    if variable.type in ("Boolean", "String", "Binary", "Clock"):
        return variable.type
    return "integer"  # of any width, and enumerations


def _check_types(connection: Connection, source: Variable, target: Variable) -> None:
    given, taken = _kind(source), _kind(target)
    fits = given == taken or (given == "integer" and taken == "real")
    if not fits or given not in ("real", "integer", "Boolean"):
        why = "types do not fit" if not fits else f"values of type {source.type} cannot be connected"
        raise InputError(f"{why}: '{source.name}' is {article(source.type)}, '{target.name}' {article(target.type)}")
    if taken != "real" and (connection.gain, connection.offset, connection.unit) != (1.0, 0.0, None):
        raise InputError(f"gain, offset and unit are for real inputs; '{target.name}' is {article(target.type)}")

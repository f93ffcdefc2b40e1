"""Write a system as an .ssp package of SSP 1.0."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from workbench.core.values.conversion import Unit, known_unit
from workbench.errors import InputError
from workbench.fmi.variable import Variable
from workbench.fmi.wiring import Wire
from workbench.system.connection_checks import resolve
from workbench.system.connection_units import declared_unit
from workbench.system.description import (
    Component,
    FmuComponent,
    FunctionComponent,
    Port,
    Resolved,
    SystemDescription,
    to_write,
)
from workbench.system.files.ssp_blocks import BLOCK_TYPE, block_bytes, block_variables
from workbench.system.files.ssp_package import Resources
from workbench.system.files.ssp_tree import ANNOTATION
from workbench.system.files.ssp_write_xml import (
    add_annotation,
    add_connector,
    add_enumerations,
    add_parameters,
    add_units,
    attributes,
    element,
    serialise,
)
from workbench.system.files.ssp_xml import Element
from workbench.system.fmu_facts import FmuInterface, fmu_facts

__all__ = ["write_ssp"]

_IMPLEMENTATIONS = {"auto": "any", "me": "ModelExchange", "cs": "CoSimulation"}


def write_ssp(description: SystemDescription, path: str | Path) -> tuple[str, ...]:
    """Write a system as an .ssp package; the same system gives the same bytes.

    FMUs are copied into its folder `resources`. What SSP 1.0 has no place for (linear systems, gains and sums, the time
    at which a connection closes, communication step and solver) is kept in annotations and files of the workbench's
    own: it reads them back, other tools pass over them.

    Args:
        description: the system; it is checked first.
        path: the .ssp file to write.

    Returns:
        What other tools will not see, one line each.

    Raises:
        InputError: the system is not healthy (see `connection_checks.resolve`), holds a Python function, or the file
            cannot be written.
        FmuError: an FMU cannot be read.

    Examples:
        >>> notes = wb.write_ssp(wb.read_system("system:rudder_loop"), "rudder_loop.ssp")
        >>> with wb.load("rudder_loop.ssp") as system:
        ...     print([v.name for v in system.outputs])
        ['del']
    """
    description = to_write(description)
    target = Path(path)
    if target.suffix.lower() != ".ssp":
        raise InputError(f"'{path}' must end in .ssp: it is the file to write")
    if not target.parent.is_dir():
        raise InputError(f"the folder '{target.parent}' does not exist")
    writer = _SspWriter(description)
    xml = serialise(writer.structure())
    writer.resources.write(target, xml)
    return tuple(writer.notes)


@dataclass
class _WrittenComponent:
    """A component with what its XML needs; `shown` are further variables with a connector."""

    component: Component
    facts: FmuInterface | None
    variables: Sequence[Variable]
    shown: list[str] = field(default_factory=list)


class _SspWriter:
    def __init__(self, description: SystemDescription) -> None:
        self.description = description
        self.resources = Resources()
        self.notes: list[str] = []
        self.units: dict[str, Unit] = {}
        self.enumerations: dict[str, dict[str, int]] = {}
        self.parts = [_part(c) for c in description.components]
        self.resolved: Resolved = resolve(description, [p.variables for p in self.parts])
        for port in self.resolved.outputs.values():
            self.parts[port.component].shown.append(port.variable.name)

    def structure(self) -> Element:
        """Return the SystemStructureDescription."""
        name = self.description.name
        root = element(
            "ssd:SystemStructureDescription", None, {"version": "1.0", "name": name, "generationTool": "FMI workbench"}
        )
        system = element("ssd:System", root, {"name": name})
        self._connectors(system)
        elements = element("ssd:Elements", system)
        for part in self.parts:
            self._component(elements, part)
        self._connections(system)
        add_enumerations(root, self.enumerations)
        add_units(root, self.units)
        self._experiment(root)
        if lost := ", ".join(self.description.master.given()):
            self.notes.append(f"of the master nothing is written: {lost}")
        return root

    def _experiment(self, root: Element) -> None:
        given = self.description.default_experiment
        times = attributes({"startTime": given.start_time, "stopTime": given.stop_time})
        rest = attributes({"tolerance": given.tolerance, "step": given.step})
        if times or rest:
            experiment = element("ssd:DefaultExperiment", root, times)
            if rest:
                add_annotation(experiment, ANNOTATION, "Experiment", rest)

    # -- connectors -----------------------------------------------------------------------------------

    def _connectors(self, system: Element) -> None:
        """Add the system's own; an input takes type and unit of the first variable it drives."""
        shown = [
            *((name, ports[0], "input") for name, ports in self.resolved.inputs.items()),
            *((name, port, "output") for name, port in self.resolved.outputs.items()),
        ]
        if shown:
            connectors = element("ssd:Connectors", system)
            for name, port, kind in shown:
                self._connector(connectors, self.parts[port.component], port.variable, name, kind)

    def _connector(self, parent: Element, part: _WrittenComponent, variable: Variable, name: str, kind: str) -> None:
        items = {} if part.facts is None else part.facts.items.get(variable.name, {})
        enumeration = f"{part.component.name}.{variable.name}" if items else None
        if enumeration is not None:
            self.enumerations[enumeration] = dict(items)
        unit = self._unit(part, declared_unit(part.component, variable))
        add_connector(parent, name, kind, variable.type, unit=unit, enumeration=enumeration)

    def _unit(self, part: _WrittenComponent, name: str | None) -> str | None:
        """Return a unit that the SSD can refer to, and remember its definition; None: there is none."""
        if name is None or name in self.units:
            return name
        own = {} if part.facts is None else part.facts.units
        unit = known_unit(name, {**self.description.units, **own})
        if unit is None:
            self.notes.append(f"unit '{name}' is nowhere defined and not written")
            return None
        self.units[name] = unit
        return name

    # -- components -----------------------------------------------------------------------------------

    def _component(self, parent: Element, part: _WrittenComponent) -> None:
        component = part.component
        if isinstance(component, FmuComponent):
            source = self.resources.add_fmu(component.file, component.name)
            kind = {"implementation": _IMPLEMENTATIONS[component.interface]}
        else:
            source = self.resources.add(f"{component.name}.json", block_bytes(component))
            kind = {"type": BLOCK_TYPE}
            self.notes.append(f"component {component.name} is not an FMU: other tools cannot run it")
        xml = element("ssd:Component", parent, {"name": component.name, "source": source, **kind})
        self._component_connectors(xml, part)
        if isinstance(component, FmuComponent):
            self._settings(xml, component, part)

    def _component_connectors(self, xml: Element, part: _WrittenComponent) -> None:
        connectors = element("ssd:Connectors", xml)
        bound = part.component.set if isinstance(part.component, FmuComponent) else {}
        for variable in part.variables:
            if variable.causality in ("input", "output"):
                kind = variable.causality
            elif variable.name in part.shown:
                kind = "output"
            elif variable.name in bound and variable.causality == "parameter":
                kind = "parameter"
            else:
                continue
            self._connector(connectors, part, variable, variable.name, kind)
        if not len(connectors):
            xml.remove(connectors)

    def _settings(self, xml: Element, component: FmuComponent, part: _WrittenComponent) -> None:
        if component.set and part.facts is not None:
            add_parameters(xml, component, part.facts)
        settings = {"step": component.step, "solver": component.solver, "dependencies": component.dependencies}
        own = attributes({key: None if value in {"auto", "declared"} else value for key, value in settings.items()})
        if own:
            add_annotation(xml, ANNOTATION, "Component", own)
            self.notes.append(f"component {component.name}: for the workbench only: {', '.join(own)}")

    # -- connections ----------------------------------------------------------------------------------

    def _connections(self, system: Element) -> None:
        connections = element("ssd:Connections", system)
        for wire in self.resolved.wires:
            self._wire(connections, wire)
        for name, ports in self.resolved.inputs.items():
            for port in ports:
                element("ssd:Connection", connections, {"startConnector": name, **self._end("end", port)})
        for name, port in self.resolved.outputs.items():
            element("ssd:Connection", connections, {**self._end("start", port), "endConnector": name})
        if not len(connections):
            system.remove(connections)

    def _wire(self, parent: Element, wire: Wire) -> None:
        source, target = Port(wire.from_component, wire.source), Port(wire.to_component, wire.destination)
        ends = {**self._end("start", source), **self._end("end", target)}
        # Where units differ, the wire's numbers hold the conversion already: no tool shall convert again.
        units = [declared_unit(self.parts[p.component].component, p.variable) for p in (source, target)]
        if None not in units and units[0] != units[1]:
            ends["suppressUnitConversion"] = "true"
        xml = element("ssd:Connection", parent, ends)
        if (wire.gain, wire.offset) != (1.0, 0.0):
            element("ssc:LinearTransformation", xml, {"factor": wire.gain, "offset": wire.offset})
        if wire.closes_at > -math.inf:
            add_annotation(xml, ANNOTATION, "Connection", {"closesAt": wire.closes_at})
            self.notes.append(
                f"connection {wire.label} closes at {wire.closes_at:g} s: for other tools it is closed from the start"
            )

    def _end(self, side: str, port: Port) -> dict[str, str]:
        """Return the attributes of a connection that name a component's variable at its start or end."""
        component = self.description.components[port.component].name
        return {f"{side}Element": component, f"{side}Connector": port.variable.name}


def _part(component: Component) -> _WrittenComponent:
    if isinstance(component, FmuComponent):
        facts = fmu_facts(component.file, component.called)
        return _WrittenComponent(component, facts, tuple(facts.variables.values()))
    if isinstance(component, FunctionComponent):
        raise InputError(f"component {component.name} is a Python function, which no file can hold")
    return _WrittenComponent(component, None, block_variables(component))

"""Read systems from SSP: .ssp packages and .ssd files, of SSP 1.0 and, leniently, 2.0."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from workbench.core.machine.files import content_of
from workbench.core.machine.scratch import scratch_folder
from workbench.core.records.parsing import from_json
from workbench.core.values.conversion import Unit, known_unit
from workbench.errors import InputError, WorkbenchError, suggest
from workbench.fmi.archive import Unpacked, extract
from workbench.fmi.description import DefaultExperiment
from workbench.fmi.variable import Value
from workbench.system.description import Component, FmuComponent, SystemDescription
from workbench.system.files.ssp_blocks import BLOCK_TYPE
from workbench.system.files.ssp_flatten import FlatSystem, Flattener, full_name
from workbench.system.files.ssp_parameters import Parameter, bound_parameters
from workbench.system.files.ssp_tree import ANNOTATION, Key, SspComponent, SspSource, own_annotation, read_tree
from workbench.system.files.ssp_values import values_for
from workbench.system.files.ssp_xml import Element, Package, descend, number, parse, tag
from workbench.system.files.toml_components import read_component
from workbench.system.fmu_facts import FmuInterface, fmu_facts, read_units

__all__ = ["read_ssd", "read_ssp"]

_DEFAULT_TYPE = "application/x-fmu-sharedlibrary"
_STANDARD = "SystemStructure.ssd"
_ROOT = "SystemStructureDescription"
_OF_FILES = {"model", "linear"}  # keys of a block that is in another file, anywhere on the machine
_INTERFACES = {"any": "auto", "ModelExchange": "me", "CoSimulation": "cs"}


def read_ssp(path: Path) -> SystemDescription:
    """Return the system in an .ssp package. It is unpacked; the description owns the folder.

    Raises:
        InputError: one line with the file, what is wrong and where.
        FmuError: no zip archive, damaged, or entries that would leave the folder.
    """
    return _read(path, str(path), [], packed=True)


def read_ssd(path: Path) -> SystemDescription:
    """Return the system of an .ssd file, or of a folder with a SystemStructure.ssd; paths are relative to it.

    Raises:
        InputError: one line with the file, what is wrong and where.
    """
    return _read(path / _STANDARD if path.is_dir() else path, str(path), [], packed=False)


def _find_ssd(source: str, folder: Path) -> tuple[Path, list[str]]:
    if (folder / _STANDARD).is_file():
        return folder / _STANDARD, []
    others = sorted(p for p in folder.iterdir() if p.suffix.lower() == ".ssd")
    if len(others) == 1:
        return others[0], [f"the package has no {_STANDARD}; {others[0].name} was read"]
    raise InputError(f"{source}: no {_STANDARD} inside; this is not an SSP package")


def _read(path: Path, source: str, notes: list[str], *, packed: bool) -> SystemDescription:
    """Return the system in a file; what is unpacked lies in a folder that the description owns."""
    unpacked = Unpacked(path, scratch_folder("ssp"), owned=True)
    files = _SspFiles(unpacked.folder, notes)
    try:
        origin = files.opened(path, source, packed=packed)
        description = _SspReader(origin, notes).description(source)
    except WorkbenchError as error:
        unpacked.close()
        raise InputError(f"{source}: {str(error).removeprefix(f'{source}: ')}") from None
    except BaseException:
        unpacked.close()
        raise
    if not files.count:
        unpacked.close()
        return description
    return replace(description, folder=unpacked)


@dataclass
class _SspFiles:
    """Opens SSDs and packages.

    Attributes:
        room: folder for what is unpacked, a folder each.
        notes: remarks are appended.
        count: of the folders so far.
    """

    room: Path
    notes: list[str]
    count: int = 0

    def opened(self, path: Path, called: str, *, packed: bool) -> SspSource:
        """Return the root of a file.

        Args:
            path: an SSD, or a package.
            called: what the user calls it.
            packed: whether it is a package.
        """
        if not packed:
            return SspSource(Package(path.parent), parse(path, _ROOT), self._nested)
        folder = self.room / str(self.count)
        self.count += 1
        folder.mkdir()
        extract(path, folder, called=called)
        ssd, notes = _find_ssd(called, folder)
        self.notes.extend(notes)
        return SspSource(Package(folder, within=folder, called=called), parse(ssd, _ROOT), self._nested)

    def _nested(self, source: str, where: str, around: SspSource) -> SspSource:
        path = around.package.file(source, where)
        if path.is_dir():
            path /= _STANDARD
        called = around.package.name_of(path) or str(path)
        if path.suffix.lower() == ".ssp":
            return self.opened(path, called, packed=True)
        return replace(self.opened(path, called, packed=False), package=replace(around.package, folder=path.parent))


@dataclass(frozen=True)
class _Fmu:
    """A component that is an FMU, with what its description says."""

    component: FmuComponent
    facts: FmuInterface


class _SspReader:
    """Reads one SSD, with those inside.

    Args:
        origin: its root.
        notes: remarks so far.
    """

    def __init__(self, origin: SspSource, notes: list[str]) -> None:
        self.origin, self.ssd = origin, origin.ssd
        self.notes = notes
        self.fmus: dict[tuple[str, ...], _Fmu] = {}
        self.units: Mapping[str, Unit] = {}
        self.nodes: Mapping[tuple[str, ...], SspComponent] = {}

    def description(self, source: str) -> SystemDescription:
        system = descend(self.ssd, "System")
        if system is None:
            raise InputError("holds no System")
        self._check_version()
        root = read_tree(system, self.origin)
        for node in root.walk():  # those of the outermost file count where files differ
            self.units = {**read_units(node.origin.ssd), **self.units}
        components = [self._component(node) for node in root.walk() if not node.is_system]
        if not components:
            raise InputError("the system has no components")
        flattener = Flattener(root, self._unit, self.units, self.notes)
        self.nodes = flattener.nodes
        flat = flattener.flat()
        if not any(c.kind in ("input", "output") for c in root.connectors.values()):
            self._show_all(flat, flattener)
        values = self._values(root, flattener)
        return SystemDescription(
            name=self.ssd.get("name") or system.get("name") or "system",
            components=(*(_with_values(c, values) for c in components), *flat.adaptors),
            connections=tuple(flat.connections),
            inputs={name: tuple(targets) for name, targets in flat.inputs.items()},
            outputs=flat.outputs,
            default_experiment=_experiment(descend(self.ssd, "DefaultExperiment")),
            notes=(*dict.fromkeys(self.notes), *_odd_units(self.units), *self._foreign()),
            units=self.units,
            source=source,
        )

    def _check_version(self) -> None:
        version = self.ssd.get("version") or "none"
        if version.partition(".")[0] not in ("1", "2"):
            self.notes.append(f"SSP version '{version}' is read as 2.0")

    def _foreign(self) -> Iterator[str]:
        types = {a.get("type") or "?" for a in self.ssd.iterfind(".//{*}Annotation")} - {ANNOTATION}
        if types:
            yield f"annotations of other tools are ignored: {', '.join(sorted(types))}"

    # -- components -----------------------------------------------------------------------------------

    def _component(self, node: SspComponent) -> Component:
        element, where = node.element, f"component '{node.name}'"
        kind, source = element.get("type") or _DEFAULT_TYPE, element.get("source")
        if kind not in (_DEFAULT_TYPE, BLOCK_TYPE):
            raise InputError(f"{where}: type '{kind}' is not read; only FMUs ({_DEFAULT_TYPE}) are")
        if not source:
            raise InputError(f"{where}: names no source file")
        path = node.origin.package.file(source, where)
        if kind == BLOCK_TYPE:
            return _block(node.name, path)
        own = own_annotation(element, "Component")
        component = FmuComponent(
            name=node.name,
            file=str(path),
            interface=_interface(element.get("implementation") or "any", where),
            units={c.name: c.unit for c in node.connectors.values() if c.unit},
            step=_optional(own, "step"),
            solver="auto" if own is None else own.get("solver") or "auto",
            dependencies="declared" if own is None else own.get("dependencies") or "declared",
            called=node.origin.package.name_of(path),
        )
        try:
            self.fmus[node.path] = _Fmu(component, fmu_facts(component.file, component.called))
        except WorkbenchError as error:
            raise InputError(f"{where}: {error}") from None
        return component

    def _unit(self, key: Key) -> str | None:
        """Return the unit of a variable of an FMU, else what its connector says."""
        fmu = self.fmus.get(key[0])
        variable = None if fmu is None else fmu.facts.variables.get(key[1])
        if variable is not None and variable.unit:
            return variable.unit
        connector = self.nodes[key[0]].connectors.get(key[1])
        return None if connector is None else connector.unit

    def _show_all(self, flat: FlatSystem, flattener: Flattener) -> None:
        """Give a system without inputs and outputs of its own those of its components, under their full names."""
        for path, fmu in self.fmus.items():
            for variable in fmu.facts.variables.values():
                key = (path, variable.name)
                if variable.causality == "output" and variable.is_number:
                    flat.outputs[full_name(key)] = full_name(key)
                elif variable.causality == "input" and variable.is_number and not flattener.incoming.get(key):
                    flat.inputs[full_name(key)] = [full_name(key)]
        self.notes.append("the system names no inputs and outputs: those of its components are shown, by full name")

    # -- parameters -----------------------------------------------------------------------------------

    def _values(self, root: SspComponent, flattener: Flattener) -> dict[str, dict[str, Value]]:
        """Return component → variable → value."""
        bound = bound_parameters(root, self.notes)
        for end in flattener.incoming:
            if end[0] in self.fmus:
                handed = _handed_over(end, flattener, bound)
                if handed is not None:
                    bound[end] = handed
        result: dict[str, dict[str, Value]] = {}
        for key, parameter in bound.items():
            node = flattener.nodes[key[0]]
            if not node.is_system:
                result.setdefault(node.name, {}).update(self._value(node, key, parameter))
        return result

    def _value(self, node: SspComponent, key: Key, parameter: Parameter) -> dict[str, Value]:
        fmu = self.fmus.get(key[0])
        if fmu is None:
            self.notes.append(f"{parameter.where}: '{node.name}' is not an FMU; its parameter {key[1]} is ignored")
            return {}
        values = values_for(key[1], parameter, fmu.facts, self._unit(key))
        if not values:
            hint = suggest(key[1], fmu.facts.variables)
            self.notes.append(f"{parameter.where}: '{key[1]}' is not a variable of '{node.name}'; ignored ({hint})")
        return values


def _odd_units(units: Mapping[str, Unit]) -> Iterator[str]:
    """Yield a note for every definition that differs from what the symbol stands for usually."""
    for name, unit in units.items():
        usual = known_unit(name)
        if usual is None:
            continue
        # Whether rad counts as a base unit is a matter of taste.
        same = unit.exponents[:-1] == usual.exponents[:-1] and math.isclose(unit.factor, usual.factor, rel_tol=1e-3)
        if not same or not math.isclose(unit.offset, usual.offset, rel_tol=1e-3):
            yield (
                f"unit '{name}' is defined with factor {unit.factor:g} and offset {unit.offset:g} to base units, but "
                f"usually has {usual.factor:g} and {usual.offset:g}; conversions follow the file: check it"
            )


def _handed_over(end: Key, flattener: Flattener, bound: Mapping[Key, Parameter]) -> Parameter | None:
    """Return the value that a system's connector hands down to `end`; None: none is bound there."""
    for hop in flattener.incoming.get(end, []):
        if not flattener.nodes[hop.start[0]].is_system:
            continue
        result = _handed_over(hop.start, flattener, bound) or bound.get(hop.start)
        if result is not None:
            factor, offset = hop.gain * result.factor, hop.gain * result.offset + hop.offset
            return replace(result, factor=factor, offset=offset, convert=result.convert and hop.convert)
    return None


def _with_values(component: Component, values: Mapping[str, Mapping[str, Value]]) -> Component:
    if not isinstance(component, FmuComponent) or component.name not in values:
        return component
    return replace(component, set=values[component.name])


def _interface(implementation: str, where: str) -> str:
    if implementation not in _INTERFACES:
        raise InputError(
            f"{where}: implementation '{implementation}' is not run; {suggest(implementation, _INTERFACES)}"
        )
    return _INTERFACES[implementation]


def _optional(element: Element | None, attribute: str) -> float | None:
    if element is None or element.get(attribute) is None:
        return None
    return number(element, attribute, 0.0, tag(element))


def _block(name: str, path: Path) -> Component:
    try:
        data = from_json(content_of(path).decode("utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"component '{name}': {path.name} is not JSON: {error}") from None
    if isinstance(data, dict) and (others := data.keys() & _OF_FILES):
        raise InputError(f"component '{name}': {path.name} names another file ('{min(others)}'); write it out there")
    return read_component(name, data, path.parent)


def _experiment(element: Element | None) -> DefaultExperiment:
    own = own_annotation(element, "Experiment")
    return DefaultExperiment(
        _optional(element, "startTime"),
        _optional(element, "stopTime"),
        _optional(own, "tolerance"),
        _optional(own, "step"),
    )

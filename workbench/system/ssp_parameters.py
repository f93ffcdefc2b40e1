"""Parameter sets and mappings of SSP (.ssv, .ssm, inline): which value goes to which variable."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

from workbench.errors import InputError
from workbench.system.fmu_facts import read_units
from workbench.system.ssp_tree import Key, Node
from workbench.system.ssp_xml import Element, Package, boolean, children, descend, linear, number, parse, tag
from workbench.system.units import Unit

__all__ = ["Parameter", "bound_parameters"]

_SET, _MAPPING = "application/x-ssp-parameter-set", "application/x-ssp-parameter-mapping"


@dataclass(frozen=True)
class Parameter:
    """A value that a parameter set gives.

    Attributes:
        type: local name of its element: "Real", "Integer", "Boolean", "String", "Enumeration", "Float64", …
        text: the value as written.
        unit: as written; None: none.
        enumeration: name of the enumeration that `text` is an item of; None: not said.
        factor, offset: of the mapping.
        convert: whether the unit is converted to the variable's.
        units, enumerations: definitions beside the set.
        where: the set, for messages.
    """

    type: str
    text: str
    where: str
    unit: str | None = None
    enumeration: str | None = None
    factor: float = 1.0
    offset: float = 0.0
    convert: bool = True
    units: Mapping[str, Unit] = field(default_factory=dict)
    enumerations: Mapping[str, Mapping[str, int]] = field(default_factory=dict)


def bound_parameters(root: Node, package: Package, definitions: Element, notes: list[str]) -> dict[Key, Parameter]:
    """Return the value of every bound variable or connector.

    Bindings of a higher system take precedence over those below, later ones of an element over earlier ones.

    Args:
        root: the tree.
        package: where parameter files are.
        definitions: the SSD's root, with its units and enumerations.
        notes: remarks are appended.

    Raises:
        InputError: a file that is missing or broken, a kind of source that is not read.
    """
    found: dict[Key, Parameter] = {}
    for node in sorted(root.walk(), key=lambda n: -len(n.path)):
        for binding in children(node.element, "ParameterBindings", "ParameterBinding"):
            for name, parameter in _binding(binding, f"ParameterBinding of '{node.name}'", package, definitions):
                key = _target(node, name)
                if key is None:
                    notes.append(f"{parameter.where}: '{name}' is not a parameter of system '{node.name}'; ignored")
                else:
                    found[key] = parameter
    return found


def _target(node: Node, name: str) -> Key | None:
    """Return the connector or variable that a name means as seen from `node`."""
    if not node.is_system or name in node.connectors:
        return node.path, name
    for child in sorted(node.nodes, key=len, reverse=True):
        if name.startswith(f"{child}."):
            inner = _target(node.nodes[child], name[len(child) + 1 :])
            if inner is not None:
                return inner
    return None


def _binding(
    binding: Element,
    where: str,
    package: Package,
    definitions: Element,
) -> Iterator[tuple[str, Parameter]]:
    """Yield target names and values of one binding, prefix and mapping applied."""
    _check_type(binding, _SET, where)
    mapping = _mapping(binding, where, package)
    for parameter_set, source in _sets(binding, where, package):
        for name, parameter in _values(parameter_set, source, definitions):
            prefixed = (binding.get("prefix") or "") + name
            if mapping is None:
                yield prefixed, parameter
            else:
                yield from _mapped(prefixed, parameter, mapping)


def _check_type(element: Element, expected: str, where: str) -> None:
    given = element.get("type") or expected
    if given != expected:
        raise InputError(f"{where}: type '{given}' is not read; only {expected} is")
    if element.get("sourceBase") == "component":
        raise InputError(f"{where}: sourceBase='component' is not read; put the file beside the SSD")


def _sets(binding: Element, where: str, package: Package) -> Iterator[tuple[Element, str]]:
    source = binding.get("source")
    if source:
        path = package.file(source, where)
        yield parse(path, "ParameterSet"), path.name
    for inline in children(binding, "ParameterValues", "ParameterSet"):
        yield inline, where


def _values(parameter_set: Element, where: str, definitions: Element) -> Iterator[tuple[str, Parameter]]:
    units = {**read_units(definitions), **read_units(parameter_set)}
    enumerations = {**_enumerations(definitions), **_enumerations(parameter_set)}
    for element in children(parameter_set, "Parameters", "Parameter"):
        name = element.get("name") or ""
        value = next((c for c in element if tag(c) not in ("Annotations", "Dimension")), None)
        if value is None or value.get("value") is None:
            raise InputError(f"{where}: parameter '{name}' has no value")
        yield (
            name,
            Parameter(
                type=tag(value),
                text=value.get("value"),
                where=where,
                unit=value.get("unit") or None,
                enumeration=value.get("name") if tag(value) == "Enumeration" else None,
                units=units,
                enumerations=enumerations,
            ),
        )


def _enumerations(element: Element) -> dict[str, dict[str, int]]:
    return {
        e.get("name") or "": {
            i.get("name") or "": int(number(i, "value", 0.0, "Enumerations")) for i in children(e, "Item")
        }
        for e in children(element, "Enumerations", "Enumeration")
    }


# -- mappings ------------------------------------------------------------------------------------


def _mapping(binding: Element, where: str, package: Package) -> list[Element] | None:
    """Return the entries of a binding's mapping; None: it has none, names count as they are."""
    element = descend(binding, "ParameterMapping")
    if element is None:
        return None
    _check_type(element, _MAPPING, where)
    source = element.get("source")
    if source:
        path = package.file(source, where)
        return list(children(parse(path, "ParameterMapping"), "MappingEntry"))
    inline = descend(element, "ParameterMapping")
    return list(children(element if inline is None else inline, "MappingEntry"))


def _mapped(name: str, parameter: Parameter, entries: list[Element]) -> Iterator[tuple[str, Parameter]]:
    for entry in entries:
        if entry.get("source") != name:
            continue
        target = entry.get("target") or ""
        where = f"{parameter.where}: mapping {name} → {target}"
        for transformation in entry:
            if tag(transformation) not in ("LinearTransformation", "Annotations"):
                raise InputError(f"{where}: {tag(transformation)} is not read; only LinearTransformation is")
        factor, offset = linear(entry, where)
        convert = not boolean(entry, "suppressUnitConversion")
        yield target, replace(parameter, factor=factor, offset=offset, convert=convert)

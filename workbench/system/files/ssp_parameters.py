"""Parameter sets and mappings of SSP (.ssv, .ssm, inline): which value goes to which variable."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace

from workbench.core.records.names_in_text import plain_unit
from workbench.core.values.conversion import Unit
from workbench.errors import InputError
from workbench.system.files.ssp_tree import Key, SspComponent
from workbench.system.files.ssp_xml import Element, Files, boolean, children, descend, linear, number, tag
from workbench.system.fmu_facts import read_units

__all__ = ["Parameter", "bound_parameters", "values_in"]

_SET, _MAPPING = "application/x-ssp-parameter-set", "application/x-ssp-parameter-mapping"


@dataclass(frozen=True)
class Parameter:
    """A value that a parameter set gives.

    Attributes:
        type: local name of its element: "Real", "Integer", "Boolean", "String", "Enumeration", "Float64", …
        texts: the value as written; of an array, each element in row-major order.
        unit: as written; None: none.
        enumeration: name of the enumeration that a value is an item of; None: not said.
        factor, offset: of the mapping.
        convert: whether the unit is converted to the variable's.
        units, enumerations: definitions beside the set.
        where: the set, for messages.
    """

    type: str
    texts: tuple[str, ...]
    where: str
    unit: str | None = None
    enumeration: str | None = None
    factor: float = 1.0
    offset: float = 0.0
    convert: bool = True
    units: Mapping[str, Unit] = field(default_factory=dict)
    enumerations: Mapping[str, Mapping[str, int]] = field(default_factory=dict)


def bound_parameters(root: SspComponent, notes: list[str]) -> dict[Key, Parameter]:
    """Return the value of every bound variable or connector.

    Bindings of a higher system take precedence over those below, later ones of an element over earlier ones.

    Args:
        root: the tree.
        notes: remarks are appended.

    Raises:
        InputError: a file that is missing or broken, a kind of source that is not read.
    """
    result: dict[Key, Parameter] = {}
    for node in sorted(root.walk(), key=lambda n: -len(n.path)):
        for binding, origin in node.bindings:
            files = Files(origin.package, None if node.is_system else node.element.get("source"))
            for name, parameter in _binding(binding, f"ParameterBinding of '{node.name}'", files, origin.ssd):
                key = _target(node, name)
                if key is None:
                    notes.append(f"{parameter.where}: '{name}' is not a parameter of system '{node.name}'; ignored")
                else:
                    result[key] = parameter
    return result


def _target(node: SspComponent, name: str) -> Key | None:
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
    files: Files,
    definitions: Element,
) -> Iterator[tuple[str, Parameter]]:
    """Yield target names and values of one binding, prefix and mapping applied."""
    _check_type(binding, _SET, where)
    mapping = _mapping(binding, where, files)
    for parameter_set, source in _sets(binding, where, files):
        for name, parameter in values_in(parameter_set, source, definitions):
            prefixed = (binding.get("prefix") or "") + name
            if mapping is None:
                yield prefixed, parameter
            else:
                yield from _mapped(prefixed, parameter, mapping)


def _check_type(element: Element, expected: str, where: str) -> None:
    given = element.get("type") or expected
    if given != expected:
        raise InputError(f"{where}: type '{given}' is not read; only {expected} is")


def _sets(binding: Element, where: str, files: Files) -> Iterator[tuple[Element, str]]:
    source = binding.get("source")
    if source:
        yield files.root(binding, source, "ParameterSet", where), source.rpartition("/")[2]
    for inline in children(binding, "ParameterValues", "ParameterSet"):
        yield inline, where


def values_in(parameter_set: Element, where: str, definitions: Element) -> Iterator[tuple[str, Parameter]]:
    """Yield the names and values of a parameter set.

    Args:
        parameter_set: root of an .ssv file, or the element in an .ssd file.
        where: its file, for messages.
        definitions: root of the file whose units and enumerations it may use besides its own.

    Raises:
        InputError: a parameter has no value.
    """
    units = {**read_units(definitions), **read_units(parameter_set)}
    enumerations = {**_enumerations(definitions), **_enumerations(parameter_set)}
    for element in children(parameter_set, "Parameters", "Parameter"):
        name = element.get("name") or ""
        value = next((c for c in element if tag(c) not in ("Annotations", "Dimension", "MetaData")), None)
        texts = _texts(value)
        if value is None or not texts:
            raise InputError(f"{where}: parameter '{name}' has no value")
        yield (
            name,
            Parameter(
                type=tag(value),
                texts=texts,
                where=where,
                unit=plain_unit(value.get("unit") or "") or None,
                enumeration=value.get("name") if tag(value) == "Enumeration" else None,
                units=units,
                enumerations=enumerations,
            ),
        )


def _texts(value: Element | None) -> tuple[str, ...]:
    """Return the values of a parameter, in SSP 2.0 as elements or in a list where it is an array."""
    if value is None:
        return ()
    given = value.get("value")
    listed = tuple(v.get("value") or "" for v in children(value, "Value"))
    if given is None or listed:
        return listed
    return (given,) if tag(value) == "String" else tuple(given.split()) or (given,)


def _enumerations(element: Element) -> dict[str, dict[str, int]]:
    return {
        e.get("name") or "": {
            i.get("name") or "": int(number(i, "value", 0.0, "Enumerations")) for i in children(e, "Item")
        }
        for e in children(element, "Enumerations", "Enumeration")
    }


# -- mappings ------------------------------------------------------------------------------------


def _mapping(binding: Element, where: str, files: Files) -> list[Element] | None:
    """Return the entries of a binding's mapping; None: it has none, names count as they are."""
    element = descend(binding, "ParameterMapping")
    if element is None:
        return None
    _check_type(element, _MAPPING, where)
    source = element.get("source")
    if source:
        return list(children(files.root(element, source, "ParameterMapping", where), "MappingEntry"))
    inline = descend(element, "ParameterMapping")
    return list(children(element if inline is None else inline, "MappingEntry"))


def _mapped(name: str, parameter: Parameter, entries: list[Element]) -> Iterator[tuple[str, Parameter]]:
    for entry in entries:
        if entry.get("source") != name:
            continue
        target = entry.get("target") or ""
        where = f"{parameter.where}: mapping {name} → {target}"
        factor, offset = linear(entry, where)
        convert = not boolean(entry, "suppressUnitConversion")
        texts = _looked_up(parameter.texts, entry, where)
        yield target, replace(parameter, texts=texts, factor=factor, offset=offset, convert=convert)


def _looked_up(texts: tuple[str, ...], entry: Element, where: str) -> tuple[str, ...]:
    """Return values as the table of a mapping transformation gives them, where an entry has one."""
    for transformation in entry:
        name = tag(transformation)
        if name in ("LinearTransformation", "Annotations", "MetaData"):
            continue
        if name not in _TABLES:
            raise InputError(f"{where}: {name} is not read; known are LinearTransformation, {', '.join(_TABLES)}")
        same = _TABLES[name]
        table = {same(e.get("source") or ""): e.get("target") or "" for e in children(transformation, "MapEntry")}
        for text in texts:
            if same(text) not in table:
                raise InputError(f"{where}: the {name} has no entry for '{text}'; it has: {', '.join(table)}")
        texts = tuple(table[same(text)] for text in texts)
    return texts


def _truth(text: str) -> str:
    return {"1": "true", "0": "false"}.get(text.strip(), text.strip())


# Transformation → what makes values that mean the same alike.
_TABLES: Mapping[str, Callable[[str], str]] = {
    "BooleanMappingTransformation": _truth,
    "IntegerMappingTransformation": str.strip,
    "EnumerationMappingTransformation": str,
}

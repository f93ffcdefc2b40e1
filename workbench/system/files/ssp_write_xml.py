"""Elements of SSP 1.0 as they are written: connectors, parameters, units, annotations."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from lxml import etree

from workbench.core.values.conversion import BASE_UNITS, Unit
from workbench.errors import InputError
from workbench.fmi.variable import FLOAT_TYPES, Value
from workbench.system.description import FmuComponent
from workbench.system.files.ssp_xml import NAMESPACES, Element
from workbench.system.fmu_facts import FmuInterface

__all__ = [
    "add_annotation",
    "add_connector",
    "add_enumerations",
    "add_parameters",
    "add_units",
    "attributes",
    "element",
    "number_text",
    "serialise",
    "ssp_type",
]

_OWN = "urn:fmi-workbench:ssp"


# Names of attributes → values; those that are None are left out.
Values = Mapping[str, float | str | None]
_NONE: Values = MappingProxyType({})


def element(name: str, parent: Element | None, values: Values = _NONE) -> Element:
    """Return a new element "prefix:Name" below `parent` (None: a root), attributes in the order given."""
    prefix, _, local = name.partition(":")
    qualified = f"{{{NAMESPACES[prefix]}}}{local}"
    if parent is None:
        return etree.Element(qualified, attributes(values), nsmap=NAMESPACES)
    return etree.SubElement(parent, qualified, attributes(values))


def attributes(values: Values) -> dict[str, str]:
    """Return the values that are there, as text."""
    return {k: v if isinstance(v, str) else number_text(v) for k, v in values.items() if v is not None}


def number_text(value: float) -> str:
    """Return the shortest text that is read back as the same number."""
    return repr(float(value))


def serialise(root: Element) -> bytes:
    """Return the XML document."""
    data: bytes = etree.tostring(root, xml_declaration=True, encoding="UTF-8", pretty_print=True)
    return data


def ssp_type(kind: str, *, enumeration: bool = False) -> str:
    """Return the type of SSP 1.0 for one of FMI."""
    if kind in FLOAT_TYPES:
        return "Real"
    if kind in ("Boolean", "String", "Binary"):
        return kind
    return "Enumeration" if enumeration else "Integer"


def add_connector(
    parent: Element,
    name: str,
    kind: str,
    variable_type: str,
    *,
    unit: str | None,
    enumeration: str | None,
) -> None:
    """Add a Connector with its type."""
    connector = element("ssd:Connector", parent, {"name": name, "kind": kind})
    local = ssp_type(variable_type, enumeration=enumeration is not None)
    named = enumeration if local == "Enumeration" else None
    element(f"ssc:{local}", connector, {"unit": unit if local == "Real" else None, "name": named})


def add_parameters(parent: Element, component: FmuComponent, facts: FmuInterface) -> None:
    """Add the component's values as an inline parameter set."""
    binding = element("ssd:ParameterBinding", element("ssd:ParameterBindings", parent))
    values = element("ssd:ParameterValues", binding)
    parameter_set = element("ssv:ParameterSet", values, {"version": "1.0", "name": component.name})
    parameters = element("ssv:Parameters", parameter_set)
    for name, value in _values(component, facts).items():
        variable = facts.variables.get(name)
        kind = "String" if variable is None else variable.type
        _add_parameter(parameters, name, value, kind, facts.items.get(name, {}))


def _values(component: FmuComponent, facts: FmuInterface) -> dict[str, Value]:
    """Return the component's values in their types, arrays by their elements.

    Where a structural parameter is set, the sizes of arrays are not those of the file, and whole arrays stay texts.
    """
    known = (facts.variables.get(name) for name in component.set)
    sized = any(v is not None and v.causality == "structuralParameter" for v in known)
    left = {n: value for n, value in component.set.items() if sized and n not in facts.variables}
    try:
        return {**facts.starts({n: value for n, value in component.set.items() if n not in left}), **left}
    except InputError as error:
        raise InputError(f"component {component.name}: {error}") from None


def _add_parameter(parent: Element, name: str, value: Value, kind: str, items: Mapping[str, int]) -> None:
    parameter = element("ssv:Parameter", parent, {"name": name})
    item = next((i for i, number in items.items() if str(number) == str(value)), None)
    local = ssp_type(kind, enumeration=item is not None)
    element(f"ssv:{local}", parameter, {"value": item if item is not None else _text(value, local)})


def _text(value: Value, local: str) -> str:
    if local == "Real":
        return number_text(float(value))
    if local == "Boolean":
        return "true" if str(value).lower() in ("true", "1", "1.0") else "false"
    return str(value)


def add_units(root: Element, units: Mapping[str, Unit]) -> None:
    """Add the definitions of units, if there are any."""
    if not units:
        return
    parent = element("ssd:Units", root)
    for name, unit in units.items():
        exponents = {b: str(e) for b, e in zip(BASE_UNITS, unit.exponents, strict=True) if e}
        scale = {
            "factor": None if unit.factor == 1.0 else unit.factor,
            "offset": None if unit.offset == 0.0 else unit.offset,
        }
        element("ssc:BaseUnit", element("ssc:Unit", parent, {"name": name}), {**exponents, **scale})


def add_enumerations(root: Element, enumerations: Mapping[str, Mapping[str, int]]) -> None:
    """Add the definitions of enumerations, if there are any."""
    if not enumerations:
        return
    parent = element("ssd:Enumerations", root)
    for name, items in enumerations.items():
        enumeration = element("ssc:Enumeration", parent, {"name": name})
        for item, value in items.items():
            element("ssc:Item", enumeration, {"name": item, "value": str(value)})


def add_annotation(parent: Element, kind: str, name: str, values: Values) -> None:
    """Add an annotation with one element of the workbench's own."""
    annotation = element("ssc:Annotation", element("ssd:Annotations", parent), {"type": kind})
    etree.SubElement(annotation, f"{{{_OWN}}}{name}", attributes(values), nsmap={None: _OWN})

"""Other sizes of an FMI 3.0 FMU: its description with other values of structural parameters."""

from __future__ import annotations

from collections.abc import Mapping
from io import BytesIO

from lxml import etree

from workbench.errors import InputError
from workbench.fmi.description import Description
from workbench.fmi.variable import Value

__all__ = ["STRUCTURAL", "structural_values", "with_structure"]

STRUCTURAL = "structuralParameter"


def structural_values(description: Description, values: Mapping[str, Value]) -> dict[str, int]:
    """Return those of the values that are of structural parameters.

    Args:
        description: the FMU's.
        values: name → value.

    Raises:
        InputError: one is no whole number, or outside what the FMU allows.
    """
    known = {v.name: v for v in description.variables if v.causality == STRUCTURAL}
    found = {}
    for name in known.keys() & values.keys():
        variable = known[name]
        found[name] = _whole(name, values[name])
        lowest, highest = variable.minimum or 0.0, variable.maximum
        if found[name] < lowest or (highest is not None and found[name] > highest):
            most = "" if highest is None else f" and at most {highest:g}"
            raise InputError(f"{name}: the FMU takes at least {lowest:g}{most}, not {found[name]}")
    return found


def _whole(name: str, value: Value) -> int:
    try:
        number = float(value)
    except ValueError:
        number = 0.5
    if not number.is_integer():
        raise InputError(f"{name}: a structural parameter takes a whole number, not '{value}'")
    return int(number)


def with_structure(data: bytes, values: Mapping[str, int]) -> bytes:
    """Return a modelDescription.xml in which structural parameters start with other values.

    Args:
        data: the file, well-formed and without a document type.
        values: name → value.
    """
    tree = etree.parse(BytesIO(data), etree.XMLParser(resolve_entities=False, no_network=True, huge_tree=True))
    for element in tree.getroot().iterfind("ModelVariables/*"):
        if element.get("causality") == STRUCTURAL and element.get("name") in values:
            element.set("start", str(values[element.get("name", "")]))
    return bytes(etree.tostring(tree, xml_declaration=True, encoding="UTF-8"))

"""Read a modelDescription.xml, element by element, and compare it with the schema of its version of FMI.

A first pass, in a twentieth of the time, makes sure that it is XML. The schemas are the standard's own, as they ship
with FMPy; libxml2 compares while it reads. A file that leaves its schema is read all the same; what is wrong is listed.
The tree is never built: an element is forgotten when it is read.
"""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Callable, Iterable, Mapping
from difflib import get_close_matches
from functools import lru_cache
from io import BytesIO
from pathlib import Path
from typing import Any

from lxml import etree

from workbench.errors import FmuError, one_line
from workbench.fmi.declared import (
    Alias,
    BaseUnit,
    Category,
    ClockVariable,
    Declared,
    DeclaredDisplayUnit,
    DeclaredExperiment,
    DeclaredType,
    DeclaredUnit,
    DeclaredVariable,
    Dimension,
    Interface,
    Item,
    Start,
    Unknown,
    fill,
)

__all__ = ["read_declared"]

Reader = Callable[[Declared, etree._Element], None]  # noqa: SLF001 - lxml has no public name for it

_SCHEMAS = {
    "1": "fmi1/fmiModelDescription.xsd",
    "2": "fmi2/fmi2ModelDescription.xsd",
    "3": "fmi3/fmi3ModelDescription.xsd",
}
# What a variable is; other attributes only say more of it.
_TELLING = (
    "name",
    "valueReference",
    "causality",
    "variability",
    "initial",
    "derivative",
    "previous",
    "clocks",
    "start",
)
_VIOLATION = re.compile(r"Element '(?P<tag>[^']*)'(?:, attribute '(?P<attribute>[^']*)')?: (?P<words>.*)", re.DOTALL)
_MISSING = re.compile(r"The attribute '(?P<attribute>[^']*)' is required but missing")
_INTEGERS = ("Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64")
_KINDS_2 = frozenset({"Real", "Integer", "Boolean", "String", "Enumeration"})  # of FMI 1.0 and 2.0
_KINDS_3 = ("Float32", "Float64", *_INTEGERS, "Boolean", "String", "Binary", "Enumeration", "Clock")
# FMI 2.0's word for a part of the model structure → FMI 3.0's element.
_STRUCTURE = {
    "Outputs": "Output",
    "Derivatives": "ContinuousStateDerivative",
    "ClockedStates": "ClockedState",
    "InitialUnknowns": "InitialUnknown",
    "EventIndicators": "EventIndicator",
}


def read_declared(data: bytes) -> Declared:
    """Return what a description says.

    Args:
        data: the file, without a document type.

    Raises:
        FmuError: not well-formed, an unknown version of FMI, or text where a number should be.
    """
    result = Declared()
    _check_form(data)
    _read_root(data, result)
    if _read_elements(data, result):
        result.problems, result.lost = _problems(data, result.root.fmi_version, result.problems)
    if result.major == 1:
        result.interfaces = result.interfaces or {"ModelExchange": Interface()}
        for interface in result.interfaces.values():
            interface.model_identifier = result.root.model_identifier
    return result


class _Nothing:
    """What lxml builds where only the form of a file is looked at."""

    def close(self) -> None:
        return None


def _check_form(data: bytes) -> None:
    """Refuse what is not well-formed; a parser that is given a schema may pass over it in silence (lxml 6)."""
    parser = etree.XMLParser(target=_Nothing(), resolve_entities=False, no_network=True)
    try:
        etree.fromstring(data, parser)
    except etree.XMLSyntaxError as error:
        raise FmuError(f"not well-formed: {error.msg}; copy or export the FMU again") from None
    for entry in parser.error_log.filter_from_errors():  # namespaces: nothing is raised for those without a tree
        where = f"line {entry.line}, column {entry.column}"
        raise FmuError(f"not well-formed: {entry.message}, {where}; copy or export the FMU again")


def _read_root(data: bytes, result: Declared) -> None:
    for _, root in etree.iterparse(BytesIO(data), events=("start",), resolve_entities=False, no_network=True):
        fill(result.root, root.items(), root.sourceline)
        break
    version = result.root.fmi_version
    if version not in ("1.0", "2.0") and not version.startswith("3."):
        raise FmuError(f'fmiVersion="{version[:20]}": FMI 1.0, 2.0 and 3.0 are known')


def _read_elements(data: bytes, result: Declared) -> bool:
    """Read all but the root; return whether the file leaves the schema."""
    steps = etree.iterparse(
        BytesIO(data),
        events=("end",),
        tag=_TAGS,
        schema=_schema(result.root.fmi_version[0]),
        resolve_entities=False,
        no_network=True,
    )
    try:
        for _, element in steps:
            reader = _READERS.get(_path(element))
            if reader is not None:
                reader(result, element)
                _forget(element)
    except etree.XMLSyntaxError:  # libxml2 goes on when the schema is left, and says so at the end
        return True
    return False


@lru_cache(maxsize=3)
def _schema(major: str) -> etree.XMLSchema:
    spec = importlib.util.find_spec("fmpy")
    (folder,) = spec.submodule_search_locations if spec and spec.submodule_search_locations else ("",)
    return etree.XMLSchema(file=str(Path(folder) / "schema" / _SCHEMAS[major]))


def _problems(data: bytes, version: str, before: list[str]) -> tuple[list[str], list[str]]:
    """Return where the file leaves the schema, by line, after what is known before, and what of it hides a variable.

    Only the tree as a whole has the lines.
    """
    schema = _schema(version[0])
    schema.validate(etree.parse(BytesIO(data), etree.XMLParser(resolve_entities=False, no_network=True)))
    found = {one_line(f"line {entry.line}: {entry.message}"): _hides(entry) for entry in schema.error_log}
    return [*before, *found], [text for text, hides in found.items() if hides]


def _hides(entry: etree._LogEntry) -> bool:
    """Whether a violation hides what a variable is: an attribute that tells it, or an element of no known type."""
    _, _, below = (entry.path or "").partition("/ModelVariables/")
    said = _VIOLATION.match(entry.message)
    if not below or said is None:
        return False
    missing = _MISSING.match(said["words"])
    if said["attribute"] is None and missing is None:
        return (
            "/" not in below and said["tag"] not in _TAGS and said["words"].startswith("This element is not expected")
        )
    attribute = missing["attribute"] if missing else said["attribute"]
    known = [name.lower() for name in _TELLING]
    return bool(get_close_matches(attribute.lower(), known, 1, 0.85))  # a misspelt one is not read


def _path(element: etree._Element) -> str:
    parts: list[str] = []
    above = element.getparent()
    while above is not None:
        parts.append(element.tag)
        element, above = above, above.getparent()
    return "/".join(reversed(parts))


def _forget(element: etree._Element) -> None:
    element.clear()
    parent = element.getparent()
    while element.getprevious() is not None:
        del parent[0]


# -- elements ----------------------------------------------------------------------------------


def _made(kind: type[Any], element: etree._Element) -> Any:
    made = kind()
    fill(made, element.items(), element.sourceline)
    return made


def _each(kind: type[Any], elements: Iterable[etree._Element]) -> list[Any]:
    return [_made(kind, element) for element in elements]


def _interface(result: Declared, element: etree._Element) -> None:
    if element.tag in result.interfaces:
        result.problems.append(f"line {element.sourceline}: {element.tag} is there twice; the last one holds")
    result.interfaces[element.tag] = _made(Interface, element)


def _implementation(result: Declared, element: etree._Element) -> None:
    """Read what FMI 1.0 says of co-simulation."""
    made = Interface()
    for capabilities in element.iter("Capabilities"):
        fill(made, capabilities.items(), capabilities.sourceline)
    made.needs_execution_tool = element.find("CoSimulation_Tool") is not None
    result.interfaces["CoSimulation"] = made


def _experiment(result: Declared, element: etree._Element) -> None:
    result.experiment = _made(DeclaredExperiment, element)


def _category(result: Declared, element: etree._Element) -> None:
    result.categories.append(_made(Category, element))


def _unit(result: Declared, element: etree._Element) -> None:
    made = _made(DeclaredUnit, element)
    made.base = _each(BaseUnit, element.iterchildren("BaseUnit"))
    made.display = _each(DeclaredDisplayUnit, element.iterchildren("DisplayUnit", "DisplayUnitDefinition"))
    result.units.append(made)


def _type(result: Declared, element: etree._Element) -> None:
    """Read a type; before FMI 3.0 it stands in an element inside."""
    inner = next(element.iterchildren("{*}*"), None) if element.tag in ("Type", "SimpleType") else element
    if inner is None:
        return
    made = _made(DeclaredType, inner)
    made.kind, made.name = inner.tag.removesuffix("Type"), element.get("name")
    made.items = _each(Item, inner.iterchildren("Item"))
    result.types.append(made)


def _scalar(result: Declared, element: etree._Element) -> None:
    """Read a variable of FMI 1.0 or 2.0."""
    made = _made(DeclaredVariable, element)
    made.line = element.sourceline
    for inner in element:
        if inner.tag in _KINDS_2:
            made.kind = inner.tag
            fill(made, inner.items(), inner.sourceline)
            break
    result.variables.append(made)


def _variable(result: Declared, element: etree._Element) -> None:
    """Read a variable of FMI 3.0."""
    made = _made(ClockVariable if element.tag == "Clock" else DeclaredVariable, element)
    made.kind, made.line = element.tag, element.sourceline
    if len(element):
        made.dimensions = _each(Dimension, element.iterchildren("Dimension"))
        made.aliases = _each(Alias, element.iterchildren("Alias"))
        made.starts = _each(Start, element.iterchildren("Start"))
    result.variables.append(made)


def _unknown(section: str) -> Reader:
    def read(result: Declared, element: etree._Element) -> None:
        made = _made(Unknown, element)
        made.line = element.sourceline
        result.structure.setdefault(section, []).append(made)

    return read


# Path below the root → what reads the element.
_READERS: Mapping[str, Reader] = {
    "ModelExchange": _interface,
    "CoSimulation": _interface,
    "ScheduledExecution": _interface,
    "Implementation": _implementation,
    "DefaultExperiment": _experiment,
    "LogCategories/Category": _category,
    "UnitDefinitions/Unit": _unit,
    "UnitDefinitions/BaseUnit": _unit,
    "TypeDefinitions/Type": _type,
    "TypeDefinitions/SimpleType": _type,
    **{f"TypeDefinitions/{kind}Type": _type for kind in _KINDS_3},
    "ModelVariables/ScalarVariable": _scalar,
    **{f"ModelVariables/{kind}": _variable for kind in _KINDS_3},
    **{f"ModelStructure/{section}/Unknown": _unknown(section) for section in _STRUCTURE},
    **{f"ModelStructure/{tag}": _unknown(section) for section, tag in _STRUCTURE.items()},
}
_TAGS = tuple({path.rpartition("/")[2] for path in _READERS})

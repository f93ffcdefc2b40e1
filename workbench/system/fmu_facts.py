"""What the description of an FMU tells without unpacking the FMU: variables, units, enumerations."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from lxml import etree

from workbench.core.names import plain_unit
from workbench.core.scratch import scratch
from workbench.errors import FmuError
from workbench.fmi.archive import DAMAGED, locate
from workbench.fmi.reading import MAX_XML_BYTES, read_description
from workbench.fmi.variable import Variable
from workbench.system.units import BASE_UNITS, Unit

__all__ = ["FmuFacts", "fmu_facts", "read_units"]

_DESCRIPTION = "modelDescription.xml"


@dataclass(frozen=True)
class FmuFacts:
    """What a system file needs to know about an FMU.

    Attributes:
        variables: by name, arrays taken apart.
        units: the FMU's UnitDefinitions that say what the unit is made of, by name.
        items: variable of an enumeration → item → value.
        interfaces: "me" and "cs", those offered.
    """

    variables: Mapping[str, Variable]
    units: Mapping[str, Unit]
    items: Mapping[str, Mapping[str, int]]
    interfaces: tuple[str, ...]


def fmu_facts(file: str) -> FmuFacts:
    """Return the facts about the FMU that `file` names: a path or `fmu:NAME`.

    Raises:
        InputError: nothing there.
        FmuError: no FMU, or its description cannot be read.
    """
    path = locate(file).resolve()
    described = path / _DESCRIPTION if path.is_dir() else path
    if not described.is_file():
        raise FmuError(f"{file}: no {_DESCRIPTION} inside; this is not an FMU")
    status = described.stat()
    return _facts(path, status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=64)
def _facts(path: Path, _changed: int, _size: int) -> FmuFacts:
    if path.is_dir():
        return _read(path, path)
    with scratch("facts") as folder:
        (folder / _DESCRIPTION).write_bytes(_description_in(path))
        return _read(folder, path)


def _description_in(path: Path) -> bytes:
    try:
        with zipfile.ZipFile(path) as archive:
            if archive.getinfo(_DESCRIPTION).file_size > MAX_XML_BYTES:
                raise FmuError(f"{path}: {_DESCRIPTION} is larger than {MAX_XML_BYTES >> 20} MiB")
            return archive.read(_DESCRIPTION)
    except KeyError:
        raise FmuError(f"{path}: no {_DESCRIPTION} inside; this is not an FMU") from None
    except DAMAGED:
        raise FmuError(f"{path}: not a zip archive or damaged; copy or export it again") from None
    except (OSError, RuntimeError, NotImplementedError) as error:
        raise FmuError(f"{path}: cannot be read: {error}") from None


def _read(folder: Path, path: Path) -> FmuFacts:
    description = read_description(folder, source=str(path))
    root = etree.parse(str(folder / _DESCRIPTION)).getroot()
    return FmuFacts(
        variables={v.name: v for v in description.variables},
        units=read_units(root),
        items=_items(root),
        interfaces=tuple(description.interfaces),
    )


def read_units(root: etree._Element) -> dict[str, Unit]:
    """Return the units that a document defines by base units, whatever the namespace.

    Args:
        root: of a description of FMI 2 or 3, of an SSD or of an SSP parameter set.
    """
    found = {}
    for element in (*root.iterfind("{*}UnitDefinitions/{*}Unit"), *root.iterfind("{*}Units/{*}Unit")):
        name, base = element.get("name"), element.find("{*}BaseUnit")
        if name is not None and base is not None:
            unit = _unit(plain_unit(name), base)
            if unit is not None:
                found[plain_unit(name)] = unit
    return found


def _unit(name: str, base: etree._Element) -> Unit | None:
    try:
        exponents = tuple(int(base.get(b, "0")) for b in BASE_UNITS)
        unit = Unit(name, exponents, float(base.get("factor", "1")), float(base.get("offset", "0")))
    except ValueError:
        return None
    return unit if unit.factor != 0.0 else None


def _items(root: etree._Element) -> dict[str, dict[str, int]]:
    """Return the items of the enumerations that variables are of; FMI 2 and 3 write their types differently."""
    types = {t.get("name"): _type_items(t) for t in root.iterfind("{*}TypeDefinitions/*")}
    found = {}
    for variable in root.iterfind("{*}ModelVariables/*"):
        inner = variable.find("{*}Enumeration")
        declared = (variable if inner is None else inner).get("declaredType")
        if types.get(declared):
            found[variable.get("name", "")] = types[declared]
    return found


def _type_items(element: etree._Element) -> dict[str, int]:
    items: dict[str, int] = {}
    for item in element.iterfind(".//{*}Item"):
        # FMI 1.0 numbers its items from 1 by their order.
        items[item.get("name", "")] = int(item.get("value", len(items) + 1))
    return items

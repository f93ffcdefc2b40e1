"""What the description of an FMU tells without unpacking the FMU: variables, units, enumerations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from lxml import etree

from workbench.core.records.names_in_text import plain_unit
from workbench.core.values.conversion import BASE_UNITS, Unit
from workbench.errors import FmuError
from workbench.fmi.archive import locate
from workbench.fmi.description import ModelDescription, UnitDefinition
from workbench.fmi.reading import DESCRIPTION, described_at
from workbench.fmi.variable import Value, Variable
from workbench.model.starts import check_starts

__all__ = ["FmuInterface", "facts_of", "fmu_facts", "read_units"]


@dataclass(frozen=True)
class FmuInterface:
    """What a system file needs to know about an FMU.

    Attributes:
        variables: by name, arrays taken apart.
        units: the FMU's UnitDefinitions that say what the unit is made of, by name.
        items: variable of an enumeration → item → value.
        interfaces: "me" and "cs", those offered.
        definitions: all that the FMU says of its units, by name.
    """

    variables: Mapping[str, Variable]
    units: Mapping[str, Unit]
    items: Mapping[str, Mapping[str, int]]
    interfaces: tuple[str, ...]
    definitions: Mapping[str, UnitDefinition]

    def starts(self, values: Mapping[str, Value]) -> dict[str, Value]:
        """Return values in their variables' types; see `check_starts`, which says what is refused.

        Args:
            values: name → value, as a system file has them.
        """
        types = {self.variables[n].declared_type or "": items for n, items in self.items.items()}
        return check_starts(values, self.variables, types, self.definitions)


def fmu_facts(file: str, called: str = "") -> FmuInterface:
    """Return the facts about the FMU that `file` names.

    Args:
        file: a path or `fmu:NAME`.
        called: what the user calls it, where that is not the file.

    Raises:
        InputError: nothing there.
        FmuError: not an FMU, or its description cannot be read.
    """
    path = locate(file).resolve()
    described = path / DESCRIPTION if path.is_dir() else path
    if not described.is_file():
        raise FmuError(f"{called or file}: no {DESCRIPTION} inside; this is not an FMU")
    status = described.stat()
    return _facts(path, called or str(path), status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=64)
def _facts(path: Path, called: str, _changed: int, _size: int) -> FmuInterface:
    return facts_of(described_at(path, called))


def facts_of(description: ModelDescription) -> FmuInterface:
    """Return the facts that a description tells.

    Args:
        description: of an FMU.
    """
    made = {name: unit.unit(name) for name, unit in description.units.items()}
    return FmuInterface(
        variables={v.name: v for v in description.variables},
        units={name: unit for name, unit in made.items() if unit is not None},
        items={
            v.name: description.enumerations[v.declared_type]
            for v in description.variables
            if v.declared_type is not None and v.declared_type in description.enumerations
        },
        interfaces=tuple(description.interfaces),
        definitions=description.units,
    )


def read_units(root: etree._Element) -> dict[str, Unit]:
    """Return the units that a document defines by base units, whatever the namespace.

    Args:
        root: of an SSD or of an SSP parameter set.
    """
    result = {}
    for element in root.iterfind("{*}Units/{*}Unit"):
        name, base = element.get("name"), element.find("{*}BaseUnit")
        if name is not None and base is not None:
            unit = _unit(plain_unit(name), base)
            if unit is not None:
                result[plain_unit(name)] = unit
    return result


def _unit(name: str, base: etree._Element) -> Unit | None:
    try:
        exponents = tuple(int(base.get(b, "0")) for b in BASE_UNITS)
        unit = Unit(name, exponents, float(base.get("factor", "1")), float(base.get("offset", "0")))
    except ValueError:
        return None
    return unit if unit.factor != 0.0 else None

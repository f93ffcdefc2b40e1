"""Read the checked DAE that the Modelica front end returns.

The front end's JSON keeps its pools (expressions, operands, subscripts) flat; this module is the only
place that knows their layout. Its schema has a version, and any other version is refused: a silent
misreading would build a wrong FMU.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from workbench.errors import BuildError

SCHEMA_VERSION = 43

# A quotient owner (mod, div, rem) takes its own number and six more that the pool does not list.
_HIDDEN_AFTER_QUOTIENT = 6

Json = Any  # what json.loads returns: the layout is checked where it is read


@dataclass(frozen=True, slots=True)
class Source:
    """One Modelica source text."""

    file: str
    text: str

    def line(self, offset: int) -> int:
        """Return the line number, from 1, at a byte offset."""
        return self.text.encode()[:offset].count(b"\n") + 1

    def excerpt(self, start: int, end: int) -> str:
        """Return the text between two byte offsets on one line."""
        return " ".join(self.text.encode()[start:end].decode(errors="replace").split())


@dataclass(frozen=True, slots=True)
class SourceLocation:
    """Where something stands in the Modelica source."""

    file: str
    line: int
    text: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line}"


@dataclass(frozen=True, slots=True)
class ValueType:
    """Scalar kind ("real", "integer", "boolean", "enumeration", "string") and dimensions."""

    scalar: str
    dimensions: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class IrVariable:
    """One declared variable, still an array where it was declared as one."""

    name: str
    role: str
    variability: str
    type: ValueType
    attributes: Mapping[str, Json]
    place: SourceLocation

    @property
    def causality(self) -> str:
        return str(self.attributes["causality"])


class Dae:
    """The front end's DAE with its pools resolved.

    Obligations: `node(i)` returns the expression with number i as {"kind": {...}}; `operands(i)` its
    operand numbers and `subscripts(i)` its subscripts, which the pool keeps in the order of the nodes.
    """

    def __init__(self, json: Json, flat: Json) -> None:
        version = json.get("schema_version")
        if version != SCHEMA_VERSION:
            raise BuildError(
                f"the Modelica front end speaks schema {version}, this generator schema {SCHEMA_VERSION}; "
                'install the pinned versions: pip install "fmi-workbench[build]"'
            )
        self.storage: Json = json["storage"]
        self.sources = {
            number: Source(Path(file).name, text) for number, file, text in json.get("source_map", {}).get("files", [])
        }
        self._read_expressions()
        self.variables = [self._variable(entry) for entry in self.storage["variables"]]
        self.enumerations = self._enumerations(flat)

    def _read_expressions(self) -> None:
        pool = self.storage["expressions"]
        operands, subscripts = list(pool["operands"]), list(pool["subscripts"])
        self._nodes: dict[int, Json] = {}
        self._operands: dict[int, list[int]] = {}
        self._subscripts: dict[int, list[Json]] = {}
        self._places: dict[int, Json] = {}
        number = next_operand = next_subscript = 0
        for node, provenance in zip(pool["nodes"], pool["provenance"], strict=True):
            body = next(iter(node.values())) if isinstance(node, dict) else None
            n_operands = body.get("operand_count", 0) if isinstance(body, dict) else 0
            n_subscripts = body.get("subscript_count", 0) if isinstance(body, dict) else 0
            self._nodes[number] = node
            self._places[number] = provenance
            self._operands[number] = operands[next_operand : next_operand + n_operands]
            self._subscripts[number] = subscripts[next_subscript : next_subscript + n_subscripts]
            next_operand += n_operands
            next_subscript += n_subscripts
            number += 1
            if "runtime_quotient_owner" in node:
                number += _HIDDEN_AFTER_QUOTIENT
        if next_operand != len(operands) or next_subscript != len(subscripts):
            raise BuildError("the Modelica front end's expression pool is inconsistent; please report this model")

    def _variable(self, entry: Json) -> IrVariable:
        return IrVariable(
            name=entry["name"],
            role=entry["role"],
            variability=entry["variability"],
            type=self.value_type(entry["value_type"]),
            attributes=entry["attributes"],
            place=self.place(entry["declaration"]),
        )

    def _enumerations(self, flat: Json) -> dict[str, list[str]]:
        """Return {variable: literal names}; only the flat form knows the names."""
        ordinals: Json = flat.get("enum_literal_ordinals") or {}
        by_type: dict[str, list[tuple[int, str]]] = {}
        for full_name, ordinal in ordinals.items():
            type_name, _, literal = full_name.rpartition(".")
            by_type.setdefault(type_name, []).append((int(ordinal), literal))
        names: Json = flat.get("variable_type_names") or {}
        result: dict[str, list[str]] = {}
        for variable, type_name in names.items():
            for candidate, literals in by_type.items():
                if candidate == type_name or candidate.endswith("." + str(type_name)):
                    result[variable] = [literal for _, literal in sorted(literals)]
        return result

    def value_type(self, number: int) -> ValueType:
        entry = self.storage["value_types"][number]
        return ValueType(entry["scalar"], tuple(entry["dimensions"]))

    def node(self, number: int) -> Json:
        return self._nodes[number]

    def operands(self, number: int) -> Sequence[int]:
        return self._operands[number]

    def subscripts(self, number: int) -> Sequence[Json]:
        return self._subscripts[number]

    def place(self, provenance: Json) -> SourceLocation:
        span = provenance.get("span", provenance)
        source = self.sources.get(span.get("source"))
        if source is None:
            return SourceLocation("(generated)", 0, "")
        return SourceLocation(source.file, source.line(span["start"]), source.excerpt(span["start"], span["end"]))

    def place_of(self, expression: int) -> SourceLocation:
        return self.place(self._places[expression])

    def binders(self, domain: int) -> list[Json]:
        """Return the loop variables of a domain, the outer ones first."""
        entry = self.storage["domains"][domain]
        outer = [] if entry["parent"] is None else self.binders(entry["parent"])
        return [*outer, *entry["domain"]["binders"]]

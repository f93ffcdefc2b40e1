"""The tables of a system file (.toml) as pydantic models, and their errors in one line."""

from __future__ import annotations

import inspect
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import MISSING, fields
from types import MappingProxyType
from typing import Any, Literal, TypeVar, get_type_hints

from pydantic import BaseModel, ConfigDict, Field, ValidationError, create_model

from workbench.errors import InputError, suggest

__all__ = [
    "ExperimentTable",
    "FmuTable",
    "LinearFileTable",
    "LinearTable",
    "SumTable",
    "SystemTable",
    "TomlTable",
    "TransferTable",
    "UnitsTable",
    "WrongTableError",
    "json_schema",
    "meaning",
    "read_record",
    "read_table",
    "table_of",
]

_Matrix = list[list[float]]


class TomlTable(BaseModel):
    """A table of the file: no key but those below, no value of another type."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, populate_by_name=True)


class SystemTable(TomlTable):
    """The whole file; what `components` and `connections` hold is read table by table.

    Attributes:
        name: name of the system.
        components: name → component: an FMU, a gain, a sum, a linear model or a block.
        connections: destination input → source output, as "plant.u" = "gain.y".
        inputs: input of the system → component input, or several of them.
        outputs: output of the system → component variable.
        experiment: the default experiment.
        master: how co-simulation components are stepped.
    """

    name: str | None = None
    components: dict[str, Any]
    connections: dict[str, Any] = Field(default_factory=dict)
    inputs: dict[str, str | list[str]] = Field(default_factory=dict)
    outputs: dict[str, str] = Field(default_factory=dict)
    experiment: dict[str, Any] = Field(default_factory=dict)
    master: dict[str, Any] = Field(default_factory=dict)


class ExperimentTable(TomlTable):
    """The default experiment. Times in [s].

    Attributes:
        start: time at which runs begin [s].
        stop: time at which runs end [s].
        step: communication step of co-simulation, or interval of the output [s].
        tolerance: relative tolerance of the integration.
    """

    start: float | None = None
    stop: float | None = None
    step: float | None = Field(default=None, gt=0.0)
    tolerance: float | None = Field(default=None, gt=0.0, lt=1.0)


class FmuTable(TomlTable):
    """An FMU.

    Attributes:
        model: FMU (.fmu, folder of an unpacked one, fmu:NAME), or another system (.toml, .ssp, system:NAME).
        set: parameters and start values; of a whole array a list, of an enumeration the name of an item.
        interface: me (model exchange), cs (co-simulation) or auto.
        solver: integrator, where the system leaves it open.
        step: communication step of co-simulation [s].
        dependencies: declared: outputs depend on the inputs that the FMU declares; all: on every input, without delay.
    """

    model: str
    set: dict[str, bool | int | float | str | list[Any]] = Field(default_factory=dict)
    interface: Literal["auto", "me", "cs"] = "auto"
    solver: Literal["auto", "vkm", "gear"] = "auto"
    step: float | None = Field(default=None, gt=0.0)
    dependencies: Literal["declared", "all"] = "declared"


class UnitsTable(TomlTable):
    """Units of inputs and outputs.

    Attributes:
        units: input or output → unit.
    """

    units: dict[str, str] = Field(default_factory=dict)


class SumTable(TomlTable):
    """A sum; "+-" or factors.

    Attributes:
        sum: "+-", or a list of factors: output y = Σ factor · input u1, u2, …
        unit: of all inputs and the output.
    """

    sum: str | list[float]
    unit: str | None = None


class _Dynamic(TomlTable):
    """What linear models have in common.

    Attributes:
        inputs, outputs, states: names; by default u, y, x for a single one, u1, u2, … for several.
        x0: start values of the states.
        dt: sample period [s]; 0: continuous.
        units: input or output → unit.
    """

    inputs: list[str] | None = None
    outputs: list[str] | None = None
    states: list[str] | None = None
    x0: list[float] | None = None
    dt: float = Field(default=0.0, ge=0.0)
    units: dict[str, str] = Field(default_factory=dict)


class LinearTable(_Dynamic):
    """A state-space model.

    Attributes:
        A, B, C, D: rows of the matrix.
    """

    A: _Matrix
    B: _Matrix
    C: _Matrix
    D: _Matrix | None = None


class LinearFileTable(TomlTable):
    """A state-space model in a JSON file.

    Attributes:
        linear: JSON file, as lin, identify or feed-forward write it.
        units: input or output → unit.
    """

    linear: str
    units: dict[str, str] = Field(default_factory=dict)


class TransferTable(_Dynamic):
    """A transfer function, highest power first.

    Attributes:
        numerator, denominator: coefficients, highest power first.
    """

    numerator: list[float] = Field(min_length=1)
    denominator: list[float] = Field(min_length=1)


class WrongTableError(InputError):
    """A table holds what it cannot.

    Args:
        each: what is wrong, one mistake each.

    Attributes:
        each: see above.
    """

    def __init__(self, each: Sequence[str]) -> None:
        super().__init__("; ".join(each))
        self.each = tuple(each)


_Read = TypeVar("_Read", bound=TomlTable)


def read_table(kind: type[_Read], data: object, where: str) -> _Read:
    """Return `data` as a table of `kind`.

    Args:
        kind: of the table.
        data: as the TOML reader returns it.
        where: the table, for messages, such as "[experiment]"; empty: the whole file.

    Raises:
        WrongTableError: keys that are unknown (with near names) or missing, values of the wrong type; all of them.
    """
    try:
        return kind.model_validate(data)
    except ValidationError as error:
        before = f"{where}: " if where else ""
        raise WrongTableError([f"{before}{said}" for said in _messages(kind, error.errors())]) from None


def json_schema(kind: type[TomlTable]) -> dict[str, Any]:
    """Return the JSON Schema of a table, with what the docstrings of its class say of its keys.

    Args:
        kind: of the table.
    """
    result = kind.model_json_schema()
    for name, field in kind.model_fields.items():
        held = result["properties"][field.alias or name]
        held.pop("title", None)
        if text := meaning(kind, name):
            held["description"] = text
    return result


def meaning(kind: type[TomlTable], name: str) -> str:
    """Return what the docstring of a table's class, or of one that it builds on, says of a key; empty: nothing.

    Args:
        kind: of the table.
        name: of the field.
    """
    for owner in kind.__mro__:
        attributes = (inspect.getdoc(owner) or "").partition("Attributes:\n")[2] if "__doc__" in vars(owner) else ""
        for match in re.finditer(r"^    (?P<names>\w+(?:, \w+)*): (?P<text>.*(?:\n {8}.*)*)", attributes, re.MULTILINE):
            if name in match["names"].split(", "):
                return " ".join(match["text"].split()).replace("None:", "without it:")
    return ""


_Record = TypeVar("_Record")


def table_of(
    kind: type[Any], *, keys: Mapping[str, str] = MappingProxyType({}), known: Collection[str] = ()
) -> type[TomlTable]:
    """Return the table whose keys are the fields of a dataclass.

    Args:
        kind: the dataclass.
        keys: field → key of the file, where it is not the field's name.
        known: fields that the table does not hold.
    """
    types = get_type_hints(kind)
    made: Any = {
        f.name: (
            types[f.name],
            Field(... if f.default is f.default_factory is MISSING else None, alias=keys.get(f.name)),
        )
        for f in fields(kind)
        if f.name not in known
    }
    return create_model(kind.__name__, __base__=TomlTable, __doc__=kind.__doc__, **made)


def read_record(
    kind: type[_Record], data: object, where: str, *, keys: Mapping[str, str] = MappingProxyType({}), **known: str
) -> _Record:
    """Return `data` as a dataclass, whose fields are the keys of the table.

    Args:
        kind: the dataclass.
        data: as the TOML reader returns it.
        where: the table, for messages.
        keys: field → key of the file, where it is not the field's name.
        known: field → value, of fields that the table does not hold.

    Raises:
        InputError: as `read_table`.
    """
    table = read_table(table_of(kind, keys=keys, known=known), data, where)
    return kind(**known, **table.model_dump(exclude_unset=True))


def _messages(kind: type[TomlTable], errors: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return the errors in our words, one for each key; misspelt ones make others miss, which is not told then."""
    unknown = [str(e["loc"][-1]) for e in errors if e["type"] == "extra_forbidden"]
    told = [e for e in errors if e["type"] != "extra_forbidden" and not (unknown and e["type"] == "missing")]
    depth = 2 if kind is SystemTable else 1
    keys = dict.fromkeys(e["loc"][:depth] for e in told)
    wrong = [_message(kind, [e for e in told if e["loc"][:depth] == key]) for key in keys]
    return [*(f"key '{key}' is unknown; {suggest(key, _keys(kind))}" for key in unknown), *wrong]


def _message(kind: type[TomlTable], errors: Sequence[Mapping[str, Any]]) -> str:
    """Return what is wrong with one key in our words."""
    first = errors[0]
    path = [str(p) for p in first["loc"]]
    if first["type"] == "missing":
        return f"key '{path[-1]}' is missing"
    # The branches of a union come as names after the key.
    if kind is SystemTable and len(path) > 1:
        table, path = f"[{path[0]}] ", path[1:]
    else:
        table = ""
    name = ".".join(p for p in path if not p.startswith(("list[", "function-")) and p not in _BRANCHES)
    value = f", not {first['input']!r}" if isinstance(first["input"], str | int | float | bool) else ""
    if first["type"] in _SIZES:
        return f"{table}key '{name}' {_SIZES[first['type']].format(**first['ctx'])}"
    said = " or ".join(dict.fromkeys(_said(e["msg"]) for e in errors)).replace(" or must be", " or")
    return f"{table}key '{name}' {said}{value}"


_SIZES = {
    "too_short": "takes {min_length} or more values, not {actual_length}",
    "too_long": "takes up to {max_length} values, not {actual_length}",
    "string_too_short": "must not be empty",
}
_BRANCHES = ("str", "bool", "int", "float")
_WORDS = (
    ("Input should be", "must be"), ("Input must", "must"), ("a valid ", "a "), ("a int", "an int"),
    ("Value error, ", ""),
)  # fmt: skip


def _said(message: str) -> str:
    """Return pydantic's sentence as a clause after the key."""
    for its, ours in _WORDS:
        message = message.replace(its, ours)
    return message


def _keys(kind: type[TomlTable]) -> list[str]:
    return [field.alias or name for name, field in kind.model_fields.items()]

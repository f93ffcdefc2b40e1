"""JSON Schema of the files that people write, from the declarations that read them.

A schema says what a file can hold by itself: an editor completes and checks it while it is written. What needs more
than the file, such as the names of a model's variables, is said when it is read.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from workbench.commands import COMMANDS as EVERY
from workbench.core.records.schema import DRAFT, option_schema
from workbench.errors import InputError, suggest
from workbench.study.commands import COMMANDS, Command, command
from workbench.study.envelope_table import EnvelopeTable
from workbench.study.read import ApprovalTable, ChangeTable, ModelTable, StudyTable
from workbench.study.requirements import KINDS
from workbench.study.requirements.agreement import Agreement
from workbench.study.requirements.base import Limited, Requirement
from workbench.study.spread import SpreadTable
from workbench.system.files.toml_file import system_schema
from workbench.system.files.toml_schema import json_schema, meaning

__all__ = ["schema"]

_REFERENCE = {
    "type": "object",
    "description": "Result of another analysis, in place of a file.",
    "properties": {
        "from": {"type": "string", "description": "Name of the analysis."},
        "as": {"type": "string", "description": "Kind of file that the option takes: json (default), csv, validation."},
    },
    "required": ["from"],
    "additionalProperties": False,
}
_TO_REFERENCE = {"$ref": "#/$defs/reference"}
_ANALYSES = "#/properties/analyses/additionalProperties"
_SCALAR = {"type": ["boolean", "number", "string"]}


def schema(name: str) -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of a file or a table that people write.

    Args:
        name: "study", "system", or the name of a command: its table in a study, [analyses.NAME].

    Returns:
        The schema, ready for JSON.

    Raises:
        InputError: there is none of this name.

    Examples:
        >>> wb.schema("nfr")["properties"]["errcrit"]["default"]
        0.1
    """
    if name == "system":
        return system_schema()
    if name == "study":
        return _study()
    if name not in COMMANDS:
        raise InputError(f"there is no schema '{name}'; {suggest(name, ['study', 'system', *COMMANDS])}")
    return {"$schema": DRAFT, **_analysis(name), "$defs": {"reference": _REFERENCE}}


def _study() -> dict[str, Any]:
    result = json_schema(StudyTable)
    file = {"type": "string", "description": "FMU, or system."}
    change = {"type": "object", "additionalProperties": {"anyOf": [file, json_schema(ChangeTable)]}}
    values = {"type": "array", "items": _SCALAR, "minItems": 1}
    tables: dict[str, dict[str, Any]] = {
        "models": {"type": "object", "additionalProperties": {"anyOf": [file, json_schema(ModelTable)]}},
        "configurations": {"type": "object", "additionalProperties": change},
        "grid": _by_path("grid"),
        "envelope": _envelope(),
        "analyses": {
            "type": "object",
            "additionalProperties": _by("command", {name: _analysis(name) for name in COMMANDS}, _ANALYSES),
            "minProperties": 1,
        },
        "requirements": {
            "type": "array",
            "items": _by("kind", {kind: _requirement(kind) for kind in KINDS}, "#/properties/requirements/items"),
        },
    }
    result["properties"] |= {name: {"description": meaning(StudyTable, name), **held} for name, held in tables.items()}
    defs = {
        **result.pop("$defs", {}),
        "ApprovalTable": json_schema(ApprovalTable),
        "reference": _REFERENCE,
        "grid": _nested(values, "grid"),
        "spread": _nested(json_schema(SpreadTable), "spread"),
    }
    return {"$schema": DRAFT, **result, "title": "Study", "$defs": defs}


def _by(key: str, held: Mapping[str, Mapping[str, Any]], place: str) -> dict[str, Any]:
    """Return what is one of these by its key: editors complete from `anyOf`, a validator names the mistake by `then`.

    The last of `anyOf` fits all: else a validator would say no more than that none does.

    Args:
        key: that tells them apart.
        held: its value → schema.
        place: where in the file the result stands, a JSON pointer.
    """
    said = [{"properties": {key: {"const": value}}, "required": [key]} for value in held]
    then = [{"if": one, "then": {"$ref": f"{place}/anyOf/{k}"}} for k, one in enumerate(said)]
    said_so = {"description": "What it is."}
    known = {"properties": {key: {"enum": list(held), **said_so}}, "required": [key]}
    return {"anyOf": [*held.values(), {"properties": {key: said_so}}], "allOf": [known, *then]}


def _by_path(name: str) -> dict[str, Any]:
    """Return what has names like plant.k, which without quotes are tables in tables."""
    return {"type": "object", "additionalProperties": {"$ref": f"#/$defs/{name}"}}


def _nested(inner: Mapping[str, Any], name: str) -> dict[str, Any]:
    return {"anyOf": [inner, _by_path(name)]}


def _envelope() -> dict[str, Any]:
    result = json_schema(EnvelopeTable)
    result["properties"]["parameters"] |= _by_path("spread")
    return result


def _requirement(kind: str) -> dict[str, Any]:
    result = json_schema(KINDS[kind])
    result["properties"]["kind"] = {"const": kind}
    return {**result, **_limits(KINDS[kind]), "title": kind}


def _limits(kind: type[Requirement]) -> dict[str, Any]:
    """Return what makes a requirement without a limit wrong, and an equal number without a tolerance."""
    given = [{"required": [name]} for name in ("min", "max", "equal")]
    bars = [{"required": [name]} for name in ("tolerance", "relative")]
    if issubclass(kind, Agreement):
        return {"oneOf": bars}
    if not issubclass(kind, Limited):
        return {}
    number = {"properties": {"equal": {"type": "number", "description": meaning(kind, "equal")}}, "required": ["equal"]}
    return {"anyOf": given, "if": number, "then": {"anyOf": bars}}


def _analysis(name: str) -> dict[str, Any]:
    """Return the schema of an analysis by a command, whichever of its requests is meant."""
    result = [_asked(name, command(request)) for request in EVERY[name]]
    if len(result) == 1:
        return result[0]
    keys = dict.fromkeys(spelt for one in result for key in one["properties"] for spelt in (key, key.replace("-", "_")))
    return {"title": name, "anyOf": result, "propertyNames": {"enum": list(keys)}}


def _asked(name: str, facts: Command) -> dict[str, Any]:
    """Return the schema of a request: its command, what it works on, and the options."""
    options = {key: _or_reference(option_schema(declared)) for key, (_, declared) in facts.options.items()}
    properties = {"command": {"const": name}, facts.subject: _subject(facts), **options}
    chosen = [flag] if (flag := facts.request.chosen_by.lstrip("-")) else []
    properties |= {flag: {"const": True} for flag in chosen}
    keys: dict[str, list[str]] = {}  # of each option that is needed: it may have two
    for key, (field, declared) in facts.options.items():
        if declared.required:
            keys.setdefault(field, []).extend(dict.fromkeys((key, key.replace("-", "_"))))
    needed = [{"anyOf": [{"required": [key]} for key in of_one]} for of_one in keys.values()]
    alone = facts.on_models or not facts.request.subject.optional
    return {
        "title": facts.name,
        "type": "object",
        "properties": properties,
        # Underscores stand for hyphens.
        "patternProperties": {f"^{key.replace('-', '_')}$": held for key, held in options.items() if "-" in key},
        "required": ["command", *chosen, *([facts.subject] if alone else [])],
        **({"allOf": needed} if needed else {}),
        "additionalProperties": False,
    }


def _subject(facts: Command) -> dict[str, Any]:
    one: dict[str, Any] = {"type": "string"}
    many = {"type": "array", "items": one, **({"minItems": 1} if facts.on_models else {})}
    given = [one, *([many] if facts.several else []), _TO_REFERENCE]
    return {"description": facts.request.subject.words, "anyOf": given}


def _or_reference(held: Mapping[str, Any]) -> dict[str, Any]:
    listed = {"type": "array", "contains": _TO_REFERENCE}
    said = {key: held[key] for key in ("description", "unit", "default") if key in held}
    return {**said, "anyOf": [{k: v for k, v in held.items() if k not in said}, _TO_REFERENCE, listed]}

"""JSON Schema of what can be asked, from the declarations of its options.

Source: JSON Schema, draft 2020-12.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from workbench.core.records.forms import Layout
from workbench.core.records.option import DeclaredOption
from workbench.core.records.record import plain

__all__ = ["DRAFT", "option_schema", "table_schema"]

DRAFT = "https://json-schema.org/draft/2020-12/schema"

_NUMBER = r"^\s*[-+]?([0-9_]+\.?[0-9_]*|\.[0-9_]+)([eE][-+]?[0-9]+)?\s*$|^\s*[-+]?(inf|infinity|nan)\s*$"
_WHOLE = r"^\s*[-+]?[0-9_]+\s*$"


def option_schema(declared: DeclaredOption) -> dict[str, Any]:
    """Return the schema of an option's value as TOML has it: typed, or a text as on the command line.

    Args:
        declared: the option.
    """
    said: dict[str, Any] = {"description": declared.help}
    if declared.option.unit:
        said["unit"] = declared.option.unit
    if declared.default not in (None, (), {}) and not declared.required:
        said["default"] = plain(declared.default)
    form = declared.form
    if form is None:
        return {**said, "type": "boolean"}
    if declared.choices:
        return {**said, "enum": list(declared.choices)}
    single = _single(form.items, _range(declared))
    if form.layout.kind == "one":
        return {**said, **single}
    given = [_laid_out(form.layout, single), {"type": "string"}]
    if form.layout.kind != "names":
        given += [single, {"type": "array", "items": single}] if form.layout.kind == "mixed" else [single]
    elif form.repeated:
        given.append({"type": "array", "items": {"type": "string"}})
    return {**said, "anyOf": given}


def table_schema(options: Mapping[str, DeclaredOption]) -> dict[str, Any]:
    """Return the schema of a table of options.

    Args:
        options: key → option.
    """
    return {
        "type": "object",
        "properties": {key: option_schema(declared) for key, declared in options.items()},
        "required": [key for key, declared in options.items() if declared.required],
        "additionalProperties": False,
    }


def _range(declared: DeclaredOption) -> dict[str, Any]:
    """Return the keywords of the range of a number; JSON passes them over for a text."""
    option = declared.option
    ends = {
        "exclusiveMinimum": 0 if option.positive else None,
        "minimum": option.least,
        "exclusiveMaximum": option.below,
    }
    return {key: end for key, end in ends.items() if end is not None}


def _single(items: tuple[str, ...], ends: Mapping[str, Any]) -> dict[str, Any]:
    """Return the schema of one value; a number may stand in quotes, as everything on a command line does."""
    if items == ("number",):
        return {"type": ["number", "string"], **ends, "pattern": _NUMBER}
    if items == ("integer",):
        return {"type": ["integer", "string"], **ends, "pattern": _WHOLE}
    if items == ("string",):
        return {"type": ["string", "number"]}  # a name that looks like a number
    return {"type": list(items), **ends}


def _laid_out(layout: Layout, single: Mapping[str, Any]) -> dict[str, Any]:
    if layout.kind == "one":
        return dict(single)
    if layout.inner is not None:
        inner = _laid_out(layout.inner, single)
        given = inner if layout.inner.kind == "one" else {"anyOf": [inner, single, {"type": "string"}]}
        return {"type": "object", "additionalProperties": given}
    size = {"minItems": 2, "maxItems": 2} if layout.kind == "span" else {}
    return {"type": "array", "items": dict(single), **size}

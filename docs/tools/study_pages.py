"""The page of requirements of a study, generated from the classes that read them."""

from __future__ import annotations

import inspect
from collections.abc import Iterator

from pydantic.fields import FieldInfo

from workbench.study.requirements import KINDS
from workbench.study.requirements.base import Requirement
from workbench.system.files.toml_schema import TomlTable, meaning

__all__ = ["requirements_page"]

_INTRODUCTION = """# Requirements

A requirement is a table `[[requirements]]` of a [study file](study-files.md). All kinds have these keys:
"""
_LIMITS = ("min", "max", "equal", "tolerance", "relative", "unit")


def requirements_page() -> str:
    """Return the Markdown of the page."""
    common = [_row(Requirement, name, field) for name, field in Requirement.model_fields.items()]
    parts = [_INTRODUCTION, *_table(common), "", *_limits(), ""]
    for kind, owner in KINDS.items():
        parts += [f"## {kind}", "", *_section(owner), ""]
    return "\n".join(parts)


def _limits() -> Iterator[str]:
    owner = next(k for k in KINDS.values() if set(_LIMITS) <= k.model_fields.keys())
    yield "Where a kind takes *limits*, these are:"
    yield ""
    yield from _table([_row(owner, name, owner.model_fields[name]) for name in _LIMITS])


def _section(owner: type[Requirement]) -> Iterator[str]:
    yield _summary(owner)
    yield ""
    takes = ", ".join(f"`{c}`" for c in owner.commands) or "any command"
    limited = set(_LIMITS) <= owner.model_fields.keys()
    yield f"Reads results of {takes}." + (" Takes limits." if limited else "")
    yield ""
    left = [n for n in owner.model_fields if n not in Requirement.model_fields and not (limited and n in _LIMITS)]
    if left:
        yield from _table([_row(owner, name, owner.model_fields[name]) for name in left])


def _summary(owner: type[Requirement]) -> str:
    text = inspect.getdoc(owner) or ""
    return text.partition("\nAttributes:")[0].strip()


def _table(rows: list[str]) -> Iterator[str]:
    yield from ("| key | meaning | default |", "|---|---|---|", *rows)


def _row(owner: type[TomlTable], name: str, field: FieldInfo) -> str:
    return f"| `{field.alias or name}` | {_meaning(owner, name)} | {_default(field)} |"


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "required"
    return "" if field.default_factory is not None or field.default in (None, "") else f"`{field.default}`"


def _meaning(owner: type[TomlTable], name: str) -> str:
    return meaning(owner, name).replace("|", r"\|").replace("name in `KINDS`", "one of those below")

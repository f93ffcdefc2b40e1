"""The tables of `docs/reference/json.md`: the keys of each record, from its declaration.

In the page a line `{keys MODULE:CLASS}` stands for such a table. Words of a field are those of its class's docstring,
words of a key that follows from others those of the docstring of `derived`, under "Keys:".
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from typing import Any, get_args, get_type_hints

from workbench.core.records.named import named

__all__ = ["key_table", "keys_of", "with_keys"]

_MARK = re.compile(r"^\{keys ([\w.]+:\w+)\}$", re.MULTILINE)
_ENTRY = re.compile(r"^ {4}(\w[\w, ]*): (.+(?:\n {5,}.+)*)$", re.MULTILINE)


def with_keys(text: str) -> str:
    """Return a page with its tables of keys.

    Args:
        text: of the page.
    """
    return _MARK.sub(lambda mark: key_table(named(mark[1])), text)


def key_table(kind: type) -> str:
    """Return the table of a record's keys.

    Args:
        kind: class of the record.
    """
    rows: dict[str, list[str]] = {}
    for key, words in keys_of(kind).items():
        rows.setdefault(_in_json(words), []).append(f"`{key}`")
    lines = (f"| {', '.join(keys)} | {words} |" for words, keys in rows.items())
    return "\n".join(["| key | value |", "|---|---|", *lines])


def _in_json(words: str) -> str:
    """Return words of Python's as they are true of a file."""
    return re.sub(r"\b(?:None|NaN)\b", "`null`", words).replace("|", "\\|")


def keys_of(kind: type) -> dict[str, str]:
    """Return key → words, in the order of the file: fields, then what follows from them.

    Args:
        kind: class of the record, or of a part.

    Raises:
        ValueError: a field has no words.
    """
    words, hints = _section(kind, "Attributes"), get_type_hints(kind)
    found: dict[str, str] = {}
    inline: dict[str, str] = {}
    for field in fields(kind):
        said = field.metadata
        if said.get("inline"):
            inline |= {key: words for part in _parts(hints[field.name]) for key, words in keys_of(part).items()}
        elif said.get("kept", True):
            if field.name not in words:
                raise ValueError(f"{kind.__name__}.{field.name} has no words in its class's docstring")
            axes = "".join(f"[{axis}]" for axis in said.get("dims", ()))
            shape = f"`{axes}`: " if axes else ""
            within = "".join(
                f" ({keys})" for part in dict.fromkeys(_parts(hints[field.name])) if (keys := _within(part))
            )
            found[said.get("key") or field.name] = f"{shape}{words[field.name].rstrip('.')}{within}"
    derived = {key: text.rstrip(".") for key, text in _derived(kind).items()}
    return {**found, **{k: w for k, w in {**inline, **derived}.items() if k not in found}}


def _within(part: type) -> str:
    """Return the keys of a part in a line."""
    kept = [f for f in fields(part) if f.metadata.get("kept", True) and not f.metadata.get("inline")]
    keys = dict.fromkeys([*(f.metadata.get("key") or f.name for f in kept), *_derived(part)])
    return ", ".join(f"`{key}`" for key in keys)


def _parts(kind: Any) -> Iterator[type]:  # noqa: ANN401 - a type
    """Yield the classes of parts in the type of a field."""
    if isinstance(kind, type) and is_dataclass(kind):
        yield kind
    for inner in get_args(kind):
        yield from _parts(inner)


def _derived(kind: type) -> dict[str, str]:
    owners = [owner.derived for owner in reversed(kind.__mro__) if "derived" in vars(owner)]  # type: ignore[attr-defined]
    return {key: words for owner in owners for key, words in _section(owner, "Keys").items()}


def _section(of: Any, title: str) -> dict[str, str]:  # noqa: ANN401 - a class or a function
    """Return name → words of a section of a docstring; of a class those of its bases, too."""
    found: dict[str, str] = {}
    for owner in reversed(of.__mro__) if isinstance(of, type) else [of]:
        text = inspect.cleandoc(owner.__doc__ or "")
        section = re.search(rf"^{title}:\n((?:(?: .*)?\n?)*)", text, re.MULTILINE)
        for names, words in _ENTRY.findall(section[1]) if section else ():
            found |= dict.fromkeys(re.split(r", *", names), " ".join(words.split()))
    return found

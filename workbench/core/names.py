"""Names as people and tools write them: lists of variables, `a,y[1,2]`, and units in brackets, `[m3]`."""

from __future__ import annotations

from collections.abc import Iterator

from workbench.errors import InputError

__all__ = ["plain_unit", "split_names"]

_CLOSING = {"[": "]", "(": ")", "{": "}"}
_QUOTES = "\"'"


def split_names(text: str) -> list[str]:
    """Return the names in "a,b": commas inside brackets and quotes belong to a name; blanks around it do not.

    A name in quotes stands without them.

    Args:
        text: as it was given; empty items are left out.

    Raises:
        InputError: a bracket or quote is not closed.
    """
    return [_bare(part) for part in _parts(text) if part]


def plain_unit(name: str) -> str:
    """Return a unit without the brackets that some tools write around it: "m3" for "[m3]"."""
    inner = name.strip()
    return inner[1:-1].strip() if inner.startswith("[") and inner.endswith("]") else name


def _parts(text: str) -> Iterator[str]:
    waiting: list[str] = []  # what must close before a comma counts
    begin = 0
    for i, character in enumerate(text):
        if waiting and character == waiting[-1]:
            waiting.pop()
        elif waiting and waiting[-1] in _QUOTES:
            continue
        elif character in _CLOSING:
            waiting.append(_CLOSING[character])
        elif character in _QUOTES and not text[begin:i].strip():
            waiting.append(character)
        elif character == "," and not waiting:
            yield text[begin:i].strip()
            begin = i + 1
    if waiting:
        raise InputError(f"'{text}': {waiting[-1]} is missing")
    yield text[begin:].strip()


def _bare(name: str) -> str:
    quoted = len(name) > 1 and name[0] in _QUOTES and name[-1] == name[0]
    return name[1:-1] if quoted else name

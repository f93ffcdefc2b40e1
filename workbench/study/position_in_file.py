"""What is wrong with a study file: all of it at once, and where."""

from __future__ import annotations

import re
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from workbench.errors import InputError, Mistake, suggest
from workbench.system.files.toml_schema import WrongTableError

__all__ = ["Mistakes", "in_file", "known", "line_of", "place"]

_PART = r"""(?:"[^"]*"|'[^']*'|[\w-]+)"""
_PATH = rf"({_PART}(?:\s*\.\s*{_PART})*)"
_ITEM, _TABLE = re.compile(rf"\s*\[\[\s*{_PATH}\s*\]\]"), re.compile(rf"\s*\[\s*{_PATH}\s*\]")
_KEY = re.compile(rf"\s*{_PATH}\s*=")
_LONG_QUOTE = re.compile(r"""\"{3}|'{3}""")
_QUOTED = re.compile(r"""\"[^\"]*\"|'[^']*'""")
# The table that a message begins with, and the key that it is about.
_SAID_OF = re.compile(
    r"""\[\[?(?P<table>[^\]]+)\]\]?(?: (?:"(?P<quoted>[^"]+)"|number (?P<number>\d+)|(?P<name>[^\s:]+)))?"""
)
_SAID_KEY = re.compile(r"(?:^|: )(?:key '(?P<key>[^']+)'|(?P<what>\w+) '[^']*' is unknown)")


@contextmanager
def place(where: str) -> Iterator[None]:
    """Put the table before the message of an error.

    Args:
        where: the table, such as "[analyses.response]".

    Raises:
        InputError: with the table in front.
    """
    try:
        yield
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def known(where: str, what: str, name: str, names: Mapping[str, object] | Sequence[str]) -> None:
    """Check that a name is one of those known.

    Args:
        where: the table, for messages.
        what: it names, such as "model".
        name: to look for.
        names: the known ones.

    Raises:
        InputError: it is not; with near names.
    """
    if name not in names:
        raise InputError(f"{where}: {what} '{name}' is unknown; {suggest(name, names)}")


class Mistakes:
    """What is wrong with a study: every part is read, so that all of it is said at once."""

    def __init__(self) -> None:
        self._found: list[str] = []

    @contextmanager
    def kept(self) -> Iterator[None]:
        """Keep what is wrong with a part, and go on."""
        try:
            yield
        except WrongTableError as error:
            self._found += error.each
        except InputError as error:
            self._found.append(str(error))

    def tell(self) -> None:
        """Raise an error with all that was kept, if there is anything."""
        if self._found:
            raise WrongTableError(self._found)


@contextmanager
def in_file(path: Path) -> Iterator[None]:
    """Say of what is wrong with a file in which line it stands.

    Args:
        path: of the TOML file, which can be read.

    Raises:
        InputError: with the file in front, and each of its `mistakes`.
    """
    try:
        yield
    except InputError as error:
        each = error.each if isinstance(error, WrongTableError) else (str(error),)
        text = path.read_text(encoding="utf-8-sig")
        data = tomllib.loads(text)
        mistakes = [Mistake(said, str(path), line_of(text, _path_of(said, data))) for said in each]
        raise InputError(f"{path}: {_told(mistakes)}", mistakes) from None


def _told(mistakes: Sequence[Mistake]) -> str:
    every = [m.message if m.line is None else f"line {m.line}: {m.message}" for m in mistakes]
    if len(every) == 1:
        return every[0]
    return f"{len(every)} mistakes: {'; '.join(f'({k}) {said}' for k, said in enumerate(every, start=1))}"


def _path_of(said: str, data: Mapping[str, Any]) -> str:
    """Return the path in the file that a message is about."""
    table, key = _SAID_OF.match(said), _SAID_KEY.search(said)
    parts = [] if table is None else [table["table"], table["quoted"] or table["number"] or table["name"] or ""]
    if table is not None and table["table"] == "requirements" and table["quoted"]:
        names = [r.get("name") if isinstance(r, Mapping) else None for r in data.get("requirements", ())]
        parts[1] = str(names.index(table["quoted"]) + 1) if table["quoted"] in names else ""
    return ".".join(filter(None, [*parts, (key["key"] or key["what"]) if key else ""]))


def line_of(text: str, wanted: str) -> int | None:
    """Return the number of the line where a key stands, else that of the table around it; None: neither is found.

    Args:
        text: of the TOML file.
        wanted: path of the key, such as "analyses.response.band" or, in the first of several, "requirements.1.min".
    """
    best, line, table, in_text, in_list = "", None, "", False, 0
    items: Counter[str] = Counter()
    for number, row in enumerate(text.splitlines(), start=1):
        here = ""
        if in_text or in_list:
            pass  # goes on with the value of a key before
        elif found := _ITEM.match(row):
            items[_plain(found[1])] += 1
            here = table = f"{_plain(found[1])}.{items[_plain(found[1])]}"
        elif found := _KEY.match(row):
            here = f"{table}.{_plain(found[1])}" if table else _plain(found[1])
        elif found := _TABLE.match(row):
            here = table = _plain(found[1])
        before, in_text = in_text, in_text ^ (len(_LONG_QUOTE.findall(row)) % 2 == 1)
        if not before and not in_text:
            bare = _QUOTED.sub("", row).partition("#")[0]
            in_list += bare.count("[") - bare.count("]")
        if len(here) > len(best) and f"{wanted}.".startswith(f"{here}."):
            best, line = here, number
    return line


def _plain(path: str) -> str:
    return ".".join(part.strip("\"'") for part in re.findall(_PART, path))

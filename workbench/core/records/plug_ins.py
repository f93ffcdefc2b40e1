"""Tables of what there is by name: the workbench's own, and what other installed packages add by entry points."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import suppress
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar, cast

from workbench.core.records.named import named
from workbench.errors import InputError

if TYPE_CHECKING:
    from importlib.metadata import Distribution

__all__ = ["KINDS", "ExtensibleTable", "PlugIn", "faults", "packages", "plug_ins"]

_GROUP = "fmi_workbench."
KINDS: Mapping[str, str] = {
    "commands": "command",
    "blocks": "block",
    "requirements": "requirement",
    "readers": "reader",
}

_Held = TypeVar("_Held")
_faults: dict[str, None] = {}  # what was found unusable by this process, in words


class PlugIn(NamedTuple):
    """An entry point of an installed package.

    Attributes:
        kind: its group behind "fmi_workbench.", one of `KINDS` unless its package is wrong.
        name: as people ask for it.
        target: "module:name".
        package: name and version of the package it comes from.
    """

    kind: str
    name: str
    target: str
    package: str

    @property
    def words(self) -> str:
        """What it is, for messages."""
        return f"{KINDS.get(self.kind, self.kind)} '{self.name}' of the package {self.package}"


def plug_ins() -> tuple[PlugIn, ...]:
    """Return what installed packages declare for the workbench, by package; nothing of it is imported."""
    return _declared(tuple(sys.path))


def packages() -> tuple[str, ...]:
    """Return the names of the packages, as Python imports them, that plug-ins are in."""
    return tuple(sorted({plug_in.target.partition(":")[0].partition(".")[0] for plug_in in plug_ins()}))


def faults() -> tuple[str, ...]:
    """Return what this process has found to be wrong with plug-ins while it listed them, a line each."""
    return tuple(_faults)


class ExtensibleTable(Mapping[str, _Held]):
    """What there is of a kind, by name, loaded when it is asked for: the workbench's own, then that of plug-ins.

    Obligations:
      1. Asking for the workbench's own looks for no plug-ins.
      2. A plug-in that cannot be used is left out of the list, see `faults`; whoever asks for it by its name gets an
         InputError that says what is wrong with which package.

    Args:
        kind: one of `KINDS`.
        own: name → what it is, or "module:name".
        wrong: of what a plug-in has: what is wrong with it; empty: nothing is.
        within: package that the modules of `own` are in.
        taken: further names that a plug-in cannot have.
    """

    def __init__(
        self,
        kind: str,
        own: Mapping[str, _Held | str],
        wrong: Callable[[str, Any], str],
        *,
        within: str = "",
        taken: Collection[str] = (),
    ) -> None:
        self._kind, self._own, self._wrong, self._within, self._taken = kind, own, wrong, within, taken
        self._right: set[PlugIn] = set()

    def __getitem__(self, name: str) -> _Held:
        held = self._own.get(name)
        if isinstance(held, str):
            return cast("_Held", named(f"{self._within}.{held}"))
        if held is not None:
            return held
        found = [] if name in self._taken else self._named(name)
        if not found:
            raise KeyError(name)
        return self._usable(found)

    def __iter__(self) -> Iterator[str]:
        yield from self._own
        yield from (plug_in.name for plug_in in self.added())

    def __len__(self) -> int:
        return len(self._own) + len(self.added())

    def added(self) -> tuple[PlugIn, ...]:
        """Return the plug-ins that can be used."""
        result = []
        for name in dict.fromkeys(p.name for p in plug_ins() if p.kind == self._kind):
            try:
                self._usable(self._named(name))
            except InputError as error:
                _faults[str(error)] = None
            else:
                result += self._named(name)
        return tuple(result)

    def package_of(self, name: str) -> str:
        """Return name and version of the package that something comes from; empty: the workbench has it.

        Args:
            name: in the table.
        """
        return "" if name in self._own else next((p.package for p in self._named(name)), "")

    def _named(self, name: str) -> list[PlugIn]:
        return [p for p in plug_ins() if (p.kind, p.name) == (self._kind, name)]

    def _usable(self, found: list[PlugIn]) -> _Held:
        """Return what a plug-in has.

        Raises:
            InputError: it cannot be used.
        """
        first = found[0]
        if first.name in self._own or first.name in self._taken:
            raise InputError(f"{first.words} is not used: the workbench has that name itself; rename it there")
        if len(found) > 1:
            others = " and ".join(p.package for p in found[1:])
            raise InputError(f"{first.words} is also in {others}: neither is used; uninstall all but one")
        held: Any = None
        try:
            held = named(first.target)
            why = "" if first in self._right else self._wrong(first.name, held)
        except (Exception, SystemExit) as error:  # noqa: BLE001 - whatever a foreign module raises
            why = f"{type(error).__name__}: {error}"
        if why:
            raise InputError(f"{first.words} cannot be used: {first.target}: {why}; mend or uninstall that package")
        self._right.add(first)
        return cast("_Held", held)


# -- what is installed ---------------------------------------------------------------------------


@lru_cache(maxsize=1)
def _declared(path: tuple[str, ...]) -> tuple[PlugIn, ...]:
    if not any(map(_announced, path)):
        return ()
    from importlib.metadata import distributions  # noqa: PLC0415 - takes half as long as the help of all commands

    found: dict[str, list[PlugIn]] = {}
    for one in distributions():
        if _GROUP not in (one.read_text("entry_points.txt") or ""):
            continue
        try:
            name = str(one.name or _where(one))
            package = f"{name} {one.version or ''}".strip()
            of_one = [e for e in one.entry_points if e.group.startswith(_GROUP)]
        except Exception as error:  # noqa: BLE001 - whatever comes of a damaged file
            _faults[f"the entry points of {_where(one)} cannot be read ({error}); install that package anew"] = None
            continue
        if name not in found:  # else an older one, farther back on the path
            found[name] = [PlugIn(e.group.removeprefix(_GROUP), e.name, e.value, package) for e in of_one]
    result = tuple(plug_in for name in sorted(found) for plug_in in found[name])
    for plug_in in result:
        if plug_in.kind not in KINDS:
            known = ", ".join(f"{_GROUP}{kind}" for kind in KINDS)
            _faults[f"{plug_in.words} is not used: its group is none of {known}"] = None
    return result


def _where(one: Distribution) -> str:
    """Return the folder in which a package describes itself; one that is damaged may not have a name."""
    return str(getattr(one, "_path", "a package"))


def _announced(folder: str) -> bool:
    """Return whether an entry point in a folder of packages is for the workbench, as far as its text tells."""
    with suppress(OSError):
        for name in os.listdir(folder or "."):  # noqa: PTH208 - pathlib takes several times as long
            if name.endswith("-info"):
                with suppress(OSError), open(f"{folder or '.'}/{name}/entry_points.txt", "rb") as file:  # noqa: PTH123 - as above
                    if _GROUP.encode() in file.read():
                        return True
    return False

"""Terminals of an FMU: terminalsAndIcons/terminalsAndIcons.xml, of FMI 3.0 and of the layered standard for FMI 2.0."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from lxml import etree

from workbench.fmi.description import Terminal, TerminalMember

__all__ = ["terminals_in"]

_FOLDER = "terminalsAndIcons"
_NAMES = ("terminalsAndIcons.xml", "TerminalsAndIcons.xml")  # the second by some exporters
_MOST_BYTES = 64 << 20
_DEEPEST = 16  # terminals inside terminals


def terminals_in(folder: Path) -> tuple[tuple[Terminal, ...], tuple[str, ...]]:
    """Return the terminals of an unpacked FMU, those inside others after them, and remarks on what cannot be read.

    Args:
        folder: where it is unpacked.
    """
    file = next((f for name in _NAMES if (f := folder / _FOLDER / name).is_file()), None)
    if file is None:
        return (), ()
    where = f"{_FOLDER}/{file.name}"
    data = b"" if file.stat().st_size > _MOST_BYTES else file.read_bytes()
    if not data:
        return (), (f"{where} is too large or empty; its terminals are left out",)
    try:
        root = etree.fromstring(data, etree.XMLParser(resolve_entities=False, no_network=True))
    except etree.XMLSyntaxError as error:
        return (), (f"{where} cannot be read: {error.msg}; its terminals are left out",)
    if root.getroottree().docinfo.doctype:  # in whatever encoding
        return (), (f"{where} declares a document type, as XML bombs do; its terminals are left out",)
    return tuple(t for e in root.iterfind("Terminals/Terminal") for t in _terminals(e, "", 0)), ()


def _terminals(element: etree._Element, outer: str, depth: int) -> Iterator[Terminal]:
    name = outer + (element.get("name") or "")
    yield Terminal(
        name=name,
        kind=element.get("terminalKind"),
        rule=element.get("matchingRule") or "plug",
        members=tuple(_members(element)),
        description=element.get("description"),
    )
    for inner in element.iterfind("Terminal"):
        if depth < _DEEPEST:
            yield from _terminals(inner, f"{name}.", depth + 1)


def _members(element: etree._Element) -> Iterator[TerminalMember]:
    for member in element.iterfind("TerminalMemberVariable"):
        variable = member.get("variableName") or ""
        yield TerminalMember(member.get("memberName") or variable, variable, member.get("variableKind") or "signal")
    for stream in element.iterfind("TerminalStreamMemberVariable"):
        for side in ("in", "out"):
            if (variable := stream.get(f"{side}StreamVariableName")) is not None:
                yield TerminalMember(stream.get(f"{side}StreamMemberName") or variable, variable, f"{side}stream")

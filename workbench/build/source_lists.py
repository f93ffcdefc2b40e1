"""What of an FMU's sources is compiled, and how: as the FMU says, or where it does not, every C file in them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from lxml import etree

from workbench.errors import BuildError
from workbench.fmi.description import Capabilities, ModelDescription

__all__ = ["ListedLibrary", "SourceFile", "every_interface", "listed_libraries"]

_SUFFIXES = (".c", ".cc", ".cpp", ".cxx")
_HEADERS = (".h", ".hh", ".hpp", ".hxx", ".inc")
_INCLUDED = re.compile(r'^[ \t]*#[ \t]*include[ \t]*"([^"]+\.(?:c|cc|cpp|cxx))"', re.MULTILINE)
_WORD = re.compile(r"[A-Za-z_]\w*\Z")
# What the C library of every platform has, by the names of the libraries that older ones put it in.
_OF_THE_SYSTEM = frozenset({"m", "c", "pthread", "dl", "rt"})


@dataclass(frozen=True)
class SourceFile:
    """A file that is compiled.

    Attributes:
        name: in the folder ``sources``.
        definitions: macros, "NAME" or "NAME=VALUE".
        folders: where its headers are looked for, in the folder ``sources``.
    """

    name: str
    definitions: tuple[str, ...] = ()
    folders: tuple[str, ...] = ()


@dataclass(frozen=True)
class ListedLibrary:
    """A shared library that an FMU's sources make.

    Attributes:
        identifier: its name without suffix, the FMU's modelIdentifier.
        interfaces: "me", "cs", "se" (scheduled execution), those that it serves.
        files: what it is compiled from.
        notes: what the FMU asks for that was left out, one line each.
    """

    identifier: str
    interfaces: tuple[str, ...]
    files: tuple[SourceFile, ...]
    notes: tuple[str, ...] = ()


def listed_libraries(
    folder: Path, description: ModelDescription, platform: str, *, source: str
) -> tuple[ListedLibrary, ...]:
    """Return what the sources of an unpacked FMU make.

    FMI 3.0 lists files in sources/buildDescription.xml, FMI 2.0 in modelDescription.xml, FMI 1.0 nowhere. Where no
    list is, every C file in the folder is taken that no other one includes.

    Args:
        folder: with modelDescription.xml and sources.
        description: what that FMU says of itself.
        platform: FMI 3.0 platform tuple, for build descriptions that tell platforms apart.
        source: what the user named, for messages.

    Raises:
        BuildError: no sources, none of C, or a list with files that are not there.
    """
    sources = folder / "sources"
    if not sources.is_dir():
        raise BuildError(f"{source}: it has no sources, so nothing can be compiled; ask its maker for a binary")
    identifiers: dict[str, list[str]] = {}
    for interface, claims in every_interface(description).items():
        identifiers.setdefault(claims.identifier, []).append(interface)
    built = _root(sources / "buildDescription.xml", source) if description.major >= 3 else None
    described = _root(folder / "modelDescription.xml", source) if description.major == 2 else None
    result = []
    for identifier, interfaces in identifiers.items():
        notes: list[str] = []
        if built is not None:
            files = _built(built, identifier, platform, notes, source)
        else:
            files = tuple(SourceFile(n) for n in _named(described, identifier) or _all(sources, source))
        _check(sources, files, source)
        compiled = tuple(f for f in files if f.name.lower().endswith(_SUFFIXES))
        if not compiled:
            raise BuildError(f"{source}: its list of sources names no C files, so nothing can be compiled")
        result.append(ListedLibrary(identifier, tuple(interfaces), compiled, (*notes, *_left_out(files))))
    return tuple(result)


def every_interface(description: ModelDescription) -> dict[str, Capabilities]:
    """Return all interfaces of an FMU, "se" for scheduled execution."""
    return {**description.interfaces, **({} if description.scheduled is None else {"se": description.scheduled})}


def _root(file: Path, source: str) -> etree._Element | None:
    """Return the root of an XML file; None: there is no such file."""
    if not file.is_file():
        return None
    try:
        return etree.parse(str(file), etree.XMLParser(resolve_entities=False, no_network=True)).getroot()
    except etree.XMLSyntaxError as error:
        raise BuildError(f"{source}: {file.name} cannot be read: {error}") from None


def _named(root: etree._Element | None, identifier: str) -> list[str]:
    """Return the files that modelDescription.xml of FMI 2.0 lists for a library."""
    if root is None:
        return []
    kinds = (e for tag in ("ModelExchange", "CoSimulation") for e in root.findall(tag))
    mine = (e for e in kinds if e.get("modelIdentifier") == identifier)
    return list(dict.fromkeys(f.get("name", "") for e in mine for f in e.findall("SourceFiles/File")))


def _all(sources: Path, source: str) -> list[str]:
    """Return every C file in the folder that no other one includes."""
    files = sorted(p for p in sources.rglob("*") if p.suffix in _SUFFIXES and p.is_file())
    included = {(p.parent / text).resolve() for p in files for text in _INCLUDED.findall(p.read_text(errors="replace"))}
    names = [p.relative_to(sources).as_posix() for p in files if p.resolve() not in included]
    if not names:
        raise BuildError(f"{source}: its folder sources holds no C files, so nothing can be compiled")
    return names


def _built(
    root: etree._Element, identifier: str, platform: str, notes: list[str], source: str
) -> tuple[SourceFile, ...]:
    """Return what buildDescription.xml of FMI 3.0 lists for a library."""
    known = root.findall("BuildConfiguration")
    mine = [c for c in known if c.get("modelIdentifier") == identifier]
    names = {c.get("modelIdentifier") or "" for c in known}
    if not mine and len(names) == 1:
        mine = known
        notes.append(f"buildDescription.xml calls {identifier} '{names.pop()}'; taken as what is meant")
    fitting = [c for c in mine if c.get("platform") == platform] or [c for c in mine if c.get("platform") is None]
    if not fitting:
        has = ", ".join(c.get("platform") or "" for c in mine) or "nothing"
        raise BuildError(
            f"{source}: its buildDescription.xml says how {identifier} is built for: {has}; not {platform}"
        )
    (configuration,) = fitting[:1]
    for library in configuration.findall("Library"):
        name = library.get("name") or ""
        if name.removeprefix("lib").partition(".")[0] not in _OF_THE_SYSTEM:
            raise BuildError(f"{source}: {identifier} is linked with the library {name}, which does not come with it")
    return tuple(file for group in configuration.findall("SourceFileSet") for file in _set(group, notes))


def _set(group: etree._Element, notes: list[str]) -> Iterator[SourceFile]:
    if options := group.get("compilerOptions"):
        notes.append(f"compiler options that the FMU asks for were left out: {options}")
    folders = tuple(e.get("name", "") for e in group.findall("IncludeDirectory"))
    definitions = tuple(_definitions(group))
    for file in group.findall("SourceFile"):
        yield SourceFile(file.get("name", ""), definitions, folders)


def _definitions(group: etree._Element) -> Iterator[str]:
    for element in group.findall("PreprocessorDefinition"):
        name, value = element.get("name", ""), element.get("value")
        if element.get("optional") not in ("true", "1") and _WORD.match(name):
            yield name if value is None else f"{name}={value}"


def _check(sources: Path, files: Sequence[SourceFile], source: str) -> None:
    """Refuse files and folders that are not in the FMU."""
    for name in dict.fromkeys(_names(files)):
        path = PurePosixPath(name)
        if path.is_absolute() or ".." in path.parts or "\\" in name or name.startswith("-"):
            raise BuildError(f"{source}: its list of sources names '{name}', which is not inside the FMU; refused")
    for file in files:
        if not (sources / file.name).is_file():
            raise BuildError(f"{source}: its list of sources names '{file.name}', which is not in the FMU")


def _left_out(files: Iterable[SourceFile]) -> Iterator[str]:
    """Yield a note on each listed file that is neither C or C++ nor one of their headers, which are found by name."""
    for file in files:
        if not file.name.lower().endswith((*_SUFFIXES, *_HEADERS)):
            yield f"{file.name} is listed among the sources, but it is not C or C++: it was left out"


def _names(files: Iterable[SourceFile]) -> Iterator[str]:
    for file in files:
        yield file.name
        yield from file.folders

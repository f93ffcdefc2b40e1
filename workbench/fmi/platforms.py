"""Names of platforms: FMI 1.0 and 2.0 (`linux64`), FMI 3.0 (`x86_64-linux`), and this machine's."""

from __future__ import annotations

import platform
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path, PurePosixPath

from workbench.errors import FmuError

__all__ = ["TUPLES", "binary_path", "folders_of", "host", "is_foreign", "note_left", "platforms_in"]

# FMI 1/2 folder name → FMI 3 platform tuple. macOS "darwin64" holds Intel or universal binaries.
TUPLES: Mapping[str, str] = {
    "linux32": "x86-linux",
    "linux64": "x86_64-linux",
    "win32": "x86-windows",
    "win64": "x86_64-windows",
    "darwin32": "x86-darwin",
    "darwin64": "x86_64-darwin",
}

_MACHINES = {
    "x86_64": "x86_64", "amd64": "x86_64", "aarch64": "aarch64", "arm64": "aarch64",
    "i386": "x86", "i686": "x86", "x86": "x86",
}  # fmt: skip
_SYSTEMS = {"linux": "linux", "win32": "windows", "darwin": "darwin"}
_WEB, _WEB_SUFFIX = "wasm", ".wasm"  # as wasm32-wasip1
SUFFIXES = {"linux": ".so", "windows": ".dll", "darwin": ".dylib"}

# Where an unpacked FMU tells which platforms it has binaries for that were left in the archive.
_FOREIGN = "binaries-left-in-the-archive.txt"
# Where it tells that it has sources, which were left there, too.
_SOURCES = "sources-left-in-the-archive.txt"
_C = (".c", ".cc", ".cpp", ".cxx")


def host() -> str:
    """Return this process's FMI 3 platform tuple, e.g. `x86_64-linux`."""
    machine = _MACHINES.get(platform.machine().lower(), platform.machine().lower())
    if machine == "x86_64" and sys.maxsize < 2**32:
        machine = "x86"
    return f"{machine}-{_SYSTEMS.get(sys.platform, sys.platform)}"


def folders_of(tuple_name: str) -> tuple[str, ...]:
    """Return the names of folders under `binaries` that may hold code for a platform, best first.

    Args:
        tuple_name: of FMI 3.0.
    """
    old = tuple(name for name, new in TUPLES.items() if new == tuple_name)
    universal = ("darwin64",) if tuple_name == "aarch64-darwin" else ()
    return (tuple_name, *old, *universal)


def _suffix(folder: str) -> str:
    system = TUPLES.get(folder, folder).rpartition("-")[2]
    return _WEB_SUFFIX if folder.startswith(_WEB) else SUFFIXES.get(system, ".so")


def is_foreign(file: PurePosixPath) -> bool:
    """Whether a file of an FMU is, by its place under `binaries`, for a known platform other than this machine's."""
    if len(file.parts) < 3 or file.parts[0] != "binaries":
        return False
    name = file.parts[1]
    known = name in TUPLES or name.rpartition("-")[2] in SUFFIXES or name.startswith(_WEB)
    return known and name not in folders_of(host())


def note_left(folder: Path, files: Sequence[PurePosixPath]) -> None:
    """Tell `platforms_in` and `binary_path` which files of an FMU were not unpacked into `folder`."""
    foreign = [f for f in files if is_foreign(f)]
    names = {f.parts[1] for f in foreign if f.parent.name == f.parts[1] and f.suffix == _suffix(f.parts[1])}
    if names:
        (folder / _FOREIGN).write_text("\n".join(sorted(names)), encoding="utf-8")
    if any(_is_source(f) for f in files):
        (folder / _SOURCES).touch()


def _is_source(file: PurePosixPath) -> bool:
    return file.parts[0] == "sources" and file.suffix in _C


def _has_sources(folder: Path) -> bool:
    here = (p.relative_to(folder) for p in (folder / "sources").rglob("*"))
    return (folder / _SOURCES).exists() or any(_is_source(PurePosixPath(p.as_posix())) for p in here)


def platforms_in(folder: Path) -> tuple[str, ...]:
    """Return the names of the platforms an unpacked FMU carries a binary for, as it names them."""
    binaries, foreign = folder / "binaries", folder / _FOREIGN
    names = foreign.read_text(encoding="utf-8").split() if foreign.is_file() else []
    if binaries.is_dir():
        names += [p.name for p in binaries.iterdir() if p.is_dir() and any(p.glob(f"*{_suffix(p.name)}"))]
    return tuple(sorted(names))


def binary_path(folder: Path, identifier: str, *, source: str) -> Path:
    """Return the shared library of `identifier` for this machine.

    Raises:
        FmuError: there is none; the message says for which platforms there is one, or how to make one. Or it would not
            be inside the FMU.
    """
    if {"/", "\\", "\0"} & set(identifier) or identifier in {"", ".", ".."}:
        raise FmuError(f"{source}: modelIdentifier '{identifier}' does not name a file in the FMU; refused")
    for name in folders_of(host()):
        path = folder / "binaries" / name / f"{identifier}{_suffix(name)}"
        if path.is_file():
            return path
    here = [f"{name}/{p.name}" for name in folders_of(host()) for p in (folder / "binaries" / name).glob("*")]
    libraries = ", ".join(sorted(file for file in here if file.endswith(_suffix(host()))))
    if libraries:
        raise FmuError(
            f"{source}: its modelIdentifier is {identifier}, but its binary is called otherwise ({libraries}); "
            "rename the file, or change modelIdentifier in modelDescription.xml"
        )
    names = platforms_in(folder)
    has = ", ".join(f"{n} (WebAssembly, which does not run here)" if n.startswith(_WEB) else n for n in names)
    missing = f"no binary {identifier} for this platform {host()} (has: {has or 'none at all'})"
    if _has_sources(folder):
        raise FmuError(f"{source}: {missing}; it has its sources, so make one: workbench build {source}")
    elsewhere = any(not name.startswith(_WEB) for name in names)
    instead = "run it on one of those, or ask its maker for this one" if elsewhere else "ask its maker for one"
    raise FmuError(f"{source}: {missing}; {instead}")

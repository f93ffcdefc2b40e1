"""Models that ship with the workbench: `fmu:NAME` (FMI 2.0), `fmu:NAME@3` (FMI 3.0) and `system:NAME` (system file)."""

from __future__ import annotations

from pathlib import Path

from workbench.core.machine.bundled_files import bundled_files, find_bundled
from workbench.core.machine.files import close_files
from workbench.errors import InputError

__all__ = [
    "bundled_names",
    "bundled_path",
    "bundled_systems",
    "is_bundled",
    "is_bundled_system",
    "name_of_bundled",
    "what_is_meant",
]

_FMU, _SYSTEM = "fmu:", "system:"
_MODELS = (".fmu", ".toml", ".ssp", ".ssd")  # what a misspelt file may have been
_FOLDERS = {"2": "fmus/fmi2", "3": "fmus/fmi3"}


def is_bundled(name: str) -> bool:
    """Whether `name` asks for a bundled FMU or system."""
    return name.startswith((_FMU, _SYSTEM))


def is_bundled_system(name: str) -> bool:
    """Whether `name` asks for a bundled system."""
    return name.startswith(_SYSTEM)


def bundled_names() -> tuple[str, ...]:
    """Return the names of the bundled FMUs, sorted; each is there in FMI 2.0 and 3.0."""
    return tuple(bundled_files(_FOLDERS["2"], ".fmu"))


def bundled_systems() -> tuple[str, ...]:
    """Return the names of the bundled systems, sorted."""
    return tuple(bundled_files("systems"))


def name_of_bundled(path: Path) -> str:
    """Return `fmu:NAME`, `fmu:NAME@3` or `system:NAME`; empty where the file is not a bundled one."""
    names = {"fmi2": f"fmu:{path.stem}", "fmi3": f"fmu:{path.stem}@3", "systems": f"system:{path.stem}"}
    name = names.get(path.parent.name, "")
    try:
        return name if name and bundled_path(name) == path else ""
    except InputError:
        return ""


def bundled_path(name: str) -> Path:
    """Return the file of `fmu:NAME`, `fmu:NAME@3` or `system:NAME`.

    Raises:
        InputError: no such name; the message lists the known ones.
    """
    if is_bundled_system(name):
        return find_bundled(name, bundled_files("systems"), "system")
    stem, _, version = name.partition("@")
    version = version or "2"
    if version not in _FOLDERS:
        raise InputError(f"{name}: FMI version '{version}' is not bundled; write @2 or @3")
    return find_bundled(stem, bundled_files(_FOLDERS[version], ".fmu"), "FMU")


def what_is_meant(missing: Path) -> str:
    """Return a hint for a file that is not there: a bundled model without its prefix, or files of nearly that name."""
    name, folder = str(missing), missing.parent
    meant = [f"{_FMU}{n}" for n in bundled_names() if n == name]
    meant += [f"{_SYSTEM}{n}" for n in bundled_systems() if n == name]
    suffix = missing.suffix.lower()
    meant = meant or [str(folder / n) for n in close_files(missing, [suffix] if suffix in _MODELS else _MODELS)]
    return f"did you mean {', '.join(meant)}? Else " if meant else ""

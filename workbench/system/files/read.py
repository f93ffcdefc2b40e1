"""Read a system from a file, whatever its kind."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from workbench.core.machine.files import named_path
from workbench.core.records.named import named
from workbench.errors import InputError
from workbench.fmi.bundled import bundled_path, is_bundled_system, what_is_meant

if TYPE_CHECKING:  # telling systems from FMUs stays quick
    from workbench.system.description import SystemDescription

__all__ = ["is_system_file", "read_system"]


def is_system_file(path: str | Path) -> bool:
    """Whether `path` is `system:NAME`, names a system by its suffix, or is a folder with a SystemStructure.ssd."""
    if is_bundled_system(str(path)):
        return True
    named = named_path(path)
    return named.suffix.lower() in _READERS or (named / "SystemStructure.ssd").is_file()


def read_system(path: str | Path) -> SystemDescription:
    """Return the system that a .toml, .ssp or .ssd file describes (or the folder of an unpacked .ssp).

    The FMUs are there, but nothing is connected yet: `connection_checks.resolve` checks names, types and units.

    Args:
        path: path of the file or folder, or `system:NAME`, a bundled one.

    Raises:
        InputError: one line: no such file, or what in it is wrong, where, and what to do.
        FmuError: an .ssp that is not a zip archive, is damaged or would write outside of its folder.

    Examples:
        >>> system = wb.read_system("system:rudder_loop")
        >>> print([component.name for component in system.components])
        ['plant', 'error', 'gain']
    """
    file = bundled_path(str(path)) if is_bundled_system(str(path)) else Path(path).expanduser()
    if not file.exists():
        raise InputError(
            f"{path}: no such file; {what_is_meant(file)}give a system as .toml, .ssp or .ssd, or system:NAME"
        )
    if file.is_dir():
        if not is_system_file(file):
            raise InputError(f"{path}: a folder without SystemStructure.ssd; give a system as .toml, .ssp or .ssd")
        return _read(".ssd", file)
    if file.suffix.lower() not in _READERS:
        raise InputError(f"{path}: is not a system; give a .toml, .ssp or .ssd file")
    return _read(file.suffix.lower(), file)


def _read(suffix: str, file: Path) -> SystemDescription:
    system: SystemDescription = named(_READERS[suffix])(file)
    return system


# By name: loading a single FMU stays quick, and a file may name another, which is read in the same way.
_READERS: Mapping[str, str] = {
    ".toml": "workbench.system.files.toml_file:read_toml",
    ".ssp": "workbench.system.files.ssp_read:read_ssp",
    ".ssd": "workbench.system.files.ssp_read:read_ssd",
}

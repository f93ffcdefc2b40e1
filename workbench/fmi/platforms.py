"""Names of platforms: FMI 1.0 and 2.0 (`linux64`), FMI 3.0 (`x86_64-linux`), and this machine's."""

from __future__ import annotations

import platform
import sys
from collections.abc import Mapping
from pathlib import Path

from workbench.errors import FmuError

__all__ = ["TUPLES", "binary_path", "host", "platforms_in"]

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
SUFFIXES = {"linux": ".so", "windows": ".dll", "darwin": ".dylib"}


def host() -> str:
    """Return this process's FMI 3 platform tuple, e.g. `x86_64-linux`."""
    machine = _MACHINES.get(platform.machine().lower(), platform.machine().lower())
    if machine == "x86_64" and sys.maxsize < 2**32:
        machine = "x86"
    return f"{machine}-{_SYSTEMS.get(sys.platform, sys.platform)}"


def _folders(tuple_name: str) -> tuple[str, ...]:
    """Folder names under `binaries` that may hold code for one platform, best first."""
    old = tuple(name for name, new in TUPLES.items() if new == tuple_name)
    universal = ("darwin64",) if tuple_name == "aarch64-darwin" else ()
    return (tuple_name, *old, *universal)


def _suffix(folder: str) -> str:
    system = TUPLES.get(folder, folder).rpartition("-")[2]
    return SUFFIXES.get(system, ".so")


def platforms_in(folder: Path) -> tuple[str, ...]:
    """Return the names of the platforms an unpacked FMU carries a binary for, as it names them."""
    binaries = folder / "binaries"
    if not binaries.is_dir():
        return ()
    return tuple(sorted(p.name for p in binaries.iterdir() if p.is_dir() and any(p.glob(f"*{_suffix(p.name)}"))))


def binary_path(folder: Path, identifier: str, *, source: str) -> Path:
    """Return the shared library of `identifier` for this machine.

    Raises:
        FmuError: there is none; the message says for which platforms there is one.
    """
    for name in _folders(host()):
        path = folder / "binaries" / name / f"{identifier}{_suffix(name)}"
        if path.is_file():
            return path
    has = ", ".join(platforms_in(folder)) or "none at all"
    raise FmuError(f"{source}: no binary {identifier} for this platform {host()} (has: {has})")

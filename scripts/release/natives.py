"""What the native code in a wheel asks of the machine: is it what the wheel's platform tag promises?

The kernel must be there, alone, for the wheel's platform. It and every binary of the bundled FMUs must be for its own
processor, need the system's own libraries only, no newer C library (Linux) or macOS than the tag says, and name no
folder of the machine that compiled it.
"""

from __future__ import annotations

import re
import zipfile
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

from workbench.build.toolchain import KERNEL, PLATFORMS, Platform

if TYPE_CHECKING:
    import lief

__all__ = ["faults", "library_faults"]

# What each system always has; for Windows the universal C runtime, part of it since Windows 10.
SYSTEM_LIBRARIES = {
    "linux": r"lib[cm]\.so\.6|ld-linux-[\w-]+\.so\.\d",
    "windows": r"(?i)kernel32\.dll|api-ms-win-crt-[\w-]+\.dll",
    "darwin": r"/usr/lib/libSystem\.B\.dylib",
}
MACHINES = {
    "x86_64": {"X86_64", "AMD64"},
    "aarch64": {"AARCH64", "ARM64"},
}
FOLDERS = re.compile(rb"(?:/home/|/root/|/tmp/|/Users/|/var/folders/|[A-Z]:\\)[\w.\\/ -]{2,}")
_NUMBERS = re.compile(r"\d+")


def faults(wheel: Path, platform: Platform) -> list[str]:
    """Return what is wrong with the native code in a wheel, one line each; nothing if all is well."""
    found = []
    with zipfile.ZipFile(wheel) as archive:
        kernels = [name for name in archive.namelist() if "/kernel/lib/" in name]
        expected = [f"workbench/kernel/lib/{platform.name}/{KERNEL}{platform.suffix}"]
        if kernels != expected:
            found.append(f"has the kernels {kernels} instead of {expected}")
        for name in kernels:
            found += [f"{name}: {fault}" for fault in library_faults(archive.read(name), platform)]
        for name in archive.namelist():
            if name.endswith(".fmu"):
                found += [f"{name}: {fault}" for fault in _fmu_faults(archive.read(name))]
    return [f"{wheel.name}: {fault}" for fault in found]


def _fmu_faults(fmu: bytes) -> Iterator[str]:
    """What is wrong with the binaries of an FMU, each for the platform that its folder names."""
    by_folder = {name: platform for platform in PLATFORMS for name in (platform.name, platform.name_2)}
    with zipfile.ZipFile(BytesIO(fmu)) as archive:
        for name in archive.namelist():
            parts = PurePosixPath(name).parts
            if parts[0] == "binaries":
                for fault in library_faults(archive.read(name), by_folder[parts[1]]):
                    yield f"{name}: {fault}"


def library_faults(data: bytes, platform: Platform) -> list[str]:
    """Return what is wrong with a shared library for a platform, one line each.

    Args:
        data: the library.
        platform: what it is for.
    """
    import lief  # noqa: PLC0415 - slow to import, and all test processes import this module

    lief.logging.disable()  # it tells on stderr what it meets in our libraries for Windows, and reads on
    machine, _, system = platform.name.partition("-")
    library = lief.parse(BytesIO(data))
    newest = _version(platform.wheel)
    found = [f"names the folder {match!r}" for match in FOLDERS.findall(data)]
    if system == "linux" and isinstance(library, lief.ELF.Binary):
        machine_is, needed = library.header.machine_type.name, [str(name) for name in library.libraries]
        symbols = [str(a.name) for v in library.symbols_version_requirement for a in v.get_auxiliary_symbols()]
        found += [f"needs {name}" for name in symbols if not name.startswith("GLIBC_") or _version(name) > newest]
        found += [f"looks for libraries in {e}" for e in library.dynamic_entries if e.tag.name in {"RPATH", "RUNPATH"}]
    elif system == "windows" and isinstance(library, lief.PE.Binary):
        machine_is, needed = library.header.machine.name, [str(entry.name) for entry in library.imports]
    elif system == "darwin" and isinstance(library, lief.MachO.Binary):
        machine_is = library.header.cpu_type.name
        own = [str(entry.name) for entry in library.libraries if entry.command.name == "ID_DYLIB"]
        needed = [str(entry.name) for entry in library.libraries if entry.command.name != "ID_DYLIB"]
        found += _macos_faults(library, own, newest)
    else:
        return [f"is no library for {platform.name}"]
    if machine_is not in MACHINES[machine]:
        found.append(f"is for the processor {machine_is}, not {machine}")
    return found + [f"needs {name}" for name in needed if not re.fullmatch(SYSTEM_LIBRARIES[system], name)]


def _macos_faults(library: lief.MachO.Binary, own: list[str], newest: tuple[int, ...]) -> Iterator[str]:
    """What holds for macOS alone: the oldest one, the library's name, the signature that Apple's processors ask for."""
    oldest = tuple(library.build_version.minos) if library.build_version else (99,)
    if oldest[:2] > newest:
        yield f"needs macOS {'.'.join(map(str, oldest))}"
    if not (len(own) == 1 and own[0].startswith("@rpath/")):
        yield f"has the install name {own} instead of @rpath/…"
    if library.header.cpu_type.name == "ARM64" and not library.has_code_signature:
        yield "is not signed, which macOS on Apple's processors asks for"


def _version(name: str) -> tuple[int, ...]:
    """The first two numbers after the system's name: `manylinux_2_17_x86_64` → (2, 17), `GLIBC_2.14` → (2, 14)."""
    return tuple(int(number) for number in _NUMBERS.findall(name)[:2])

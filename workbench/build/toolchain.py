"""The C compiler that comes as a wheel (ziglang), and the platforms that it compiles for.

The FMU builder and the build hook of this package use it. Imports the standard library only (and our
modules that do the same), so that it works in the bare environment in which wheels are built.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from workbench.core.machine.files import cache_folder
from workbench.errors import BuildError, InputError
from workbench.fmi.platforms import host

__all__ = [
    "FLAGS",
    "KERNEL",
    "PLATFORMS",
    "CFile",
    "Platform",
    "chosen_platforms",
    "compile_all",
    "compile_files",
    "compile_kernel",
    "compile_library",
    "host_only",
    "require",
]

KERNEL = "workbench_kernel"  # name of the compiled inner loop, without suffix


@dataclass(frozen=True, slots=True)
class Platform:
    """One platform that FMUs and the kernel are built for.

    Attributes:
        name: FMI 3 platform tuple.
        name_2: FMI 2 folder; aarch64 has none in the standard, the tuple is used.
        target: the compiler's name for it.
        suffix: of shared libraries.
        wheel: platform tag of a wheel; the oldest C library and the oldest macOS in it are those of `target`.
        link: options for the linker; `{stem}` stands for the library's name.
    """

    name: str
    name_2: str
    target: str
    suffix: str
    wheel: str
    link: tuple[str, ...] = ()


_INSTALL_NAME = "-Wl,-install_name,@rpath/{stem}.dylib"
PLATFORMS = (
    Platform("x86_64-linux", "linux64", "x86_64-linux-gnu.2.17", ".so", "manylinux_2_17_x86_64", ("-lm",)),
    Platform("aarch64-linux", "aarch64-linux", "aarch64-linux-gnu.2.17", ".so", "manylinux_2_17_aarch64", ("-lm",)),
    Platform("x86_64-windows", "win64", "x86_64-windows-gnu", ".dll", "win_amd64"),
    Platform("x86_64-darwin", "darwin64", "x86_64-macos.11.0", ".dylib", "macosx_11_0_x86_64", (_INSTALL_NAME,)),
    Platform("aarch64-darwin", "aarch64-darwin", "aarch64-macos.11.0", ".dylib", "macosx_11_0_arm64", (_INSTALL_NAME,)),
)

# No fused multiply-add and no fast math: the same source gives the same numbers everywhere.
FLAGS = (
    "-std=c11", "-O2", "-shared", "-s", "-fvisibility=hidden", "-ffp-contract=off",
    "-Wall", "-Wextra", "-Wpedantic", "-Werror",
    "-Wno-strict-prototypes",  # the standard's FMI 3 headers declare functions with ()
)  # fmt: skip


# The parts of a library are optimised as one, where the linker that comes with the compiler can do that.
_AS_ONE: Mapping[str, tuple[str, ...]] = {".so": ("-flto",)}


def host_only() -> tuple[Platform, ...]:
    """Return the platform of this machine, alone; nothing where it is none of `PLATFORMS`."""
    return tuple(p for p in PLATFORMS if p.name == host())


def chosen_platforms(names: Sequence[str] | None, *, usual: str) -> tuple[Platform, ...]:
    """Return the platforms of these names, each once.

    Args:
        names: as FMI 3.0 (`x86_64-linux`) or 2.0 (`linux64`) has them; "host": this machine's; "all": every one.
        usual: the name where none is given.

    Raises:
        InputError: an unknown name, or this machine is none of `PLATFORMS`.
    """
    by_name = {name: (p,) for p in PLATFORMS for name in (p.name_2, p.name)} | {"all": PLATFORMS, "host": host_only()}
    known = ", ".join(p.name for p in PLATFORMS)
    result: dict[Platform, None] = {}
    for name in (usual,) if names is None else names:
        if name not in by_name:
            raise InputError(
                f"platform: no platform '{name}'; there are: {known}; host for this machine's, all for all"
            )
        if not by_name[name]:
            raise InputError(f"platform: this machine is none of those that can be compiled for: {known}")
        result |= dict.fromkeys(by_name[name])
    return tuple(result)


def require(*packages: str) -> None:
    """Check that what writes FMUs is installed.

    Args:
        packages: by the names by which they are imported.

    Raises:
        BuildError: one is missing.
    """
    missing = [name for name in packages if importlib.util.find_spec(name) is None]
    if missing:
        raise BuildError(f'writing FMUs needs {" and ".join(missing)}: pip install "fmi-workbench[build]"')


def compile_library(
    folder: Path,
    sources: Sequence[str],
    platform: Platform,
    output: Path,
    *,
    install_stem: str = "model",
) -> None:
    """Compile `sources` (names in `folder`) into the shared library `output`.

    Args:
        folder: where the sources and their headers are.
        sources: file names in it.
        platform: what to compile for.
        output: the library to write; its folder is made.
        install_stem: name that a library for macOS carries inside.

    Raises:
        BuildError: The compiler is missing or refuses the code.
    """
    require("ziglang")
    output.parent.mkdir(parents=True, exist_ok=True)
    # Relative names and a fixed working folder: no path of this machine reaches the binary.
    command = [
        "cc", "-target", platform.target, *FLAGS, *_AS_ONE.get(platform.suffix, ()),
        "-I.", *sources,
        "-o", str(output.resolve()), *(option.format(stem=install_stem) for option in platform.link),
    ]  # fmt: skip
    _run(command, folder, platform)
    _tidy(output)


def _run(command: Sequence[str], folder: Path, platform: Platform) -> None:
    """Run the compiler in a folder.

    Raises:
        BuildError: it refuses; the message has its first error.
    """
    cache = str(cache_folder("compiler"))
    environment = {**os.environ, "ZIG_GLOBAL_CACHE_DIR": cache, "ZIG_LOCAL_CACHE_DIR": cache}
    whole = [sys.executable, "-m", "ziglang", *command]
    result = subprocess.run(whole, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    if result.returncode != 0:
        lines = [line for line in result.stderr.splitlines() if "error" in line] or result.stderr.splitlines()
        reason = lines[0] if lines else f"it ended with code {result.returncode}"
        raise BuildError(f"the C compiler failed for {platform.name}: {_meant(reason)}")


def _meant(reason: str) -> str:
    """Return the compiler's first error, and what it means where that is not obvious."""
    for pattern, words in _MEANINGS:
        if result := pattern.search(reason):
            return f"{reason} ({words.format(result[1])})"
    return reason


_MEANINGS = (
    (re.compile(r"'([^']+)' file not found"), "{} is neither in the sources nor among the headers that come with C"),
    (re.compile(r"undefined symbol: (\S+)"), "no source defines {}; is a file missing in the list of sources?"),
)


def _tidy(output: Path) -> None:
    """Remove what the linker for Windows leaves beside a library."""
    for leftover in (output.with_suffix(".lib"), output.with_suffix(".pdb")):
        leftover.unlink(missing_ok=True)


@dataclass(frozen=True, slots=True)
class CFile:
    """A C or C++ file by somebody else.

    Attributes:
        name: in the folder of the sources.
        definitions: macros, "NAME" or "NAME=VALUE".
        folders: where its headers are looked for, in the folder of the sources.
    """

    name: str
    definitions: tuple[str, ...] = ()
    folders: tuple[str, ...] = ()


# What older compilers let pass is not an error here, and nobody reads the warnings of foreign code.
_FOREIGN = (
    "-O2", "-w", "-ffp-contract=off", "-fno-sanitize=undefined", "-Wno-error=implicit-function-declaration",
    "-Wno-error=implicit-int", "-Wno-error=int-conversion", "-Wno-error=incompatible-function-pointer-types",
    "-Wno-error=return-mismatch", "-Wno-unknown-warning-option",
)  # fmt: skip
_C = ".c"
# By suffix of the library: how its objects are compiled, and how it is linked. What is missing is found now, not when
# it is loaded; nothing of another library is taken in place of its own.
_OBJECTS: Mapping[str, tuple[str, ...]] = {".so": ("-fPIC",), ".dylib": ("-fPIC",)}
_LINKED: Mapping[str, tuple[str, ...]] = {".so": ("-Wl,-z,defs", "-Wl,-Bsymbolic", "-lpthread", "-ldl")}


def _silent(_: str) -> None:
    """Tell nobody."""


@contextmanager
def _told(platforms: Iterable[Platform], language: str, say: Callable[[str], None]) -> Iterator[None]:
    """Tell whoever waits when the compiler makes the C library of a platform first, as it does once on a machine."""
    stamps = {p.name: cache_folder("compiler") / f"made-{language}-{p.name}" for p in platforms}
    if new := [name for name, stamp in stamps.items() if not stamp.exists()]:
        say(
            f"compiling for {', '.join(new)}: this machine does so for the first time, and the compiler makes the C "
            "library of each platform first, which may take some minutes; later it is a matter of seconds"
        )
    yield
    for name in new:
        stamps[name].parent.mkdir(parents=True, exist_ok=True)
        stamps[name].touch()


def compile_files(
    folder: Path,
    files: Sequence[CFile],
    platform: Platform,
    output: Path,
    *,
    install_stem: str = "model",
    say: Callable[[str], None] = _silent,
) -> None:
    """Compile somebody else's files, each in its own way, into one shared library.

    Args:
        folder: where they and their headers are.
        files: what to compile.
        platform: what to compile for.
        output: the library to write; its folder is made.
        install_stem: name that a library for macOS carries inside.
        say: is told what takes long.

    Raises:
        BuildError: the compiler is missing or refuses the code; the message has its first error.
    """
    require("ziglang")
    output.parent.mkdir(parents=True, exist_ok=True)
    objects = [f"{output.resolve()}.{number}.o" for number in range(len(files))]

    def compile_one(file: CFile, object_file: str) -> None:
        language = ("cc", "-std=gnu11") if file.name.endswith(_C) else ("c++", "-std=c++17")
        command = [
            *language[:1], "-target", platform.target, "-c", *language[1:], *_FOREIGN,
            *_OBJECTS.get(platform.suffix, ()), *(f"-D{d}" for d in file.definitions),
            *(f"-I{f}" for f in file.folders), file.name, "-o", object_file,
        ]  # fmt: skip
        _run(command, folder, platform)

    # With -O2 the compiler's own parts, Windows' C library among them, are those of `compile_library`, compiled once.
    linker = "cc" if all(f.name.endswith(_C) for f in files) else "c++"
    command = [
        linker, "-target", platform.target, "-shared", "-s", "-O2", *objects, *_LINKED.get(platform.suffix, ()),
        "-o", str(output.resolve()), *(option.format(stem=install_stem) for option in platform.link),
    ]  # fmt: skip
    with _told([platform], linker, say):
        with ThreadPoolExecutor(max_workers=2) as pool:
            list(pool.map(compile_one, files, objects))
        _run(command, folder, platform)
    for made in objects:
        Path(made).unlink()
    _tidy(output)


def compile_all(
    folder: Path,
    sources: Sequence[str],
    platforms: Iterable[Platform],
    output: Path,
    stem: str,
    *,
    install_stem: str = "model",
    say: Callable[[str], None] = _silent,
) -> dict[str, Path]:
    """Compile for every platform, two at a time; return {platform name: library}.

    Args:
        folder: where the sources and their headers are.
        sources: file names in it.
        platforms: what to compile for.
        output: each library goes into a folder in it, named after the platform.
        stem: name of the libraries, without suffix.
        install_stem: name that libraries for macOS carry inside.
        say: is told what takes long.

    Raises:
        BuildError: As :func:`compile_library`.
    """
    chosen = list(platforms)
    libraries = {p.name: output / p.name / f"{stem}{p.suffix}" for p in chosen}

    def compile_one(platform: Platform) -> None:
        compile_library(folder, sources, platform, libraries[platform.name], install_stem=install_stem)

    with _told(chosen, "cc", say), ThreadPoolExecutor(max_workers=2) as pool:
        list(pool.map(compile_one, chosen))
    return libraries


def compile_kernel(folder: Path, platforms: Iterable[Platform]) -> Mapping[str, Path]:
    """Compile the C files in `folder` into ``lib/PLATFORM/workbench_kernel.*`` in it, where they have changed.

    Args:
        folder: the folder ``workbench/kernel`` of a checkout.
        platforms: what to compile for.

    Returns:
        {platform name: library}.

    Raises:
        BuildError: As :func:`compile_library`.
    """
    chosen = list(platforms)
    state = _digest(folder)
    libraries = {p.name: folder / "lib" / p.name / f"{KERNEL}{p.suffix}" for p in chosen}
    old = [p for p in chosen if not _is_fresh(libraries[p.name], state)]
    sources = sorted(f.name for f in folder.glob("*.c"))
    (folder / "lib").mkdir(exist_ok=True)
    # Compiled aside and moved, so that no process ever loads half a library, or one that changes under it.
    with tempfile.TemporaryDirectory(dir=folder / "lib", prefix="new-") as aside:
        made = compile_all(folder, sources, old, Path(aside), KERNEL, install_stem=KERNEL)
        for name, library in made.items():
            libraries[name].parent.mkdir(exist_ok=True)
            library.replace(libraries[name])
            _stamp(libraries[name]).write_text(state, encoding="utf-8")
    return libraries


def _digest(folder: Path) -> str:
    """What a compiled kernel depends on: its sources, the header that it shares, and this file with the flags."""
    digest = hashlib.sha256()
    for file in sorted([*folder.glob("*.[ch]"), *folder.parent.glob("build/runtime/event_rules.h"), Path(__file__)]):
        digest.update(file.name.encode() + b"\0" + file.read_bytes() + b"\0")
    return digest.hexdigest()


def _stamp(library: Path) -> Path:
    return library.with_suffix(".sources")


def _is_fresh(library: Path, state: str) -> bool:
    stamp = _stamp(library)
    return library.exists() and stamp.exists() and stamp.read_text(encoding="utf-8") == state

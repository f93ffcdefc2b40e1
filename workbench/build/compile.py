"""Compile C sources into shared libraries for all platforms, with one cross compiler from a wheel."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from workbench.errors import BuildError


@dataclass(frozen=True, slots=True)
class Platform:
    """One platform that FMUs are built for."""

    name: str  # FMI 3 platform tuple
    name_2: str  # FMI 2 folder; aarch64 has none in the standard, the tuple is used
    target: str
    suffix: str
    link: tuple[str, ...] = ()


PLATFORMS = (
    Platform("x86_64-linux", "linux64", "x86_64-linux-gnu.2.17", ".so", ("-lm",)),
    Platform("aarch64-linux", "aarch64-linux", "aarch64-linux-gnu.2.17", ".so", ("-lm",)),
    Platform("x86_64-windows", "win64", "x86_64-windows-gnu", ".dll"),
    Platform("x86_64-darwin", "darwin64", "x86_64-macos.11.0", ".dylib", ("-Wl,-install_name,@rpath/model.dylib",)),
    Platform("aarch64-darwin", "aarch64-darwin", "aarch64-macos.11.0", ".dylib",
             ("-Wl,-install_name,@rpath/model.dylib",)),
)  # fmt: skip

# No fused multiply-add and no fast math: the same source gives the same numbers everywhere.
FLAGS = (
    "-std=c11", "-O2", "-shared", "-s", "-fvisibility=hidden", "-ffp-contract=off",
    "-Wall", "-Wextra", "-Wpedantic", "-Werror",
    "-Wno-strict-prototypes",  # the standard's FMI 3 headers declare functions with ()
)  # fmt: skip


def _cache() -> Path:
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "fmi-workbench" / "compiler"


def compile_library(folder: Path, sources: Sequence[str], platform: Platform, output: Path) -> None:
    """Compile `sources` (names in `folder`) into the shared library `output`.

    Raises:
        BuildError: The compiler is missing or refuses the code.
    """
    if importlib.util.find_spec("ziglang") is None:
        raise BuildError('building FMUs needs the C compiler in a wheel: pip install "fmi-workbench[build]"')
    output.parent.mkdir(parents=True, exist_ok=True)
    # Relative names and a fixed working folder: no path of this machine reaches the binary.
    command = [
        sys.executable, "-m", "ziglang", "cc", "-target", platform.target, *FLAGS, "-I.", *sources,
        "-o", str(output.resolve()), *platform.link,
    ]  # fmt: skip
    cache = str(_cache())
    environment = {**os.environ, "ZIG_GLOBAL_CACHE_DIR": cache, "ZIG_LOCAL_CACHE_DIR": cache}
    result = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    if result.returncode != 0:
        lines = [line for line in result.stderr.splitlines() if "error" in line] or result.stderr.splitlines()
        raise BuildError(f"the C compiler failed for {platform.name}: {lines[0] if lines else 'no message'}")
    for leftover in (output.with_suffix(".lib"), output.with_suffix(".pdb")):
        leftover.unlink(missing_ok=True)


def compile_all(
    folder: Path, sources: Sequence[str], platforms: Iterable[Platform], output: Path, stem: str
) -> dict[str, Path]:
    """Compile for every platform, two at a time; return {platform name: library}."""
    libraries = {p.name: output / p.name / f"{stem}{p.suffix}" for p in platforms}
    with ThreadPoolExecutor(max_workers=2) as pool:
        jobs = [pool.submit(compile_library, folder, sources, p, libraries[p.name]) for p in platforms]
        for job in jobs:
            job.result()
    return libraries

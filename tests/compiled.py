"""Libraries that tests compile: each one once a run, and quickly, as are the archives around them.

`quick_compiler` is in force in every test (`tests/conftest.py`). It compiles what the package does, with its flags but
one: parts are not optimised as one, which takes seven times as long and changes no number. A test about the compiler
itself, or about bytes, asks for `real_compiler`; the bundled FMUs are compiled with all flags for all platforms by
`scripts/dev.py build --check`, and the tests run what is committed.
"""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Sequence
from importlib.metadata import version
from pathlib import Path

import pytest

import workbench.build.toolchain
import workbench.core.machine.files
from workbench.build.toolchain import Platform

__all__ = ["contents", "kept", "quick_compiler", "real_compiler"]

# What a compiler makes; anything else beside the sources may be read by it.
_MADE = {".a", ".dll", ".dylib", ".lib", ".library", ".o", ".pdb", ".so"}

_run, _AS_ONE = workbench.build.toolchain._run, workbench.build.toolchain._AS_ONE


class _Store:
    folder: Path | None = None  # of this run, the same for all test processes


def kept(key: Iterable[bytes], output: Path, make: Callable[[], object]) -> None:
    """Let a file be made, or take it from those of this run.

    Args:
        key: all that its contents depend on.
        output: the file.
        make: makes it; where that fails, nothing is kept.
    """
    if _Store.folder is None:
        make()
        return
    digest = hashlib.sha256()
    for part in key:
        digest.update(len(part).to_bytes(8, "big") + part)
    stored = _Store.folder / digest.hexdigest()
    if stored.exists():
        shutil.copyfile(stored, output)
        return
    make()
    aside = stored.with_suffix(f".{os.getpid()}-{hashlib.sha256(str(output).encode()).hexdigest()[:8]}")
    shutil.copyfile(output, aside)
    aside.replace(stored)  # whole, whoever else makes it, too


def contents(folders: Iterable[Path]) -> Iterator[bytes]:
    """Yield names and contents of all files in folders that a compiler may read."""
    for folder in folders:
        for file in sorted(f for f in folder.rglob("*") if f.suffix not in _MADE and f.is_file()):
            yield file.relative_to(folder).as_posix().encode()
            yield file.read_bytes()


def _key(command: Sequence[str], folder: Path, platform: Platform) -> Iterator[bytes]:
    yield version("ziglang").encode()
    yield platform.target.encode()
    out = command.index("-o") + 1
    for number, argument in enumerate(command):
        file = Path(argument)
        if number == out:
            yield b""
        elif file.is_absolute() and file.is_file():
            yield file.suffix.encode() + file.read_bytes()
        else:
            yield argument.encode()
    yield from contents([folder])


def _kept_run(command: Sequence[str], folder: Path, platform: Platform) -> None:
    output = Path(command[command.index("-o") + 1])
    kept(_key(command, folder, platform), output, lambda: _run(command, folder, platform))


@pytest.fixture(scope="session", autouse=True)
def quick_compiler(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Compile nothing twice, and without optimisation of the whole; compress little."""
    base = tmp_path_factory.getbasetemp()
    _Store.folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "compiled"
    _Store.folder.mkdir(exist_ok=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(workbench.build.toolchain, "_run", _kept_run)
        patch.setattr(workbench.build.toolchain, "_AS_ONE", {})
        patch.setattr(workbench.core.machine.files, "_LEVEL", 1)
        yield


@pytest.fixture
def real_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    """Compile as users do."""
    monkeypatch.setattr(workbench.build.toolchain, "_run", _run)
    monkeypatch.setattr(workbench.build.toolchain, "_AS_ONE", _AS_ONE)

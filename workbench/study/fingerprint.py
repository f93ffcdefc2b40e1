"""What a result depends on: the files that an analysis reads, and the code of the workbench."""

from __future__ import annotations

import hashlib
import re
import tomllib
from collections.abc import Iterator, Mapping
from functools import cache
from html import unescape
from pathlib import Path
from typing import Any

from workbench.fmi.bundled import bundled_path, is_bundled
from workbench.model.recipe import content_hash

__all__ = ["code_hash", "file_in", "hash_of", "hashes_of_model"]

_SYSTEM, _STRUCTURE = ".toml", ".ssd"
# Where a system structure names the files of its components.
_SOURCE = re.compile(r'\ssource\s*=\s*"([^"]*)"')

_LONGEST = 1000  # a longer text is no name of a file


@cache
def hash_of(path: Path) -> str:
    """Return the SHA-256 of a file or folder, read once in a process.

    Raises:
        InputError: it cannot be read.
    """
    return content_hash(path)


@cache
def code_hash() -> str:
    """Return the SHA-256 of the workbench itself: what another state of it measured is not taken for its own."""
    package = Path(__file__).resolve().parent.parent
    files = sorted(f for f in (*package.rglob("*.py"), *(package / "kernel" / "lib").rglob("*")) if f.is_file())
    digest = hashlib.sha256()
    for file in files:
        if "__pycache__" not in file.parts:
            digest.update(
                file.relative_to(package).as_posix().encode() + b"\0" + hashlib.sha256(file.read_bytes()).digest()
            )
    return digest.hexdigest()


def file_in(text: str, folder: Path) -> Path | None:
    """Return the file that a text names, relative to a folder; None: it names none.

    Args:
        text: such as "trim.json" or "delC=step.csv".
        folder: of the study.
    """
    name = text.rpartition("=")[2].strip()
    if not name or len(name) > _LONGEST or "\0" in name:
        return None
    path = folder / Path(name)
    try:
        return path if path.is_file() else None
    except OSError:
        return None


def hashes_of_model(model: str, folder: Path) -> dict[str, str]:
    """Return name → SHA-256 of every file that a model consists of: the FMU, or a system with its FMUs.

    Args:
        model: as the study names it.
        folder: that relative paths begin at.

    Raises:
        InputError: a file cannot be read.
    """
    return dict(_files(model, folder, ()))


def _files(model: str, folder: Path, before: tuple[Path, ...]) -> Iterator[tuple[str, str]]:
    if is_bundled(model):
        yield model, hash_of(bundled_path(model))
        return
    path = (folder / Path(model).expanduser()).resolve()
    if path in before:
        return
    yield model, hash_of(path)
    for name in _named_in(path):
        if is_bundled(name) or (path.parent / name).exists():
            yield from _files(name, path.parent, (*before, path))


def _named_in(path: Path) -> Iterator[str]:
    """Yield whatever may be a file inside a system's file."""
    if path.suffix.lower() == _SYSTEM:
        yield from _texts(_toml(path).get("components", {}))
    elif path.suffix.lower() == _STRUCTURE:
        yield from _sources(path)


def _toml(path: Path) -> Mapping[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError):
        return {}  # whoever opens it says what is wrong with it


def _texts(value: Any) -> Iterator[str]:  # noqa: ANN401 - whatever TOML can hold
    if isinstance(value, str) and 0 < len(value) < _LONGEST and "\n" not in value:
        yield value
    elif isinstance(value, Mapping):
        for item in value.values():
            yield from _texts(item)


def _sources(path: Path) -> Iterator[str]:
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return
    yield from (unescape(found[1]) for found in _SOURCE.finditer(text))

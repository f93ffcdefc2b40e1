"""What a result depends on: the files that an analysis reads, and the code of the workbench."""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Iterator, Mapping
from functools import cache
from html import unescape
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from workbench.core.records.plug_ins import packages
from workbench.core.records.record import read_toml_table
from workbench.errors import InputError
from workbench.fmi.bundled import bundled_path, is_bundled
from workbench.model.content_hash import content_hash

__all__ = ["Hashes", "code_hash"]

_SYSTEM, _STRUCTURE = ".toml", ".ssd"
# Where a system structure names the files of its components.
_SOURCE = re.compile(r'\ssource\s*=\s*"([^"]*)"')

_LONGEST = 1000  # a longer text is not the name of a file


@cache
def code_hash() -> str:
    """Return the SHA-256 of the workbench and its plug-ins: what another state of it measured is not its own."""
    package = Path(__file__).resolve().parent.parent
    digest = hashlib.sha256()
    for folder, pattern in ((package, "*.py"), (package / "kernel" / "lib", "*"), *_plug_in_files()):
        for file in sorted(f for f in folder.rglob(pattern) if f.is_file() and "__pycache__" not in f.parts):
            name = file.relative_to(folder.parent).as_posix().encode()
            digest.update(name + b"\0" + hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()


def _plug_in_files() -> Iterator[tuple[Path, str]]:
    """Yield the folder of each package that plug-ins are in, and which of its files are code."""
    for name in packages():
        spec = find_spec(name)
        folders = spec.submodule_search_locations if spec is not None else None
        if folders is not None:
            yield from ((Path(folder), "*.py") for folder in folders)
        elif spec is not None and spec.origin:
            yield Path(spec.origin).parent, Path(spec.origin).name


class Hashes:
    """SHA-256 of files, each read once by one object: what changes on disk is seen by the next one.

    Args:
        folder: of the study, that relative paths begin at.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._known: dict[Path, str] = {}

    def of_file(self, path: Path) -> str:
        """Return the hash of a file or folder.

        Raises:
            InputError: it cannot be read.
        """
        if path not in self._known:
            self._known[path] = content_hash(path)
        return self._known[path]

    def of_model(self, model: str) -> dict[str, str]:
        """Return name → hash of every file that a model consists of: the FMU, or a system with its FMUs.

        Args:
            model: as the study names it.

        Raises:
            InputError: a file cannot be read.
        """
        return dict(self._files(model, self._folder, ()))

    def of_word(self, word: str) -> dict[str, str]:
        """Return name → hash of what one argument names, such as "trim.json", "--actuator=fmu:Rudder" or "u=step.csv".

        Args:
            word: of a command; most name no file.

        Raises:
            InputError: the file cannot be read.
        """
        name = word.rpartition("=")[2].strip()
        if is_bundled(name):
            return self.of_model(name) if _exists(name) else {}
        return self.of_model(name) if self._is_file(name) else {}

    def _is_file(self, name: str) -> bool:
        if not name or len(name) > _LONGEST or "\0" in name:
            return False
        try:
            return (self._folder / name).is_file()
        except OSError:
            return False

    def _name(self, path: Path) -> str:
        """Return the file as seen from the study, so that a study that moves keeps its results."""
        try:
            return Path(os.path.relpath(path, self._folder)).as_posix()
        except ValueError:  # another drive of Windows
            return path.as_posix()

    def _files(self, model: str, folder: Path, before: tuple[Path, ...]) -> Iterator[tuple[str, str]]:
        path = bundled_path(model) if is_bundled(model) else (folder / Path(model).expanduser()).resolve()
        if path in before:
            return
        yield (model if is_bundled(model) else self._name(path)), self.of_file(path)
        for name in _named_in(path):
            if is_bundled(name) or (path.parent / name).exists():
                yield from self._files(name, path.parent, (*before, path))


def _exists(bundled: str) -> bool:
    try:
        bundled_path(bundled)
    except InputError:
        return False
    return True


def _named_in(path: Path) -> Iterator[str]:
    """Yield whatever may be a file inside a system's file."""
    if path.suffix.lower() == _SYSTEM:
        yield from _texts(_toml(path).get("components", {}))
    elif path.suffix.lower() == _STRUCTURE:
        yield from _sources(path)


def _toml(path: Path) -> Mapping[str, Any]:
    try:
        return read_toml_table(path)
    except InputError:
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
    yield from (unescape(match[1]) for match in _SOURCE.finditer(text))

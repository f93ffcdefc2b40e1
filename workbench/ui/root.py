"""The folder that a browser workbench shows: what can be opened from it, and nothing from outside."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Collection, Iterator
from pathlib import Path

from workbench.core.machine.bundled_files import bundled_files, find_bundled
from workbench.core.records.parsing import from_toml
from workbench.errors import InputError, WorkbenchError
from workbench.fmi.bundled import is_bundled
from workbench.jobs.store import FILE_NAME

__all__ = ["NotHereError", "ServedFolder", "has_envelope", "kind_of"]

_MOST = 2000  # entries that are listed
_DEEPEST = 6  # folders below folders
_DESCRIPTION = "modelDescription.xml"
_SKIPPED = {"node_modules", "__pycache__", "site-packages"}
_TEXTS = {"system": "systems", "study": "studies"}
_BEGINNING = 4096  # of a record's file, where its command and its model stand [byte]
_COMMAND = re.compile(r'^\s*\{\s*"command": "([\w-]+)"')
_MODEL = re.compile(r'"model": ("(?:[^"\\\x00-\x1f]|\\["\\/bfnrt])*")')
_SYSTEMS = {".toml", ".ssp", ".ssd"}
_FILES = {*_SYSTEMS, ".fmu", ".json", ".csv"}
_PREFIXES = ("fmu:", "system:", "study:")


class NotHereError(WorkbenchError):
    """A path that is not in the folder, leads out of it, or does not exist; which of these is not said."""


class ServedFolder:
    """A folder from which models, systems, studies and stores are opened.

    Args:
        folder: that is shown.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder.resolve()

    def find(self, text: str, *, new: bool = False) -> str:
        """Return what a command in the folder would be given for what the browser names: a bundled name, or a path.

        Args:
            text: "fmu:NAME", "system:NAME", "study:NAME", or a path relative to the folder.
            new: whether it need not exist.

        Raises:
            NotHereError: it is not in the folder, or a system that has parts which are not.
        """
        if text.startswith(_PREFIXES):
            return text
        path = self.path(text, new=new)
        if path.suffix.lower() in _SYSTEMS or path.is_dir():
            self._check_parts(text, path)
        if path.is_file() and kind_of(path) == "study":
            self.check_study(text, path.read_text(encoding="utf-8"), path)
        return self.name_of(path)

    def _check_parts(self, text: str, path: Path) -> None:
        from workbench.system.files.read import read_system  # noqa: PLC0415 - needs what the first page does not

        try:
            system = read_system(path)
        except WorkbenchError:
            return  # what is wrong with it is told by whoever runs it
        here = [self.folder, *([] if system.folder is None else [system.folder.folder.resolve()])]
        for part in system.components:
            file = getattr(part, "file", "")
            if not file or is_bundled(file):
                continue
            if not any(Path(file).resolve().is_relative_to(folder) for folder in here):
                raise NotHereError(
                    f"{text}: its {part.name} is not in this folder; start workbench ui in one that holds both"
                )

    def check_study(self, name: str, text: str, study: Path) -> None:
        """Refuse a study that names files outside: whatever in it is one beside the study, or behind a name's `=`.

        Args:
            name: of the study, as the browser names it.
            text: of the study.
            study: its file, which need not be there.

        Raises:
            NotHereError: it does.
        """
        try:
            words = list(_texts(from_toml(text)))
        except ValueError:  # who reads it says so
            return
        for word in words:
            for part in {word, word.rpartition("=")[2]} - {""}:
                try:
                    file = (study.parent / part).resolve()
                    there = file.exists()
                except (OSError, ValueError, RuntimeError):  # no name that a file can have
                    continue
                # A file that is not there is told with those beside it.
                if (there or file.suffix.lower() in _FILES) and not file.is_relative_to(self.folder):
                    raise NotHereError(
                        f"{name}: {part} is not in this folder; start workbench ui in one that holds both"
                    )
                if there and (file.suffix.lower() in _SYSTEMS or file.is_dir()) and file != study:
                    self._check_parts(name, file)

    def path(self, text: str, *, new: bool = False) -> Path:
        """Return the path of a file in the folder, links resolved.

        Args:
            text: relative to the folder.
            new: whether it need not exist.

        Raises:
            NotHereError: it is not in the folder.
        """
        try:
            result = (self.folder / text).resolve()
            there = new or result.exists()
        except (OSError, ValueError, RuntimeError):  # a name that no file can have, links in a circle
            there, result = False, self.folder
        if not there or not text or not result.is_relative_to(self.folder):
            raise NotHereError(f"{text}: not in this folder")
        return result

    def text_of(self, name: str) -> str:
        """Return the text of a system or study file.

        Raises:
            NotHereError: it is not in the folder.
            InputError: it cannot be read as text.
        """
        kind, _, stem = name.partition(":")
        bundled = bool(stem) and kind in _TEXTS
        path = find_bundled(name, bundled_files(_TEXTS[kind]), kind) if bundled else self.path(name)
        try:
            if path.is_file():  # opening a pipe would wait for who writes
                return path.read_text(encoding="utf-8")
        except (OSError, ValueError):
            pass
        raise InputError(f"{name}: cannot be read as text")

    def name_of(self, path: Path) -> str:
        """Return the path of a file relative to the folder, links resolved."""
        return path.relative_to(self.folder).as_posix()

    def listing(self) -> list[dict[str, str]]:
        """Return what can be opened: name and kind.

        Kinds are "fmu", "system", "study", "store", "data", "modelica"; "point" with its `model`, and "record", another
        analysis's JSON, with its `command`.
        """
        result = [{"name": name, "kind": kind} for name, kind in self._inside()]
        for entry in result:
            if entry["kind"] in {"point", "record"}:
                entry["command"], entry["model"] = _record_in(self.folder / entry["name"])
        for kind, folder, suffix in (
            ("fmu", "fmus/fmi2", ".fmu"),
            ("system", "systems", ".toml"),
            ("study", "studies", ".toml"),
        ):
            result += [{"name": f"{kind}:{name}", "kind": kind} for name in bundled_files(folder, suffix)]
        return result

    def _inside(self) -> Iterator[tuple[str, str]]:
        count = 0
        for at, folders, files in os.walk(self.folder):
            here = Path(at)
            depth = len(here.relative_to(self.folder).parts)
            folders[:] = sorted(f for f in folders if not f.startswith(".") and f not in _SKIPPED and depth < _DEEPEST)
            if _DESCRIPTION in files and here != self.folder:
                folders[:] = []
                yield here.relative_to(self.folder).as_posix(), "fmu"
                continue
            for file in sorted(files):
                # Opening a pipe would wait for who writes.
                if (here / file).is_file() and (kind := kind_of(here / file)):
                    count += 1
                    yield (here / file if kind != "store" else here).relative_to(self.folder).as_posix(), kind
            if count > _MOST:
                return


def _texts(value: object) -> Iterator[str]:
    """Yield every text of a TOML document."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict | list):
        for item in value.values() if isinstance(value, dict) else value:
            yield from _texts(item)


def _record_in(file: Path) -> tuple[str, str]:
    """Return the command that wrote a file and the name of its model, by its beginning; empty: it is no record."""
    try:
        with file.open("rb") as stream:
            begin = stream.read(_BEGINNING).decode("utf-8", "replace")
    except OSError:
        return "", ""
    command, model = _COMMAND.search(begin), _MODEL.search(begin)
    return command[1] if command else "", str(json.loads(model[1])) if model else ""


def has_envelope(text: str) -> bool:
    """Return whether the text of a study has a table [envelope]."""
    try:
        return "envelope" in from_toml(text)
    except ValueError:
        return False


def data_suffixes() -> Collection[str]:
    """Return the suffixes of recorded data that are not text."""
    from workbench.data.experiment.formats import READERS  # noqa: PLC0415 - NumPy, which `ui --help` does without

    return READERS.keys()


_KINDS = {".fmu": "fmu", ".ssp": "system", ".mo": "modelica", ".csv": "data", ".tsv": "data"}


def kind_of(file: Path) -> str:
    """Return what a file is to the workbench; empty: nothing."""
    suffix = file.suffix.lower()
    if file.name == FILE_NAME:
        return "store"
    if suffix == ".json":
        command, model = _record_in(file)
        return "" if not command else "record" if command != "trim" else "point" if model else ""
    if suffix != ".toml":
        return _KINDS.get(suffix, "data" if suffix in data_suffixes() else "")
    try:
        keys = from_toml(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return ""
    return "study" if "analyses" in keys else "system" if "components" in keys else ""

"""How to make a model again, in another process or on another machine."""

from __future__ import annotations

import hashlib
from abc import ABC, abstractmethod
from dataclasses import KW_ONLY, field, fields, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from workbench.core.records.option import values_of
from workbench.core.values.operating_point import OperatingPoint
from workbench.errors import InputError
from workbench.model.loading import Loading

if TYPE_CHECKING:
    from collections.abc import Mapping

    from workbench.fmi.variable import Value
    from workbench.model.base import Model
    from workbench.model.described_model import DescribedModel

__all__ = ["DEFAULT_TOLERANCE", "LoadRecipe", "Recipe", "content_hash", "files_of", "hash_of"]


DEFAULT_TOLERANCE = 1e-6

# Below this relative tolerance rounding takes over.
_TIGHTEST = 1e-12


class Recipe(ABC):
    """Small and picklable; opens the same model wherever it is sent.

    Obligations of a subclass:
      1. `open` returns a model that behaves as the one the recipe came from; whoever opens it closes it.
      2. `identity` names everything that influences what the model computes, and nothing else:
         results are kept under it.
    """

    @abstractmethod
    def open(self) -> Model:
        """Return the model.

        Raises:
            InputError, FmuError: as when it was loaded first.
        """

    @abstractmethod
    def identity(self) -> dict[str, Any]:
        """Return what tells this model from others, ready for JSON."""

    @abstractmethod
    def tighter(self, factor: float) -> Recipe:
        """Return the recipe of the same model with `factor` times its relative tolerance of the integration."""

    def content(self) -> str:
        """Return the SHA-256 of what the model is, whatever is set in it; empty: it cannot be told from another."""
        return ""

    @property
    def portable(self) -> bool:
        """Whether it can be sent to another process."""
        return True

    def packed(self) -> Recipe:
        """Return a recipe that needs no file of this machine."""
        return self

    def settled(self) -> Recipe:
        """Return what `packed` gave with its files in folders of this process, each FMU once for all recipes."""
        return self


class LoadRecipe(Loading, Recipe):
    """What `load` was told, and the file.

    Attributes:
        source: what the user named, for messages.
        at: where its sessions start; None: at the model's own start. See `Model.placed`.
    """

    if TYPE_CHECKING:
        start_values: Mapping[str, Value] = field(default_factory=dict)  # whole arrays are texts by now

    _: KW_ONLY
    source: str
    at: OperatingPoint | None = None

    def __eq__(self, other: object) -> bool:
        """Whether both make the same model."""
        if type(self) is not type(other):
            return NotImplemented
        return all(getattr(self, f.name) == getattr(other, f.name) for f in fields(self))

    __hash__ = None  # type: ignore[assignment]  # it holds mappings

    @abstractmethod
    def open(self) -> DescribedModel:
        """Return the model; see `Recipe.open`."""

    def settings(self) -> dict[str, Any]:
        """Return all of these but the file, ready for JSON."""
        known = values_of(self)
        return {
            **{name: value for name, value in known.items() if name != "periods" or value is not None},
            **({} if self.at is None else {"at": {**self.at.values, "time": self.at.time}}),
        }

    def tighter(self, factor: float) -> Self:
        return replace(self, tolerance=max(_TIGHTEST, factor * (self.tolerance or DEFAULT_TOLERANCE)))


def content_hash(path: Path) -> str:
    """Return the SHA-256 of a file's bytes, or of a folder's files (names and bytes, in a fixed order).

    Raises:
        InputError: it cannot be read.
    """
    try:
        if path.is_file():
            return _file_hash(path)
        digest = hashlib.sha256()
        for file in files_of(path):
            digest.update(f"{file.relative_to(path).as_posix()}\0{_file_hash(file)}\n".encode())
        return digest.hexdigest()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None


def hash_of(path: Path) -> str:
    """Return the same; what has not changed is read once.

    Raises:
        InputError: it cannot be read, or is not there.
    """
    if not path.exists():  # the hash of an absent folder would be that of an empty one
        raise InputError(f"{path}: no such file")
    files = [path] if path.is_file() else files_of(path)
    return _known_hash(path, tuple((f, (status := f.stat()).st_mtime_ns, status.st_size) for f in files))


@lru_cache(maxsize=256)
def _known_hash(path: Path, _state: tuple[tuple[Path, int, int], ...]) -> str:
    return content_hash(path)


def files_of(folder: Path) -> list[Path]:
    """Return the files in a folder and below, in a fixed order."""
    files = (p for p in folder.rglob("*") if p.is_file())
    return sorted(files, key=lambda p: p.relative_to(folder).as_posix())


def _file_hash(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()

"""What tells one file or folder from another."""

from __future__ import annotations

import hashlib
from functools import lru_cache
from pathlib import Path

from workbench.errors import InputError

__all__ = ["content_hash", "files_of", "hash_of"]


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

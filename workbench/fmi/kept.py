"""Descriptions that have been read, kept on disk for the next process: a large one takes seconds to read.

They lie in the user's cache folder, by the SHA-256 of their file and of the modules that read it. A folder that cannot
be written only means that nothing is kept. Each file begins with the name of what it holds and a hash of itself: what
is damaged, or lies there under another name, is read anew.
"""

from __future__ import annotations

import hashlib
import pickle
from contextlib import suppress
from functools import lru_cache
from io import BytesIO
from pathlib import Path
from typing import Any

from workbench.core.machine.cycles import undisturbed
from workbench.core.machine.files import cache_folder, replacing
from workbench.errors import InputError
from workbench.fmi import description, variable
from workbench.fmi.description import ModelDescription

__all__ = ["keep", "kept"]

_HEAD = 64  # bytes before the values
_MOST = 32  # files; the oldest are removed
_READERS = ("errors.py", "core/records/*.py", "core/values/*.py", "fmi/*.py")  # more than read: none is forgotten


def kept(digest: str) -> ModelDescription | None:
    """Return the description of a file; None: it is not kept.

    Args:
        digest: SHA-256 of the file and of the sizes with which it was read.
    """
    try:
        whole = _path(digest).read_bytes()
        values = memoryview(whole)[_HEAD:]
        if whole[:_HEAD] != _head(digest, values):
            return None
        with undisturbed():
            result = _Values(BytesIO(values)).load()
    except Exception:  # noqa: BLE001 - whatever a damaged file leads to
        return None
    return result if isinstance(result, ModelDescription) else None


def keep(digest: str, result: ModelDescription) -> None:
    """Keep a description, if the folder can be written.

    Args:
        digest: SHA-256 of the file and of the sizes with which it was read.
        result: what was read there.
    """
    with suppress(OSError, RuntimeError, InputError):  # no place, or no home
        path = _path(digest)
        path.parent.mkdir(parents=True, exist_ok=True)
        with undisturbed():
            values = pickle.dumps(result, pickle.HIGHEST_PROTOCOL)
        with replacing(path) as new, new.open("wb") as file:
            file.write(_head(digest, values))
            file.write(values)
        files = sorted(path.parent.glob("*.pickle"), key=lambda file: file.stat().st_mtime_ns)
        for old in files[:-_MOST]:
            old.unlink(missing_ok=True)


def _head(digest: str, values: bytes | memoryview) -> bytes:
    """Return what a file begins with: of which description it is, and the hash of its values."""
    return bytes.fromhex(digest) + hashlib.sha256(values).digest()


def _path(digest: str) -> Path:
    return cache_folder("descriptions") / f"{digest[:32]}-{_of_readers()}.pickle"


@lru_cache(maxsize=1)
def _of_readers() -> str:
    """Return what differs when descriptions would be read differently."""
    package = Path(__file__).parent.parent
    whole = hashlib.sha256()
    for file in sorted(file for pattern in _READERS for file in package.glob(pattern)):
        whole.update(file.read_bytes())
    return whole.hexdigest()[:16]


class _Values(pickle.Unpickler):
    """Reads values of a description and nothing else: a file can name no function to be called."""

    def find_class(self, module: str, name: str) -> Any:
        for home in (description, variable):
            if module == home.__name__ and name in home.__all__:
                return getattr(home, name)
        raise pickle.UnpicklingError(name)

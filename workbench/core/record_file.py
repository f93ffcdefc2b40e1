"""Reading the files of records that other requests wrote."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from workbench.errors import InputError

__all__ = ["read_record"]

_Result = TypeVar("_Result")


def read_record(option: str, path: str | Path, build: Callable[[Mapping[str, Any]], _Result]) -> _Result:
    """Return the record that a JSON file holds.

    Args:
        option: that named the file, for messages.
        path: of the file.
        build: makes the result of the file's object.

    Raises:
        InputError: no such file, not JSON, or something else than `build` takes.
    """
    try:
        data = json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{option}: {path}: cannot be read: {error.strerror or error}") from None
    except ValueError as error:
        raise InputError(f"{option}: {path}: is not JSON: {error}") from None
    if not isinstance(data, Mapping):
        raise InputError(f"{option}: {path}: holds no result of a command")
    try:
        return build(data)
    except InputError as error:
        raise InputError(f"{option}: {path}: {error}") from None

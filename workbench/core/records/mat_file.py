"""Records as MATLAB files."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

from workbench.core.machine.files import replacing
from workbench.errors import InputError

__all__ = ["matlab_names", "write_mat"]

_LONGEST = 63  # of a name [characters]: MATLAB's namelengthmax
_KEYWORDS = frozenset(
    {
        *("break", "case", "catch", "classdef", "continue", "else", "elseif", "end", "for", "function", "global", "if"),
        *("otherwise", "parfor", "persistent", "return", "spmd", "switch", "try", "while"),
    }
)


def write_mat(path: str | Path, values: Mapping[str, Any]) -> None:
    """Write values as variables of MATLAB.

    Parts and mappings become structs, lists of texts cell arrays, one-dimensional arrays columns; what there is not is
    an empty array.

    Args:
        path: of the file.
        values: by name.

    Raises:
        InputError: another suffix than .mat, or the file cannot be written.
    """
    from scipy.io import savemat  # noqa: PLC0415 - slow to import

    if Path(path).suffix.lower() != ".mat":
        raise InputError(f"{path}: a MATLAB file must end in .mat")
    with replacing(path) as part, part.open("wb") as file:
        savemat(file, _struct(values), long_field_names=True, oned_as="column")


def matlab_names(names: Iterable[str]) -> dict[str, str]:
    """Return each name as MATLAB allows it: letters, digits and underscores, a letter first, each once.

    Args:
        names: of variables, or of the fields of a struct.
    """
    result: dict[str, str] = {}
    for name in names:
        plain = re.sub(r"\W", "_", name, flags=re.ASCII).rstrip("_") or "x"
        plain = (
            plain if plain[0].isascii() and plain[0].isalpha() and plain not in _KEYWORDS else f"x_{plain.lstrip('_')}"
        )
        plain, number = plain[:_LONGEST], 2
        unique, taken = plain, set(result.values())
        while unique in taken:
            unique, number = f"{plain[: _LONGEST - len(str(number)) - 1]}_{number}", number + 1
        result[name] = unique
    return result


def _struct(values: Mapping[Any, Any]) -> dict[str, Any]:
    names = matlab_names(map(str, values))
    return {names[str(name)]: _held(value) for name, value in values.items()}


def _held(value: Any) -> Any:  # noqa: ANN401, PLR0911 - whatever a record holds, a line each
    import numpy as np  # noqa: PLC0415 - as above

    if value is None:
        return np.zeros((0, 0))
    if isinstance(value, str | bool | int | float | complex | np.number):
        return value
    if isinstance(value, Path):
        return str(value)
    if is_dataclass(value):
        return _struct({declared.name: getattr(value, declared.name) for declared in fields(value)})
    if isinstance(value, Mapping):
        return _struct(value)
    if hasattr(value, "dtype"):
        return value if value.dtype.kind in "biufc" else _cell(value.tolist())
    items = list(value)
    if items and all(isinstance(item, int | float | complex) for item in items):
        return np.array(items)
    return _cell(items)


def _cell(items: list[Any]) -> Any:  # noqa: ANN401 - an array of objects
    import numpy as np  # noqa: PLC0415 - as above

    result = np.empty(len(items), dtype=object)
    for k, item in enumerate(items):
        result[k] = _held(item)
    return result

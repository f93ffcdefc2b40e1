"""Columns of numbers from the files of other tools, by suffix: MATLAB, Parquet, Feather, MDF, text for all others.

Readers of Parquet, Feather and MDF are packages of their own (pyarrow, asammdf); a file that needs one which is not
installed is refused with the name of the package.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.data.experiment.data_table import DataTable, read_table, with_unit
from workbench.errors import InputError

__all__ = ["read_columns"]


def read_columns(path: str | Path) -> DataTable:
    """Read the columns of a file.

    - ``.mat`` (MATLAB up to 7.2, and ``-v7``): numeric vectors of the most common length, matrices as one column each
      (y1, y2, …), fields of structures by their own names.
    - ``.parquet``, ``.feather``, ``.arrow``: numeric columns; units as a trailing " [unit]".
    - ``.mf4``, ``.mdf`` (ASAM MDF): numeric channels, put on the times of the one with most samples, time in seconds.
    - everything else: text, see `data_table.read_table`.

    Args:
        path: path of the file.

    Raises:
        InputError: no such file, nothing numeric in it, or a package is missing.
    """
    path = Path(path)
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        return read_table(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    columns, units, notes = reader(path)
    if not columns:
        raise InputError(f"{path}: contains no columns of numbers")
    split = [with_unit(name) for name in columns]
    known = [unit or units.get(name) for name, (_, unit) in zip(columns, split, strict=True)]
    values = np.column_stack(list(columns.values()))
    return DataTable(tuple(name for name, _ in split), tuple(known), values, tuple(notes))


_Columns = tuple[dict[str, Floats], dict[str, str | None], list[str]]


def _package(name: str, path: Path) -> Any:  # noqa: ANN401 - packages that need not be there
    try:
        return importlib.import_module(name)
    except ImportError:
        package = name.partition(".")[0]
        raise InputError(f"{path}: reading it needs the package {package}: pip install {package}") from None


# -- MATLAB ----------------------------------------------------------------------------------------


def _mat(path: Path) -> _Columns:
    from scipy.io import loadmat  # noqa: PLC0415 - slow to import, and seldom needed
    from scipy.io.matlab import MatReadError  # noqa: PLC0415

    try:
        held = loadmat(str(path), squeeze_me=True, struct_as_record=False)
    except NotImplementedError:
        raise InputError(f"{path}: is of MATLAB's format 7.3 (HDF5); save it with -v7, or as CSV") from None
    except (MatReadError, ValueError, TypeError, OSError) as error:
        raise InputError(f"{path}: cannot be read as MATLAB's: {error}") from None
    found: dict[str, Floats] = {}
    for name, value in held.items():
        if not name.startswith("__"):
            _gather(name, value, found)
    lengths = [len(v) for v in found.values() if len(v) > 1]
    most = max(set(lengths), key=lambda n: (lengths.count(n), n), default=0)
    left = [name for name, v in found.items() if len(v) != most]
    notes = [f"{path.name}: {', '.join(left[:5])} left out: other lengths than {most}"] if left else []
    return {name: v for name, v in found.items() if len(v) == most}, {}, notes


def _gather(name: str, value: Any, found: dict[str, Floats]) -> None:  # noqa: ANN401 - what a file holds
    """Add the vectors in a value to those found, the fields of a structure by their own names."""
    if hasattr(value, "_fieldnames"):
        for key in value._fieldnames:  # noqa: SLF001 - so SciPy documents it
            _gather(key if key not in found else f"{name}.{key}", getattr(value, key), found)
        return
    array = np.asarray(value)
    if array.dtype.kind not in "fiub" or array.ndim not in (1, 2):
        return
    if array.ndim == 1:
        found[name] = array.astype(np.float64)
        return
    rows = array if array.shape[0] >= array.shape[1] else array.T
    for k, column in enumerate(rows.T, 1):
        found[f"{name}{k}"] = column.astype(np.float64)


# -- Arrow and MDF ---------------------------------------------------------------------------------


def _arrow(path: Path, module: str) -> _Columns:
    reader = _package(module, path)
    try:
        table = reader.read_table(str(path))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read: {error}") from None
    columns = {}
    for name in table.column_names:
        values = table.column(name).to_numpy(zero_copy_only=False)
        if values.dtype.kind in "fiub":
            columns[name] = values.astype(np.float64)
        elif values.dtype.kind in "mM":  # a clock: seconds from its first instant
            columns[name] = (values - values[0]) / np.timedelta64(1, "ns") * 1e-9
    return columns, {}, []


def _parquet(path: Path) -> _Columns:
    return _arrow(path, "pyarrow.parquet")


def _feather(path: Path) -> _Columns:
    return _arrow(path, "pyarrow.feather")


def _mdf(path: Path) -> _Columns:
    asammdf = _package("asammdf", path)
    try:
        with asammdf.MDF(str(path)) as file:
            signals = [s for s in file.iter_channels() if s.samples.dtype.kind in "fiub" and s.samples.ndim == 1]
    except Exception as error:  # noqa: BLE001 - the package raises what its parsers raise
        raise InputError(f"{path}: cannot be read as MDF: {error}") from None
    if not signals:
        return {}, {}, []
    clock = max((s.timestamps for s in signals), key=len)
    columns, moved = {"time": np.asarray(clock, dtype=np.float64)}, list[str]()
    units: dict[str, str | None] = {"time": "s"}
    for s in signals:
        values = s.samples.astype(np.float64)
        if len(s.timestamps) != len(clock) or not np.array_equal(s.timestamps, clock):
            values = np.interp(clock, s.timestamps, values)
            moved.append(s.name)
        columns[s.name], units[s.name] = values, s.unit or None
    told = f"{path.name}: {', '.join(moved[:5])} put on the times of the channel with most samples, linear between"
    return columns, units, [told] if moved else []


_READERS: Mapping[str, Callable[[Path], _Columns]] = {
    ".mat": _mat,
    ".parquet": _parquet,
    ".feather": _feather,
    ".arrow": _feather,
    ".mf4": _mdf,
    ".mdf": _mdf,
}

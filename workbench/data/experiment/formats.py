"""Columns of numbers from text, whoever wrote it, and from MATLAB, Parquet, Feather and MDF.

Readers of Parquet, Feather and MDF are packages of their own (pyarrow, asammdf); a file that needs one which is not
installed is refused with the name of the package.
"""

from __future__ import annotations

import csv
import importlib
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from workbench.core.machine.files import content_of, file_path
from workbench.core.records.csv_file import is_number
from workbench.core.records.plug_ins import ExtensibleTable
from workbench.core.values.arrays import Floats
from workbench.errors import InputError, WorkbenchError, shortened

__all__ = ["READERS", "DataTable", "read_columns", "read_table"]

_SEPARATORS = (";", "\t", ",")
_UNIT = re.compile(r"^(?P<name>.*\S)\s+\[(?P<unit>[^\[\]]*)\]$")
_SYMBOL = (
    r"(?:[pnuµmcdhkMG]?(?:m|g|s|A|K|mol|cd|Hz|N|Pa|bar|J|W|Wh|V|VA|C|F|H|T|Wb|S|Ohm|Ω|rad|l|L)"
    r"|min|h|d|deg|degC|degF|°|°C|°F|%|1|-|rpm|rev|ft|in|lb|lbf|kn|kt|psi|t|dB)"
)
_POWER = r"(?:\^?-?\d+|[⁻²³¹]+)?"
_UNIT_ALONE = re.compile(rf"^{_SYMBOL}{_POWER}(?:(?:\s*[*/.·]\s*|\s+)\(?{_SYMBOL}{_POWER}\)?)*$")
_BRACKETS = re.compile(r"\[([^\[\]]*)\]|\(([^()]*)\)")  # [rad/(s2)], (s)
_REMARKS = ("#", "%", "//")
_ARRAYS = "wb.make_experiment makes data of arrays"


@dataclass(frozen=True)
class DataTable:
    """What stands in a file.

    Attributes:
        names, units: of the columns; unit None where the file names none.
        values: shape (n, columns).
        notes: what had to be bent to read it.
        remarks: lines of comment.
    """

    names: tuple[str, ...]
    units: tuple[str | None, ...]
    values: Floats
    notes: tuple[str, ...]
    remarks: tuple[str, ...] = ()


def read_table(path: str | Path) -> DataTable:
    """Read a table of numbers.

    The separator is a semicolon, a tab, a comma or, without any of these, white space; a decimal
    comma is understood where the comma is not the separator. Names may stand in the first line, each
    with its unit as a trailing " [unit]", or with the units in a line of their own below: in brackets, or ones in use
    (m/s2, N.m, °C).

    Raises:
        InputError: no such file, no numbers, a row of another length, a cell that is not a number.
    """
    path = file_path(path, otherwise=_ARRAYS)
    text, notes = _text(path)
    lines = [(number, line) for number, line in enumerate(text.splitlines(), 1) if line.strip()]
    separator = _separator([line for _, line in lines])
    if separator != ",":
        notes.append(f"{path}: the separator is {_spoken(separator)}")
    try:
        rows = [(number, _cells(line, separator)) for number, line in lines if not _is_remark(line)]
    except csv.Error as error:
        raise InputError(f"{path}: is not a table: {error}") from None
    longest = max((len(cells) for _, cells in rows), default=0)
    if longest > 1 and all(not cells[-1] for _, cells in rows if len(cells) == longest):
        # A separator at the end of every line is a habit of some tools; at the end of some, a value is missing.
        rows = [(number, cells[: longest - 1]) for number, cells in rows]
    start = _first_numbers(rows, separator)
    if start is None and len(rows) == 1:
        words = ", ".join(cell.strip() for cell in rows[0][1])
        raise InputError(f"{path}: has headings ({shortened(words)}) and no row of numbers below them")
    if start is None:
        raise InputError(f"{path}: contains no row of numbers; a table with one column per signal is needed")
    headings = rows[:start]
    values = _numbers(path, rows[start:], separator)
    if not headings:
        headings = _remark_heading(lines, separator, values.shape[1])
    names, units = _heading(path, headings, values.shape[1], notes)
    return DataTable(names, units, values, tuple(notes), tuple(line.strip() for _, line in lines if _is_remark(line)))


def _text(path: Path) -> tuple[str, list[str]]:
    try:
        raw = content_of(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None
    if b"\0" in raw[:4096]:
        raise InputError(f"{path}: is not text; export the data as CSV, or name it by its format (.mat, .parquet)")
    try:
        return raw.decode("utf-8-sig"), []
    except UnicodeDecodeError:
        return raw.decode("latin-1"), [f"{path}: is not UTF-8; names and units were read as Latin-1"]


def _separator(lines: Sequence[str]) -> str:
    """Return what separates the cells of the last line, the surest to be data; "" is white space."""
    last = lines[-1] if lines else ""
    return next((s for s in _SEPARATORS if s in last), "")


def _spoken(separator: str) -> str:
    return {";": "a semicolon", "\t": "a tab", "": "white space"}[separator]


def _cells(line: str, separator: str) -> list[str]:
    if not separator:
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator))]


def _is_remark(line: str) -> bool:
    return line.lstrip().startswith(_REMARKS)


def _number(cell: str, separator: str) -> float | None:
    text = cell if separator == "," else cell.replace(",", ".")
    if not cell:
        return math.nan
    return float(text) if is_number(text) else None


def _first_numbers(rows: Sequence[tuple[int, list[str]]], separator: str) -> int | None:
    for index, (_, cells) in enumerate(rows):
        if all(_number(cell, separator) is not None for cell in cells) and any(cells):
            return index
    return None


def _numbers(path: Path, rows: Sequence[tuple[int, list[str]]], separator: str) -> Floats:
    width = max(len(cells) for _, cells in rows[:1])
    values = np.empty((len(rows), width))
    for index, (line, cells) in enumerate(rows):
        if len(cells) != width:
            raise InputError(f"{path}, line {line}: {len(cells)} cells, but {width} in the lines before")
        for column, cell in enumerate(cells):
            number = _number(cell, separator)
            if number is None:
                raise InputError(f"{path}, line {line}, column {column + 1}: '{cell}' is not a number")
            values[index, column] = number
    return values


def _remark_heading(lines: Sequence[tuple[int, str]], separator: str, width: int) -> list[tuple[int, list[str]]]:
    """Return the names out of a remark before the data, as NumPy writes them."""
    for number, line in reversed(lines):
        if _is_remark(line):
            cells = _cells(line.strip().lstrip("#%/"), separator)
            if len(cells) == width:
                return [(number, cells)]
    return []


def _heading(
    path: Path, headings: Sequence[tuple[int, list[str]]], width: int, notes: list[str]
) -> tuple[tuple[str, ...], tuple[str | None, ...]]:
    fitting = [(number, cells) for number, cells in headings if len(cells) == width]
    if not fitting:
        notes.append(f"{path}: does not name its columns; they are called column1, column2, …")
        return tuple(f"column{i + 1}" for i in range(width)), (None,) * width
    split = [with_unit(cell) for cell in fitting[0][1]]
    names = tuple(name or f"column{i + 1}" for i, (name, _) in enumerate(split))
    units = tuple(unit for _, unit in split)
    if len(fitting) > 1 and not any(units):
        units = tuple(_unit_alone(path, fitting[1][0], cell) for cell in fitting[1][1])
        notes.append(f"{path}: the units are those of the second line")
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(f"{path}: column '{twice[0]}' appears twice; give every column a unique name")
    return names, units


def _unit_alone(path: Path, line: int, cell: str) -> str | None:
    within = _BRACKETS.fullmatch(cell)
    inner = cell if within is None else (within[1] or within[2] or "").strip()
    if inner and inner == cell and not _UNIT_ALONE.match(cell):
        raise InputError(
            f"{path}, line {line}: '{cell}' is neither a number nor a known unit; take the line out, or put units in "
            "brackets, as [V]"
        )
    return inner or None


def with_unit(cell: str) -> tuple[str, str | None]:
    """Return name and unit of a heading such as "stick [deg]".

    Args:
        cell: the heading.
    """
    match = _UNIT.match(cell)
    return (match["name"], match["unit"].strip() or None) if match else (cell, None)


def read_columns(path: str | Path) -> DataTable:
    """Read the columns of a file.

    - ``.mat`` (MATLAB up to 7.2, and ``-v7``): numeric vectors of the most common length, matrices as one column each
      (y1, y2, …), fields of structures by their own names.
    - ``.parquet``, ``.feather``, ``.arrow``: numeric columns; units as a trailing " [unit]".
    - ``.mf4``, ``.mdf`` (ASAM MDF): numeric channels, put on the times of the one with most samples, time in seconds.
    - what a plug-in reads, by the suffix that is its name.
    - everything else: text, see `read_table`.

    Args:
        path: path of the file.

    Raises:
        InputError: no such file, nothing numeric in it, or a package is missing.
    """
    path = file_path(path, otherwise=_ARRAYS)
    suffix = path.suffix.lower()
    if suffix in _TEXTS or (reader := READERS.get(suffix)) is None:
        return read_table(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    package = READERS.package_of(suffix)
    columns, units, notes = _read_by(package, reader, path) if package else reader(path)
    if not columns:
        raise InputError(f"{path}: contains no columns of numbers")
    split = [with_unit(name) for name in columns]
    known = [unit or units.get(name) for name, (_, unit) in zip(columns, split, strict=True)]
    values = np.column_stack(list(columns.values()))
    return DataTable(tuple(name for name, _ in split), tuple(known), values, tuple(notes))


_Columns = tuple[dict[str, Floats], dict[str, str | None], list[str]]


def _read_by(package: str, reader: Callable[[Path], Any], path: Path) -> _Columns:
    """Return what the reader of a plug-in gives: name, perhaps with its unit as a trailing " [unit]" → samples.

    Raises:
        InputError: its own, or what else went wrong in it.
    """
    try:
        columns = {str(name): np.asarray(values, dtype=np.float64) for name, values in reader(path).items()}
    except WorkbenchError:
        raise
    except Exception as error:  # noqa: BLE001 - whatever a foreign reader raises
        why = f"{type(error).__name__}: {error}"
        raise InputError(f"{path}: the reader of the package {package} failed: {why}") from None
    if len({values.shape for values in columns.values()}) > 1 or any(values.ndim != 1 for values in columns.values()):
        raise InputError(f"{path}: the reader of the package {package} returned columns that differ in length")
    return columns, {}, []


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
    result: dict[str, Floats] = {}
    for name, value in held.items():
        if not name.startswith("__"):
            _gather(name, value, result)
    lengths = [len(v) for v in result.values() if len(v) > 1]
    most = max(set(lengths), key=lambda n: (lengths.count(n), n), default=0)
    left = [name for name, v in result.items() if len(v) != most]
    notes = [f"{path.name}: {', '.join(left[:5])} left out: other lengths than {most}"] if left else []
    return {name: v for name, v in result.items() if len(v) == most}, {}, notes


def _gather(name: str, value: Any, result: dict[str, Floats]) -> None:  # noqa: ANN401 - what a file holds
    """Add the vectors in a value to those found, the fields of a structure by their own names."""
    if hasattr(value, "_fieldnames"):
        for key in value._fieldnames:  # noqa: SLF001 - so SciPy documents it
            _gather(key if key not in result else f"{name}.{key}", getattr(value, key), result)
        return
    array = np.asarray(value)
    if array.dtype.kind not in "fiub" or array.ndim not in (1, 2):
        return
    if array.ndim == 1:
        result[name] = array.astype(np.float64)
        return
    rows = array if array.shape[0] >= array.shape[1] else array.T
    for k, column in enumerate(rows.T, 1):
        result[f"{name}{k}"] = column.astype(np.float64)


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
    note = f"{path.name}: {', '.join(moved[:5])} put on the times of the channel with most samples, linear between"
    return columns, units, [note] if moved else []


_TEXTS = (".csv", ".txt", ".tsv")


def _wrong(name: str, held: Any) -> str:  # noqa: ANN401 - whatever a plug-in has
    if not name.startswith(".") or name != name.lower():
        return f"'{name}' is not the suffix of a file, in small letters, as .lvm"
    return "" if callable(held) else "is not a function of a path"


READERS: ExtensibleTable[Callable[[Path], Any]] = ExtensibleTable(
    "readers",
    {
        ".mat": _mat,
        ".parquet": _parquet,
        ".feather": _feather,
        ".arrow": _feather,
        ".mf4": _mdf,
        ".mdf": _mdf,
    },
    _wrong,
    taken=_TEXTS,
)

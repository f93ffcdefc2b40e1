"""Signals in CSV files: a column of times, columns of values, units in their headings."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from workbench.core.machine.files import content_of
from workbench.core.records.csv_file import is_number
from workbench.core.records.quantity import DecimalCommaError, number, quantity
from workbench.core.values.conversion import in_other_unit, named_conversion
from workbench.errors import InputError, suggest
from workbench.signals.kinds import Signal, Table
from workbench.signals.numbers import PLAIN, Numbers

__all__ = ["is_file", "named_columns", "named_heading", "read_table", "rows_of", "seconds_of"]

_FILES = (".csv", ".txt")
# A name and its unit; without a space between them numbers in brackets are indices.
_HEADING = re.compile(r"(?P<name>.*\S)(?:\s+[\[(]|\[(?!\s*\d+(?:\s*,\s*\d+)*\s*\]))(?P<unit>[^\[\]]*)[\])]")


def is_file(text: str) -> bool:
    """Return whether a signal's text is the name of a file."""
    return text.strip().lower().endswith(_FILES)


def read_table(path: str | Path, numbers: Numbers = PLAIN) -> Table:
    """Read a `Table` from a CSV file: time [s] in the first column, value in the second.

    One heading line is allowed, with units in brackets, as in `u [rad]`; separators are comma, semicolon, tab.

    Args:
        path: of the file.
        numbers: how its values are read: words among them are those of the input; their unit stands in the heading.

    Raises:
        InputError: no such file, not two columns of numbers, or a unit of time that is not known.
    """
    headings, rows = rows_of(Path(path))
    return _column(Path(path), headings, rows, 1, numbers)


class Row(list[str]):
    """The cells of a row.

    Attributes:
        line: its number in the file, from 1.
    """

    def __init__(self, cells: Iterable[str], line: int) -> None:
        super().__init__(cells)
        self.line = line


def rows_of(path: Path, called: str = "") -> tuple[list[str], list[Row]]:
    """Return the headings of a CSV file, with their units, and its rows; no headings: empty.

    Args:
        path: of the file.
        called: what messages call it; empty: by its path.

    Raises:
        InputError: it cannot be read, is not text, has no rows, or a row has more cells than there are headings.
    """
    name = called or path
    try:
        text = content_of(path).decode("utf-8-sig")
    except OSError as error:
        raise InputError(f"{name}: cannot be read: {error.strerror or error}") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{name}: is not UTF-8 text (byte {error.start}); save it as UTF-8") from None
    delimiter = next((d for d in ";\t" if d in text), ",")
    try:
        read = csv.reader(text.splitlines(), delimiter=delimiter)
        rows: list[Row] = [Row(row, read.line_num) for row in read if row]
    except csv.Error as error:
        raise InputError(f"{name}: is not a table of time and value: {error}") from None
    headings = [] if not rows or is_number(rows[0][0]) else [cell.strip() for cell in rows.pop(0)]
    if not rows:
        raise InputError(
            f"{name}: has no row {'below its headings' if headings else 'in it'}; needs time [s] and value"
        )
    long = next((row for row in rows if len(row) > len(headings) and any(row[len(headings) :])), None)
    if headings and long is not None:
        raise InputError(
            f"{name}: line {long.line} has {len(long)} cells below {len(headings)} headings; decimals follow a point, "
            "and where they follow a comma, columns are separated by semicolons"
        )
    return headings, rows


def _column(
    path: Path,
    headings: Sequence[str],
    rows: Sequence[Row],
    column: int,
    numbers: Numbers = PLAIN,
) -> Table:
    _, unit = named_heading(headings[column]) if column < len(headings) else ("", None)
    second = seconds_of(path, headings[0]) if headings else 1.0
    try:
        times = [in_other_unit(number(r[0]), (second, 0.0)) for r in rows]
        values = [_cell(f"{path}: line {r.line}", r[column], numbers) for r in rows]
    except (ValueError, IndexError):
        times, values = [], [math.nan]
    if not all(map(math.isfinite, values)) or not all(map(math.isfinite, times)):
        raise InputError(f"{path}: {_wrong(rows, column)}, time [s] and value")
    return Table(times, values, unit=unit)


def _wrong(rows: Sequence[Row], column: int) -> str:
    """Return which cell is the first that is not a number, and what a signal needs."""
    needed = "needs two columns of numbers" if column == 1 else f"needs numbers in its columns 1 and {column + 1}"
    for row in rows:
        for place in (0, column):
            cell = row[place].strip() if place < len(row) else ""
            if is_number(cell) and math.isfinite(float(cell)):
                continue
            try:
                quantity(cell)
                words = f"'{cell}' is not a finite number"
            except DecimalCommaError as error:
                words = str(error)
            except ValueError:
                words = f"'{cell}' is not a number"
            return f"line {row.line}, cell {place + 1}: {words if cell else 'is empty'}; {needed}"
    return needed


def _cell(where: str, text: str, numbers: Numbers) -> float:
    """Return the value in a cell; raises InputError with what is wrong where that is clear, else ValueError."""
    try:
        return numbers.plain(text)
    except ValueError:
        pass
    cell = text.strip()
    if numbers.words and cell:
        raise InputError(f"{where}: '{cell}' is not a value that the input can have; {suggest(cell, numbers.words)}")
    try:
        _, unit = quantity(cell)
    except DecimalCommaError as error:
        raise InputError(f"{where}: {error}") from None
    raise InputError(f"{where}: '{cell}' has a unit, which belongs to the heading, as in 'u [{unit}]'")


def named_columns(name: str, path: Path, numbers: Callable[[str], Numbers]) -> dict[str, Signal]:
    """Return what a CSV file holds for an input: its column, or those of an array's elements.

    A file of two columns holds it whatever they are called.

    Args:
        name: of the input.
        path: of the file.
        numbers: input → how its values are read.

    Raises:
        InputError: no such file or column, or what is in it is not a table of numbers.
    """
    headings, rows = rows_of(path)
    known = {named_heading(heading)[0]: number for number, heading in enumerate(headings) if number}
    width = len(headings) or max((len(row) for row in rows), default=0)
    if name in known:
        wanted = {name: known[name]}
    elif not (wanted := {one: number for one, number in known.items() if one.startswith(f"{name}[")}) and width <= 2:
        wanted = {name: 1}
    names = [named_heading(heading)[0] for heading in headings]
    if twice := next((one for one in wanted if names.count(one) > 1), None):
        raise InputError(f"{path}: {names.count(twice)} of its columns are called {twice}; rename or remove the others")
    if wanted:
        return {one: _column(path, headings, rows, number, numbers(one)) for one, number in wanted.items()}
    which = suggest(name, known) if known else "give it a line of headings"
    raise InputError(f"{path}: none of its {width} columns is called {name}; {which}")


def named_heading(heading: str) -> tuple[str, str | None]:
    """Return a column's name and unit: "u" and "m" for "u [m]", "u[m]" and "u (m)"; "u[2]" is an element.

    Args:
        heading: of the column.
    """
    match = _HEADING.fullmatch(heading)
    return (match["name"], match["unit"].strip() or None) if match else (heading, None)


def seconds_of(path: Path | str, heading: str) -> float:
    """Return how many seconds the unit in the heading of the column of times is.

    Args:
        path: of the file, for messages.
        heading: of the column.

    Raises:
        InputError: its unit is not one of time.
    """
    _, unit = named_heading(heading)
    factor, offset = named_conversion(unit or "s", "s") or (0.0, 0.0)
    if not factor or offset:
        raise InputError(f"{path}: the times of '{heading}' do not convert to s; give them in s")
    return factor

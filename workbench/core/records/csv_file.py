"""Tables as CSV files: one way to write them."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, TextIO

from workbench.core.machine.files import file_path, replacing
from workbench.errors import visible

__all__ = ["is_number", "write_csv"]

_FORMULA = ("=", "@", "+", "-", "\t", "\r")  # begins one in a spreadsheet


def write_csv(
    target: str | Path | TextIO,
    rows: Iterable[Sequence[Any]],
    *,
    remarks: Sequence[str] = (),
    units: Mapping[str, str | None] = MappingProxyType({}),
) -> None:
    """Write rows, the heading line first; None becomes an empty cell, a row of one cell with # a comment line.

    Args:
        target: path of the file, or an open text stream.
        rows: cells.
        remarks: lines before them.
        units: of columns by their heading, which becomes "name [unit]", unless the name says it, as frequency_hz does.

    Raises:
        InputError: the file cannot be written.
    """
    if not isinstance(target, str | Path) and not hasattr(target, "writelines"):
        file_path(target)
    if not isinstance(target, str | Path):
        target.writelines(f"{line}\n" for line in remarks)
        _write(target, rows, units)
        return
    with replacing(target) as path, path.open("w", newline="", encoding="utf-8") as file:
        write_csv(file, rows, remarks=remarks, units=units)


def _write(file: TextIO, rows: Iterable[Sequence[Any]], units: Mapping[str, str | None]) -> None:
    left, written = iter(rows), csv.writer(_Returned(), lineterminator="\n").writerow
    for row in left:
        if not _is_remark(row):
            file.write(written([_cell(_headed(cell, units)) for cell in row]))
            break
        file.write(f"{row[0]}\n")
    for row in left:
        numbers = [repr(cell) for cell in row if type(cell) is float]  # as csv writes them, in half the time
        if len(numbers) == len(row):
            file.write(",".join(numbers) + "\n")
        else:
            file.write(f"{row[0]}\n" if _is_remark(row) else written([_cell(cell) for cell in row]))


class _Returned:
    """A file for csv's writer: it returns what this returns."""

    def write(self, line: str) -> str:
        """Return what is written."""
        return line


def _is_remark(row: Sequence[Any]) -> bool:
    """Return whether a row is a remark, around which quotes would make it a cell."""
    return len(row) == 1 and str(row[0]).startswith("#")


def _headed(name: Any, units: Mapping[str, str | None]) -> Any:  # noqa: ANN401 - anything that a cell can be
    unit = units.get(name)
    return name if unit in {None, "", "1"} or name.endswith(f"_{str(unit).lower()}") else f"{name} [{unit}]"


def _cell(cell: Any) -> Any:  # noqa: ANN401 - anything that a cell can be
    """Return a cell that no spreadsheet takes for a formula, and no terminal for a command."""
    if not isinstance(cell, str):
        return cell
    return f"'{visible(cell)}" if cell.startswith(_FORMULA) and not is_number(cell) else visible(cell)


def is_number(text: str) -> bool:
    """Return whether a text is a number."""
    try:
        float(text)
    except ValueError:
        return False
    return "_" not in text  # Python's own way to write 10 as 1_0

"""Tables as CSV files: one way to write them."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, TextIO

from workbench.core.machine.files import replacing
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
    if not isinstance(target, str | Path):
        target.writelines(f"{line}\n" for line in remarks)
        _write(target, rows, units)
        return
    with replacing(target) as path, path.open("w", newline="", encoding="utf-8") as file:
        write_csv(file, rows, remarks=remarks, units=units)


def _write(file: TextIO, rows: Iterable[Sequence[Any]], units: Mapping[str, str | None]) -> None:
    writer, left = csv.writer(file, lineterminator="\n"), iter(rows)
    for row in left:
        if not _remarked(file, row):
            writer.writerow([_cell(_headed(cell, units)) for cell in row])
            break
    writer.writerows(
        [cell if type(cell) is float else _cell(cell) for cell in row] for row in left if not _remarked(file, row)
    )


def _remarked(file: TextIO, row: Sequence[Any]) -> bool:
    """Write a remark, and return whether it was one; quotes around it would make it a cell."""
    if len(row) != 1 or not str(row[0]).startswith("#"):
        return False
    file.write(f"{row[0]}\n")
    return True


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

"""Tables as CSV files: one way to write them."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, TextIO

from workbench.errors import InputError

__all__ = ["write_csv"]


def write_csv(target: str | Path | TextIO, rows: Iterable[Sequence[Any]], *, remarks: Sequence[str] = ()) -> None:
    """Write rows, the heading line first; None becomes an empty cell, a row of one cell with # a comment line.

    Args:
        target: path of the file, or an open text stream.
        rows: cells.
        remarks: lines before them.

    Raises:
        InputError: the file cannot be written.
    """
    if not isinstance(target, str | Path):
        target.writelines(f"{line}\n" for line in remarks)
        _write(target, rows)
        return
    try:
        with Path(target).open("w", newline="", encoding="utf-8") as file:
            write_csv(file, rows, remarks=remarks)
    except OSError as error:
        raise InputError(f"{target}: cannot be written: {error.strerror or error}") from None


def _write(file: TextIO, rows: Iterable[Sequence[Any]]) -> None:
    writer = csv.writer(file, lineterminator="\n")
    for row in rows:
        if len(row) == 1 and str(row[0]).startswith("#"):
            file.write(f"{row[0]}\n")  # quotes around it would make it a cell
        else:
            writer.writerow(row)

"""Time series beside an FMU as CSV files: a column of times, columns named after variables, arrays in one cell."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from workbench.core.records.quantity import number
from workbench.core.values.arrays import Floats
from workbench.errors import InputError
from workbench.fmi.variable import FLOAT_TYPES, Variable
from workbench.model.described_model import DescribedModel
from workbench.model.names import variables_of
from workbench.model.starts import conversion_to, elements_of
from workbench.signals.file import named_heading, rows_of, seconds_of

__all__ = ["Series", "read_series"]

_TRUTH = {"true": "1", "false": "0"}
_DIGITS = re.compile(r"[-+]?0*\.?0*(?P<digits>\d*\.?\d*)")
_FEWEST_DIGITS = 3  # numbers with fewer digits, as those of a staircase, are taken as exact
_ALIKE = 1e-3  # of a distance between rows: those that differ by less are equal
_USUAL = 0.5  # of the distances must be equal to be the usual one
_GAP = 1.5  # usual distances without a row


@dataclass(frozen=True)
class Series:
    """What a file says over time.

    Attributes:
        time: shape (n,) [s], rising.
        values: variable → shape (n,), in the variable's unit.
        rounding: variable → half a unit in the last digit that the file has of it, 0 where it may be exact.
        texts: columns of variables that are not numbers, which are not read.
        unknown: columns that are no variables of the model.
    """

    time: Floats
    values: dict[str, Floats]
    rounding: dict[str, float]
    texts: tuple[str, ...]
    unknown: tuple[str, ...]

    @property
    def distance(self) -> float | None:
        """The distance that at least half of the neighbouring rows have [s]; None: there is no such."""
        gaps = np.diff(self.time)
        if not gaps.size:
            return None
        usual = float(np.median(gaps))
        alike = np.abs(gaps - usual) <= _ALIKE * usual
        return usual if alike.mean() >= _USUAL else None

    @property
    def gap(self) -> tuple[float, float] | None:
        """Where rows are missing first: the times before and after [s]; None: nowhere, as far as can be told."""
        usual = self.distance
        if usual is None:
            return None
        wide = np.flatnonzero(np.diff(self.time) > _GAP * usual)
        return (float(self.time[wide[0]]), float(self.time[wide[0] + 1])) if wide.size else None


def read_series(path: Path, called: str, model: DescribedModel) -> Series:
    """Return the columns of a file that are variables of a model; of rows at the same time the last counts.

    Args:
        path: of the file.
        called: what messages call it.
        model: whose variables they are.

    Raises:
        InputError: not a table of numbers over rising times, a unit that does not convert, a column given twice.
    """
    headings, rows = rows_of(path, called)
    if not headings:
        raise InputError(f"{called}: has no line of headings, so that its columns are not known")
    for line, row in enumerate(rows, 2):
        if len(row) != len(headings):
            raise InputError(f"{called}: row {line} has {len(row)} cells, its headings are {len(headings)}")
    time = seconds_of(called, headings[0]) * _numbers([r[0] for r in rows], called, headings[0])
    if not (np.diff(time) >= 0.0).all():
        raise InputError(f"{called}: its times fall after t = {time[int(np.argmax(np.diff(time) < 0.0))]:g} s")
    last = np.append(np.diff(time) > 0.0, True)
    known = variables_of(model)
    values, rounding = dict[str, Floats](), dict[str, float]()
    texts, unknown = list[str](), list[str]()
    for place, heading in enumerate(headings[1:], 1):
        name, unit = named_heading(heading)
        cells = [row[place] for row in rows]
        elements = [name] if name in known else list(elements_of(name, known))
        if not elements:
            unknown.append(name)
        elif not known[elements[0]].is_number:
            texts.append(name)
        else:
            for one, column in zip(elements, _split(cells, elements, called), strict=True):
                if one in values:
                    raise InputError(f"{called}: two of its columns are called {name}")
                factor, offset = _conversion(known[one], unit, model, called)
                values[one] = factor * _numbers(column, called, name)[last] + offset
                rounding[one] = _rounding(column, values[one]) if known[one].type in FLOAT_TYPES else 0.0
    return Series(time[last], values, rounding, tuple(texts), tuple(unknown))


def _split(cells: Sequence[str], elements: Sequence[str], called: str) -> list[Sequence[str]]:
    """Return the columns of an array's elements, which stand in one cell with blanks between them."""
    if len(elements) == 1:
        return [cells]
    parts = [cell.split() for cell in cells]
    for line, part in enumerate(parts, 2):
        if len(part) != len(elements):
            name = elements[0].rpartition("[")[0]
            raise InputError(f"{called}: row {line} has {len(part)} numbers for the {len(elements)} elements of {name}")
    return [list(column) for column in zip(*parts, strict=True)]


def _numbers(cells: Sequence[str], called: str, name: str) -> Floats:
    try:
        values = np.array([number(_TRUTH.get(cell.strip().lower(), cell)) for cell in cells], dtype=np.float64)
    except ValueError as error:
        raise InputError(f"{called}: column {name}: {error}") from None
    if not np.isfinite(values).all():
        line = int(np.argmin(np.isfinite(values))) + 2
        raise InputError(f"{called}: column {name} is not a finite number in row {line}")
    return values


def _conversion(variable: Variable, unit: str | None, model: DescribedModel, called: str) -> tuple[float, float]:
    """Return how a column in a unit becomes values of the variable; without a unit they are that already."""
    if unit is None or not variable.unit or unit == variable.unit:
        return 1.0, 0.0
    result = conversion_to(variable, unit, model.description.units)
    if result is None:
        raise InputError(
            f"{called}: {variable.name} is in '{unit}', which does not convert to its unit, {variable.unit}"
        )
    return result


def _rounding(cells: Sequence[str], values: Floats) -> float:
    """Return half a unit in the last of the digits that a column has."""
    most = max((_digits(cell) for cell in cells), default=0)
    if most < _FEWEST_DIGITS:
        return 0.0
    return 0.5 * 10.0 ** (1 - most) * float(np.abs(values).max(initial=0.0))


def _digits(cell: str) -> int:
    match = _DIGITS.match(cell.strip())
    return 0 if match is None else len(match["digits"].replace(".", ""))

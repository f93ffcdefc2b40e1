"""Tables that several pages have, and numbers as text."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from workbench.core.values.conversion import rate_unit
from workbench.core.values.poles import POLE_HEADINGS, pole_rows
from workbench.show.page import PageTable, Section

__all__ = [
    "MOST_ENTRIES",
    "behind",
    "bracketed",
    "counted",
    "matrices",
    "matrix",
    "number",
    "pole_table",
    "sampled_rows",
    "sentence",
]

MOST_ENTRIES = 12  # matrices with more rows or columns are in the embedded data only
_MOST_IN_TERMINAL = 6  # of them
_MOST_POLES = 100


def number(value: float | None, form: str = ".5g") -> str:
    """Return a number as text; a dash where there is none."""
    return "–" if value is None or math.isnan(value) else format(value, form)


def bracketed(name: str, unit: str | None) -> str:
    """Return "name [unit]", or the name alone where there is no unit."""
    return f"{name} [{unit}]" if unit and unit != "1" else name


def sentence(text: str) -> str:
    """Return words as a sentence: with a capital and a full stop."""
    return f"{text[:1].upper()}{text[1:]}."


def behind(unit: str | None) -> str:
    """Return a unit as it stands behind a number: with a blank, or nothing where there is none."""
    return f" {unit}" if unit and unit != "1" else ""


def counted(count: int, one: str, several: str = "") -> str:
    """Return "1 point", "2 points"."""
    return f"{count} {one if count == 1 else several or one + 's'}"


def matrix(title: str, values: NDArray[np.float64], rows: Sequence[str], columns: Sequence[str]) -> PageTable:
    """Return a matrix with names at its rows and columns."""
    texts = [[name, *(f"{x:.6g}" for x in row)] for name, row in zip(rows, values.tolist(), strict=True)]
    return PageTable(("", *columns), texts, title=title, right=range(1, len(columns) + 1))


def matrices(
    values: Sequence[NDArray[np.float64]],
    states: Sequence[str],
    inputs: Sequence[str],
    outputs: Sequence[str],
    *,
    units: Mapping[str, str | None],
    dt: float,
) -> Section:
    """Return A, B, C, D of a linear model, names with units; large ones are in the JSON only.

    Args:
        values: A, B, C, D.
        states: names.
        inputs: names.
        outputs: names.
        units: of these names.
        dt: period of the model [s]; 0: continuous.
    """
    A, B, C, D = values
    largest = max(len(states), len(inputs), len(outputs))
    if largest > MOST_ENTRIES:
        sizes = f"{len(states)} states, {len(inputs)} inputs, {len(outputs)} outputs"
        words = f"{sizes}: too many to show here; the JSON has the matrices."
        return Section("Matrices", paragraphs=[words])
    x, u, y = ([bracketed(n, units.get(n)) for n in names] for names in (states, inputs, outputs))
    rates = [
        bracketed(f"{'next' if dt > 0.0 else 'd/dt'} {n}", units.get(n) if dt > 0.0 else rate_unit(units.get(n)))
        for n in states
    ]
    shown = (("A", A, rates, x), ("B", B, rates, u), ("C", C, y, x), ("D", D, y, u))
    tables = [matrix(*one) for one in shown if len(one[2]) and len(one[3])]
    return Section("Matrices", tables=tables, folded=True, explains=largest > _MOST_IN_TERMINAL)


def pole_table(poles: Iterable[complex], dt: float, title: str = "") -> PageTable:
    """Return poles with natural frequency, damping ratio and damped frequency, slowest first.

    Args:
        poles: of A.
        dt: its period [s]; 0: continuous.
        title: above the table.
    """
    every = pole_rows(poles, dt)
    rows = [(_complex(r.pole), r.natural, r.damping, r.damped) for r in every[:_MOST_POLES]]
    rest = f"the slowest {_MOST_POLES} of {len(every)}" if len(every) > _MOST_POLES else ""
    headings = (f"pole{'' if dt > 0.0 else ' [1/s]'}", *POLE_HEADINGS[1:])
    return PageTable(headings, rows, title=", ".join(filter(None, [title, rest])), right=range(4))


def _complex(z: complex) -> str:
    return f"{z.real:.6g}" if z.imag == 0.0 else f"{z.real:.6g} {'+' if z.imag > 0.0 else '−'} {abs(z.imag):.6g}j"


def sampled_rows(rows: Sequence[Sequence[str]], most: int) -> Sequence[Sequence[str]]:
    """Return at most so many rows, evenly spread, the first and the last among them."""
    if len(rows) <= most:
        return rows
    at = np.unique(np.linspace(0, len(rows) - 1, most).round().astype(int))
    return [rows[i] for i in at.tolist()]

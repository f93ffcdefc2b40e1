"""The exact Jacobian that an FMU offers: by rows, by groups of columns or by columns, whichever asks least of it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from workbench.core.values.arrays import Floats
from workbench.fmi.instance import Instance
from workbench.fmi.variable import Variable
from workbench.kernel.native_slopes import Pattern

__all__ = ["ExactJacobian"]

_SAME = 1e-9  # relative: the same derivatives, added up in another order
_AGREE = 1e-6  # relative: a direction in which the FMU's derivatives may have differences of their own


class ExactJacobian:
    """Makes a Jacobian of directional and adjoint derivatives.

    A call of adjoint derivatives gives a row, one of directional derivatives a column, or a group of columns that the
    FMU declares to move nothing in common. Rows and groups are compared with one more call, along a random direction;
    where that disagrees, the next way is taken.

    Args:
        instance: of model exchange, in continuous time; it offers one of the two.
        rows: number of the row → what changes.
        columns: number of the column → what moves it.
        calls: "adjoint" and "directional", counted up.
    """

    def __init__(
        self,
        instance: Instance,
        rows: Mapping[int, Variable],
        columns: Mapping[int, Variable],
        calls: Counter[str],
    ) -> None:
        self._instance = instance
        self._rows = rows
        self._columns = columns
        self._calls = calls

    def full(self, shape: tuple[int, int], pattern: Pattern | None) -> Floats:
        """Return the matrix of all rows and columns; other rows are 0, other columns NaN.

        Args:
            shape: number of all rows, and of all columns.
            pattern: which columns move which rows, as declared; None: unknown.
        """
        claims = self._instance.capabilities
        full = np.zeros(shape)
        full[:, [j for j in range(shape[1]) if j not in self._columns]] = np.nan
        fewest = len(self._columns) if pattern is None else len(pattern.ends)
        if claims.adjoint_derivatives and not claims.directional_derivatives:
            self._put(full, self._by_rows())
        elif not (
            (claims.adjoint_derivatives and len(self._rows) < fewest and self._by_true_rows(full))
            or (pattern is not None and self._by_groups(full, pattern))
        ):
            for column in self._columns:
                full[list(self._rows), column] = self._forward([column], np.ones(1))
        return full

    def _forward(self, columns: Sequence[int], seed: Floats) -> Floats:
        """Return by how much the rows change along a direction."""
        self._calls["directional"] += 1
        moved = [self._columns[j] for j in columns]
        return self._instance.directional_derivative(list(self._rows.values()), moved, seed.tolist())

    def _direction(self) -> Floats:
        return np.random.default_rng(3).uniform(0.5, 1.5, len(self._columns))

    def _put(self, full: Floats, values: Floats) -> None:
        full[np.ix_(list(self._rows), list(self._columns))] = values

    def _by_rows(self) -> Floats:
        """Return the entries, found row by row, shape (rows, columns)."""
        rows, columns = list(self._rows.values()), list(self._columns.values())
        self._calls["adjoint"] += len(rows)
        result = [self._instance.adjoint_derivative(rows, columns, e) for e in np.eye(len(rows)).tolist()]
        return np.array(result).reshape(len(rows), len(columns))

    def _by_true_rows(self, full: Floats) -> bool:
        """Fill in row by row; False: one directional derivative disagrees."""
        result, direction = self._by_rows(), self._direction()
        forward = self._forward(list(self._columns), direction)
        apart, size = np.abs(result @ direction - forward), np.abs(result) @ direction + np.abs(forward)
        if not (apart <= _SAME * size).all():
            return False
        self._put(full, result)
        return True

    def _by_groups(self, full: Floats, pattern: Pattern) -> bool:
        """Fill in several columns at once; False: one more direction disagrees, and what was filled in is 0 again."""
        places, columns = np.array(list(self._rows)), np.array(list(self._columns))
        of_row = _numbered(places, full.shape[0])
        of_column = _numbered(columns, full.shape[1])
        direction = self._direction()
        expected, size = np.zeros(len(places)), np.zeros(len(places))
        for members, moved, by in pattern.groups():
            some = members[of_column[members] >= 0]
            if not len(some):
                continue
            values = self._forward(some.tolist(), np.ones(len(some)))
            known = (of_row[moved] >= 0) & (of_column[by] >= 0)
            rows, causes = of_row[moved[known]], by[known]
            full[places[rows], causes] = values[rows]
            # A row occurs once in a group: its members move nothing in common.
            parts = values[rows] * direction[of_column[causes]]
            expected[rows] += parts
            size[rows] += np.abs(parts)
        if bool((np.abs(self._forward(columns.tolist(), direction) - expected) <= _AGREE * size).all()):
            return True
        self._put(full, np.zeros((len(places), len(columns))))
        return False


def _numbered(places: NDArray[np.intp], size: int) -> NDArray[np.intp]:
    """Return for each place its number among those given; -1: it is none of them."""
    result = np.full(size, -1)
    result[places] = np.arange(len(places))
    return result

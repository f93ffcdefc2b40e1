"""Which columns of a sparse matrix can be found together."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

__all__ = ["groups_of", "rows_by_column"]


def rows_by_column(depends: Iterable[Iterable[int]], n: int) -> list[list[int]]:
    """Return the rows of each of n columns.

    Args:
        depends: for each row the columns on which it depends.
        n: number of columns.
    """
    rows: list[list[int]] = [[] for _ in range(n)]
    for row, columns in enumerate(depends):
        for column in columns:
            rows[column].append(row)
    return rows


def groups_of(rows: Sequence[Sequence[int]]) -> list[list[int]]:
    """Return columns in groups of which no two have a row in common; each goes to the first group that takes it.

    Moved together, they move each row by what one of them does to it.

    Args:
        rows: of each column.

    Source: A. Curtis, M. Powell, J. Reid, On the estimation of sparse Jacobian matrices, J. Inst. Maths Applics 13
    (1974).

    Example:
    >>> groups_of([[0, 1], [0, 1, 2], [1, 2, 3], [2, 3]])
    [[0, 3], [1], [2]]
    """
    groups: list[list[int]] = []
    moved_by: dict[int, int] = {}  # row → the groups that move it, one bit each
    for column, own in enumerate(rows):
        taken = 0
        for row in own:
            taken |= moved_by.get(row, 0)
        free = ~taken & (taken + 1)  # the lowest bit that is not set
        number = free.bit_length() - 1
        if number == len(groups):
            groups.append([])
        groups[number].append(column)
        for row in own:
            moved_by[row] = moved_by.get(row, 0) | free
    return groups

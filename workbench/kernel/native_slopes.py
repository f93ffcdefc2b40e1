"""The linearised model along a run, as the kernel's structure."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from workbench.core.values.arrays import Floats
from workbench.core.values.grouping import groups_of, rows_by_column
from workbench.kernel.structs import Groups, Slopes, Sparsity

__all__ = [
    "BY_DIRECTIONAL",
    "BY_GROUPS",
    "BY_STATES",
    "NativeSlopes",
    "NativeSparsity",
    "Pattern",
    "believed",
    "pattern_of",
]

Indices = NDArray[np.uintp]

# SlopesWay in slopes.h: by directional derivatives, by differences of groups of states, of each state by itself.
BY_DIRECTIONAL, BY_GROUPS, BY_STATES = range(3)


@dataclass(frozen=True, eq=False)
class Pattern:
    """Which states are moved at once, and which of f and y each of them moves.

    Attributes:
        members: the n states, group after group, shape (n,).
        ends: where each group ends in `members`, shape (groups,).
        first: where the rows of each state begin in `rows`, shape (n + 1,); None: each may move all.
        rows: f, then y, of each state in turn.
        references: of `members`, and of the rows, for directional derivatives; None: they are not to be used.
    """

    members: Indices
    ends: Indices
    first: Indices | None = None
    rows: Indices | None = None
    references: tuple[NDArray[np.uint32], NDArray[np.uint32]] | None = None

    def groups(self) -> Iterator[tuple[Indices, Indices, Indices]]:
        """Yield each group: its states, the rows that they move, and the state that moves each row.

        Only of a pattern that says what each state moves.
        """
        begin = 0
        for end in self.ends.tolist():
            members = self.members[begin:end]
            begin = end
            yield members, *self._moved(members)

    def _moved(self, members: Indices) -> tuple[Indices, Indices]:
        if self.first is None or self.rows is None:
            raise ValueError("the pattern says nothing")
        begins, ends = (self.first[members + shift].astype(np.intp) for shift in (0, 1))
        counts = ends - begins
        places = np.arange(counts.sum()) + np.repeat(ends - counts.cumsum(), counts)
        return self.rows[places], np.repeat(members, counts)

    @property
    def structure(self) -> Groups:
        """The kernel's structure; the pattern must live as long as it is used."""
        return Groups(
            members=self.members.ctypes.data,
            ends=self.ends.ctypes.data,
            n_groups=len(self.ends),
            first=None if self.first is None else self.first.ctypes.data,
            rows=None if self.rows is None else self.rows.ctypes.data,
        )

    @property
    def way(self) -> int:
        """How to find the slopes, if nothing speaks against it."""
        if self.references is not None:
            return BY_DIRECTIONAL
        return BY_GROUPS if len(self.ends) < len(self.members) else BY_STATES


def pattern_of(depends: Sequence[Sequence[int] | None], n: int) -> Pattern:
    """Return which of n states can be moved at once without two of them moving the same row.

    Args:
        depends: for each row the states on which it depends; None: it may be all.
        n: number of states.
    """
    known = [d for d in depends if d is not None]
    if len(known) < len(depends):
        return Pattern(np.arange(n, dtype=np.uintp), np.arange(1, n + 1, dtype=np.uintp))
    rows = rows_by_column(known, n)
    groups = groups_of(rows)
    return Pattern(
        members=np.array([state for members in groups for state in members], dtype=np.uintp),
        ends=np.cumsum([len(members) for members in groups], dtype=np.uintp),
        first=np.cumsum([0, *map(len, rows)], dtype=np.uintp),
        rows=np.array([row for own in rows for row in own], dtype=np.uintp),
    )


class NativeSlopes:
    """The linearised model where a run passes given times; see slopes.h.

    Args:
        times: rising, shape (k,) [s].
        q: number of recorded variables.
        pattern: of the n states.

    Attributes:
        times: as given.
        x, dx: states and their derivatives there, shape (k, n).
        A: ∂f/∂x, shape (k, n, n).
        C: ∂y/∂x, shape (k, q, n).
    """

    def __init__(self, times: Floats, q: int, pattern: Pattern) -> None:
        k, n = len(times), len(pattern.members)
        self.times = np.ascontiguousarray(times, dtype=np.float64)
        self.x, self.dx = np.zeros((k, n)), np.zeros((k, n))
        self._a, self._c, self._work = np.zeros((k, n, n)), np.zeros((k, n, q)), np.zeros(7 * n + 5 * q)
        self.A, self.C = self._a.transpose(0, 2, 1), self._c.transpose(0, 2, 1)
        self._pattern = pattern
        self.structure = Slopes(
            times=self.times.ctypes.data,
            n_times=k,
            x=self.x.ctypes.data,
            dx=self.dx.ctypes.data,
            a=self._a.ctypes.data,
            c=self._c.ctypes.data,
            work=self._work.ctypes.data,
            groups=pattern.structure,
            way=pattern.way,
        )
        if pattern.references is not None:
            knowns, unknowns = pattern.references
            self.structure.knowns, self.structure.unknowns = knowns.ctypes.data, unknowns.ctypes.data
        self.address = ctypes.addressof(self.structure)

    @property
    def complete(self) -> bool:
        """Whether the model could be evaluated at all of the times."""
        return bool(self.structure.found == len(self.times))

    def refuted(self, way: int) -> bool:
        """Whether a way was given up at most of the times, not only where the model has a kink."""
        return bool(2 * self.structure.refuted[way] > self.structure.passed)


class NativeSparsity:
    """Where ∂f/∂x may differ from zero: a band, with the states in another order; see solver.h.

    Args:
        pattern: of the derivatives of n states alone; it must say what each of them depends on.

    Attributes:
        below, above: diagonals of the band beside its own.
        groups: number of evaluations for one Jacobian.

    Source of the order: E. Cuthill, J. McKee, Reducing the bandwidth of sparse symmetric matrices, Proc. 24th ACM
    National Conference (1969), reversed.

    Raises:
        ValueError: the pattern says nothing.
    """

    def __init__(self, pattern: Pattern) -> None:
        from scipy.sparse import csc_array  # noqa: PLC0415  slow to import, and only large models come here
        from scipy.sparse.csgraph import reverse_cuthill_mckee  # noqa: PLC0415

        if pattern.first is None or pattern.rows is None:
            raise ValueError("the pattern says nothing")
        n, first, rows = len(pattern.members), pattern.first, pattern.rows
        table = csc_array((np.ones(len(rows)), rows.astype(np.int32), first.astype(np.int32)), shape=(n, n))
        order = reverse_cuthill_mckee((table + table.T).tocsr(), symmetric_mode=True)
        self._pattern, self._place = pattern, np.empty(n, dtype=np.uintp)
        self._place[order] = np.arange(n, dtype=np.uintp)
        place = self._place.astype(np.int64)
        apart = place[rows] - np.repeat(place, np.diff(first).astype(np.intp))
        self.below, self.above = max(0, int(apart.max(initial=0))), max(0, int(-apart.min(initial=0)))
        self.groups = len(pattern.ends)
        self.structure = Sparsity(pattern.structure, self._place.ctypes.data, self.below, self.above)
        self.address = ctypes.addressof(self.structure)


def believed(pattern: Pattern, seen: NativeSlopes) -> Pattern:
    """Return a pattern without what a run has refuted."""
    if seen.refuted(BY_GROUPS):
        pattern = pattern_of([None], len(pattern.members))
    return replace(pattern, references=None) if seen.refuted(BY_DIRECTIONAL) else pattern

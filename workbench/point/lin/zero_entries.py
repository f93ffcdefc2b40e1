"""Why rows and columns of a linear model are zero."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from workbench.point.lin.result import LinResult, Zero

__all__ = ["DECLARED", "ELSEWHERE", "NOT_CONNECTED", "LargePerturbation", "zeros_of"]

Flags = NDArray[np.bool_]
NOWHERE = "nothing depends on it at this point"
ELSEWHERE = "no effect at this point, but an effect nearby: its factor is 0 here"
DECLARED = "no effect found at this point; by what is declared, {} may depend on it"
NOT_CONNECTED = "not connected: by what is declared, nothing depends on it"


@dataclass(frozen=True)
class LargePerturbation:
    """Which entries are zero here but not when their variable moves as far as its own scale.

    Attributes:
        rows: names of the rows.
        columns: names of the columns.
        above, below: shape (rows, columns), for a rising and a falling variable.
        looked: whether large perturbations were made.
        dead: variable without effect here → what is known of that: empty where nothing is.
    """

    rows: Sequence[str]
    columns: Sequence[str]
    above: Flags
    below: Flags
    looked: bool = True
    dead: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def none(cls, rows: Sequence[str], columns: Sequence[str], *, looked: bool = True) -> LargePerturbation:
        """Return a table in which nothing moves."""
        shape = (len(rows), len(columns))
        return cls(rows, columns, np.zeros(shape, dtype=bool), np.zeros(shape, dtype=bool), looked)

    def where(self, i: int, j: int) -> str:
        """Return whether an entry "rises", "falls" or, where both are so, "moves"."""
        return _direction(bool(self.above[i, j]), bool(self.below[i, j]))

    def of(self, name: str, *, row: bool) -> tuple[bool, bool]:
        """Return whether anything in a row or column moves above and below."""
        names = self.rows if row else self.columns
        indices = [i for i, n in enumerate(names) if n == name]
        axis = 0 if row else 1
        above, below = (np.take(t, indices, axis=axis).any() for t in (self.above, self.below))
        return bool(above), bool(below)


def zeros_of(result: LinResult, reach: LargePerturbation) -> tuple[Zero, ...]:
    """Return every zero row and column of a linear model with its reason."""
    A, B, C, D = result.A != 0.0, result.B != 0.0, result.C != 0.0, result.D != 0.0
    frozen = "no state or chosen input moves it: frozen"
    drifts = "no state or chosen input moves its derivative: it drifts at a constant rate or is frozen"
    kinds: tuple[tuple[str, Sequence[str], Flags, bool, str], ...] = (
        ("input", result.input_names, B.any(axis=0) | D.any(axis=0), False, NOWHERE),
        ("output", result.output_names, C.any(axis=1) | D.any(axis=1), True, frozen),
        ("rate", result.state_names, A.any(axis=1) | B.any(axis=1), True, drifts),
        ("state", result.state_names, A.any(axis=0) | C.any(axis=0), False, "it influences nothing: unobservable"),
    )
    zeros = []
    for kind, names, live, row, why in kinds:
        for name in (names[i] for i in np.flatnonzero(~live).tolist()):
            none = reach.dead.get(name) or why if kind == "input" else why
            zeros.append(Zero(kind, name, _reason(reach, name, row=row, none=none)))
    return tuple(zeros)


def _reason(reach: LargePerturbation, name: str, *, row: bool, none: str) -> str:
    if not reach.looked:
        return none
    above, below = reach.of(name, row=row)
    if above and below:
        return "locally flat: a wider perturbation moves it (quantised, dead zone or hysteresis)"
    if above or below:
        side = _direction(above, below)
        whose = "something" if row else "it"
        return f"saturated or switched off: only what happens when {whose} {side} far enough moves it"
    return none


def _direction(above: bool, below: bool) -> str:  # noqa: FBT001
    return "moves" if above and below else "rises" if above else "falls"

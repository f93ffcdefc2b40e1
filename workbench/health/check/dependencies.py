"""Does anything depend on what the model structure says it does not depend on?"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.fmi.variable import Variable
from workbench.health.check.differences import EvaluationPoint, places
from workbench.health.check.result import Answer
from workbench.health.check.subject import CheckedFmu

__all__ = ["dependencies"]

_MOVE = 0.05  # of a column's size: far enough for what is weak, and for most relations to change
_NOTHING = 1e-8  # of what moves the row most: less is rounding, or an equation solved by iteration
_LOOPS = (
    "systems order components and find algebraic loops by what is declared: in a closed loop it is evaluated too early"
)


def dependencies(subject: CheckedFmu) -> Answer:
    """Move each state and input; every derivative and output that answers must declare it.

    At three points of a test run each column is moved by 5 % of its size to both sides, in event mode, so that
    relations follow. A row answers where it moves by more than 1e-8 of its magnitude or of what moves it most,
    whichever is larger. Broken: it answers to a known that its list in ModelStructure leaves out; an output that is a
    state need not list itself. A list that is longer than needed is legal; how many entries never answered is told.
    Not applicable: no lists (then everything may depend on everything). Co-simulation shows no states and has no such
    line.
    """
    derivatives = subject.model.description.derivatives
    rows = [*derivatives, *(v for v in subject.model.outputs if v.is_number)]
    if not any(v.dependencies is not None for v in rows):
        return Answer("not applicable", "no dependencies are declared: everything may depend on everything")
    answers, strength = _measure(subject)
    if answers is None or strength is None:
        return Answer("not applicable", "no variable responded")
    return _judge(answers, strength)


class _OutputChanges:
    """Which rows answered to which columns, anywhere."""

    def __init__(self, place: EvaluationPoint, variables: Mapping[str, Variable]) -> None:
        self.rows, self.columns = place.rows, place.columns
        self.moved = np.zeros((len(self.rows), len(self.columns)), dtype=bool)
        self.declared = np.array([[_declares(r, c, variables) for c in self.columns] for r in self.rows], dtype=bool)


def _declares(row: Variable, column: Variable, variables: Mapping[str, Variable]) -> bool:
    """Whether the row's list, if it has one, holds the column, under any of its names; a row need not name itself."""
    if row.dependencies is None or row.name == column.name:
        return True
    whole = column.name.split("[", maxsplit=1)[0]
    if column.name in row.dependencies or whole in row.dependencies:
        return True
    same = {(variables[n].value_reference, variables[n].type) for n in row.dependencies if n in variables}
    return (column.value_reference, column.type) in same


def _measure(subject: CheckedFmu) -> tuple[_OutputChanges | None, Floats | None]:
    variables = {v.name: v for v in subject.model.description.variables}
    answers: _OutputChanges | None = None
    strength: Floats | None = None
    for place in places(subject):
        if not place.rows or not place.columns:
            return None, None
        answers = answers or _OutputChanges(place, variables)
        result = _moves(place)
        strength = result if strength is None else np.maximum(strength, result)
        answers.moved |= result > _NOTHING
    return answers, strength


def _moves(place: EvaluationPoint) -> Floats:
    """Return how far each row moves with each column, over its magnitude or its largest move, shape (rows, columns)."""
    moves = np.zeros((len(place.rows), len(place.columns)))
    base = place.at(np.zeros(len(place.columns)))
    if base is None:
        return moves
    for j in place.chosen:
        for sign in (1.0, -1.0):
            there = place.along(j, sign * _MOVE * place.sizes[j])
            if there is not None:
                moves[:, j] = np.maximum(moves[:, j], np.abs(there - base))
    size = np.maximum(np.abs(base), moves.max(axis=1, initial=0.0))
    result: Floats = moves / np.maximum(size, 1e-300)[:, None]
    return result


def _judge(answers: _OutputChanges, strength: Floats) -> Answer:
    hidden = answers.moved & ~answers.declared
    listed = np.array([r.dependencies is not None for r in answers.rows], dtype=bool)
    idle = int((answers.declared & ~answers.moved)[listed].sum())
    numbers = {"seen": int(answers.moved[listed].sum()), "undeclared": int(hidden.sum()), "never_seen": idle}
    if not hidden.any():
        tail = f"; {idle} declared ones never seen" if idle else ""
        return Answer("good", f"{numbers['seen']} dependencies seen, all declared{tail}", numbers=numbers)
    i, j = (int(k) for k in np.unravel_index(int(np.where(hidden, strength, -1.0).argmax()), hidden.shape))
    text = f"{answers.rows[i].name} depends on {answers.columns[j].name}, which it does not declare"
    more = f" (and {int(hidden.sum()) - 1} more)" if hidden.sum() > 1 else ""
    return Answer("broken", text + more, _LOOPS, numbers)

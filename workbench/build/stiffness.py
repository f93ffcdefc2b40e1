"""Decide at build time whether Co-Simulation needs the implicit integrator.

The equations are evaluated once at the start values, in plain Python, and the eigenvalues of ∂ẋ/∂x tell
the ratio of the fastest to the slowest time constant (Hairer and Wanner, *Solving Ordinary Differential
Equations II*, IV.1). It judges the start only: a model that turns stiff later is integrated correctly
but slowly; `build_fmu(stiff=…)` overrides the choice.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from workbench.build.causalise import Assignment
from workbench.build.differentiate import tangent
from workbench.build.emit_c import parameter_order
from workbench.build.expressions import (
    DOT,
    DOT_TANGENT,
    MATRIX,
    MATRIX_PRE,
    MATRIX_TANGENT,
    PRE,
    QUOTIENT,
    RELATION,
    TANGENT,
    VARIABLE,
    ExpressionNode,
    evaluate,
)
from workbench.build.scalar_model import ScalarModel
from workbench.core.machine.blas import one_thread
from workbench.core.values.grouping import groups_of, rows_by_column

STIFF_RATIO = 1.0e3
_ROWS = {DOT, DOT_TANGENT, MATRIX, MATRIX_PRE, MATRIX_TANGENT}


class _Point:
    """The equations evaluated at the start values."""

    def __init__(self, model: ScalarModel, order: Sequence[Assignment]) -> None:
        self.model = model
        self.values = [0.0] * len(model.variables)
        self.frozen: dict[tuple[str, int], float] = {}
        self.tangents: dict[int, float] = {}
        self._start()
        for step in order:
            self._evaluate(step)

    def _start(self) -> None:
        graph = self.model.graph
        for reference, variable in enumerate(self.model.variables):
            self.values[reference] = graph.value(variable.start) or 0.0
        for reference in parameter_order(self.model):
            self.values[reference] = self.number(self.model.bindings[reference])
        for reference, variable in enumerate(self.model.variables):
            if graph.value(variable.start) is None and reference not in self.model.bindings:
                self.values[reference] = self.number(variable.start)

    def number(self, expression: int) -> float:
        return evaluate(self.model.graph, expression, self._leaf)

    def _leaf(self, node: ExpressionNode) -> float:
        if node.operation in _ROWS:
            return self._row(node)
        reference = node.reference
        if node.operation in {VARIABLE, PRE}:
            return self.values[reference]
        if node.operation == TANGENT:
            return self.tangents.get(reference, 0.0)
        if node.operation in {RELATION, QUOTIENT}:
            return self.frozen.get((node.operation, reference), 0.0)
        return 0.0

    def _row(self, node: ExpressionNode) -> float:
        a, stride_a, x, stride_x, length = node.row
        factors = self.values if node.operation in {DOT, DOT_TANGENT} else self.model.graph.table
        pairs = [(a + i * stride_a, x + i * stride_x) for i in range(length)]
        if node.operation in {DOT_TANGENT, MATRIX_TANGENT}:
            return sum(factors[i] * self.tangents.get(j, 0.0) for i, j in pairs)
        return sum(factors[i] * self.values[j] for i, j in pairs)

    def _evaluate(self, step: Assignment) -> None:
        if step.kind == "variable" and step.expression is not None:
            self.values[step.target] = self.number(step.expression)
        elif step.kind == "relation":
            relation = self.model.relations[step.target]
            positive = self.number(relation.indicator) > 0.0
            self.frozen[RELATION, step.target] = float(positive == relation.holds_when_positive)
        elif step.kind == "quotient":
            self.frozen[QUOTIENT, step.target] = float(
                np.floor(self.number(self.model.quotients[step.target].argument))
            )


def jacobian(model: ScalarModel, order: Sequence[Assignment]) -> NDArray[np.float64]:
    """Return ∂ẋ/∂x [1/s], shape (n, n), at the start values and zero inputs."""
    point = _Point(model, order)
    moving = set(model.references("state", "algebraic", "derivative"))
    steps = [
        (s.target, tangent(model.graph, s.expression, moving))
        for s in order
        if s.kind == "variable" and s.expression is not None
    ]
    states = model.states
    of_state = model.derivatives
    rows = [of_state[s] for s in states]
    depends, place = _depends(model, steps), {s: i for i, s in enumerate(states)}
    moved = rows_by_column(((place[s] for s in depends[r]) for r in rows), len(states))
    matrix = np.zeros((len(states), len(states)))
    for group in groups_of(moved):
        point.tangents = {states[column]: 1.0 for column in group}
        for target, expression in steps:
            point.tangents[target] = point.number(expression)
        for column in group:
            for row in moved[column]:
                matrix[row, column] = point.tangents[rows[row]]
    return matrix


def _depends(model: ScalarModel, steps: Sequence[tuple[int, int]]) -> dict[int, set[int]]:
    """Return the states on which the tangent of each variable depends."""
    graph = model.graph
    result: dict[int, set[int]] = {s: {s} for s in model.states}
    for target, expression in steps:
        mine = set[int]()
        for number in graph.reachable([expression]):
            node = graph[number]
            if node.operation == TANGENT:
                mine |= result.get(node.reference, set())
            elif node.operation in {DOT_TANGENT, MATRIX_TANGENT}:
                _, _, x, stride, length = node.row
                mine = mine.union(*(result.get(x + i * stride, set()) for i in range(length)))
        result[target] = mine
    return result


def is_stiff(model: ScalarModel, order: Sequence[Assignment]) -> bool:
    """Return whether the fastest decay is :data:`STIFF_RATIO` times faster than the slowest motion."""
    if not model.states:
        return False
    return is_stiff_matrix(jacobian(model, order))


def is_stiff_matrix(matrix: NDArray[np.float64]) -> bool:
    """Return the same for ∂ẋ/∂x = `matrix` [1/s], shape (n, n)."""
    if not np.isfinite(matrix).all():
        return True
    with one_thread():
        eigenvalues = np.linalg.eigvals(matrix)
    decay = float(np.max(-eigenvalues.real, initial=0.0))
    moving = np.abs(eigenvalues)[np.abs(eigenvalues) > 1e-9 * max(1.0, decay)]
    slowest = float(np.min(moving, initial=np.inf))
    return bool(np.isfinite(slowest) and decay > STIFF_RATIO * slowest)

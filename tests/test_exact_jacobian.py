"""Exact Jacobians: by rows, by groups of columns or by columns; what disagrees with one more direction is not taken."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np
import pytest

from workbench.core.values.arrays import Floats
from workbench.fmi.description import Capabilities
from workbench.fmi.instance import Instance
from workbench.fmi.variable import Variable
from workbench.kernel.native_slopes import pattern_of
from workbench.session.exact_jacobian import ExactJacobian

N = 12
TRIDIAGONAL = np.diag(np.arange(1.0, N + 1)) + np.diag(np.full(N - 1, 2.0), 1) + np.diag(np.full(N - 1, -3.0), -1)
GROUPS = 3  # of columns that move no row in common


@dataclass
class Linear:
    """An instance whose rows are a matrix times its columns.

    Attributes:
        matrix: what is so.
        lies: by how much its adjoint derivatives are wrong.
    """

    matrix: Floats
    forward: bool
    adjoint: bool
    lies: float = 0.0
    capabilities: Capabilities = field(init=False)

    def __post_init__(self) -> None:
        self.capabilities = Capabilities("M", directional_derivatives=self.forward, adjoint_derivatives=self.adjoint)

    def directional_derivative(
        self, rows: Sequence[Variable], columns: Sequence[Variable], seed: list[float]
    ) -> Floats:
        assert self.forward
        column: Floats = self._part(rows, columns) @ np.array(seed)
        return column

    def adjoint_derivative(self, rows: Sequence[Variable], columns: Sequence[Variable], seed: list[float]) -> Floats:
        assert self.adjoint
        row: Floats = np.array(seed) @ self._part(rows, columns) + self.lies
        return row

    def _part(self, rows: Sequence[Variable], columns: Sequence[Variable]) -> Floats:
        part: Floats = self.matrix[np.ix_([v.element for v in rows], [v.element for v in columns])]
        return part


def found(instance: Linear, rows: Sequence[int], declared: Floats | None) -> tuple[Floats, Counter[str]]:
    """Return the Jacobian of some rows, and the calls."""
    calls: Counter[str] = Counter()
    named = [{i: Variable(f"{kind}{i}", element=i) for i in some} for kind, some in (("y", rows), ("x", range(N)))]
    pattern = None if declared is None else pattern_of([list(np.flatnonzero(row)) for row in declared], N)
    full = ExactJacobian(cast("Instance", instance), named[0], named[1], calls).full(instance.matrix.shape, pattern)
    return full, calls


WAYS: dict[str, tuple[dict[str, Any], int, Floats | None, dict[str, int]]] = {
    "few rows, backwards": ({"adjoint": True}, 2, TRIDIAGONAL, {"adjoint": 2, "directional": 1}),
    "fewer groups than rows": ({"adjoint": True}, N, TRIDIAGONAL, {"directional": GROUPS + 1}),
    "groups, no adjoint": ({"adjoint": False}, 2, TRIDIAGONAL, {"directional": GROUPS + 1}),
    "columns": ({"adjoint": False}, N, None, {"directional": N}),
    "nothing declared, backwards": ({"adjoint": True}, 4, None, {"adjoint": 4, "directional": 1}),
    "backwards alone": ({"adjoint": True, "forward": False}, N, TRIDIAGONAL, {"adjoint": N}),
    "wrong backwards, groups": (
        {"adjoint": True, "lies": 1e-3}, 2, TRIDIAGONAL, {"adjoint": 2, "directional": 1 + GROUPS + 1}
    ),
    "wrong declaration, columns": (
        {"adjoint": False}, N, np.eye(N), {"directional": 2 + N}
    ),
    "wrong backwards, wrong declaration": (
        {"adjoint": True, "lies": 1e-3}, 2, np.diag(np.ones(N)) + np.eye(N, k=1) + np.eye(N, k=2),
        {"adjoint": 2, "directional": 1 + GROUPS + 1 + N},
    ),
}  # fmt: skip


@pytest.mark.parametrize("way", WAYS)
def test_the_way_that_asks_least_and_is_true(way: str) -> None:
    offers, number, declared, wanted = WAYS[way]
    instance = Linear(TRIDIAGONAL, **{"forward": True, **offers})
    rows = list(range(3, 3 + number)) if number < N else list(range(N))
    full, calls = found(instance, rows, declared)
    np.testing.assert_allclose(full[rows], TRIDIAGONAL[rows], rtol=1e-12)
    assert (np.delete(full, rows, axis=0) == 0.0).all()
    assert calls == wanted

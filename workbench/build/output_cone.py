"""The assignments that the outputs need between events, where they are clearly fewer than all."""

from __future__ import annotations

from collections.abc import Sequence

from workbench.build.causalise import Assignment
from workbench.build.scalar_model import ScalarModel

__all__ = ["output_cone"]

# Of all operations: derivatives that are asked for after the outputs repeat these.
_MOST = 0.5


def output_cone(model: ScalarModel, order: Sequence[Assignment]) -> list[Assignment] | None:
    """Return the assignments that lead to the outputs in continuous time, in their order; None: not worth while.

    Relations, quotients and discrete variables stand still there; they are read and not assigned.

    Args:
        model: the scalar model.
        order: all of its assignments, in an order of evaluation.
    """
    needed = {reference for reference, variable in enumerate(model.variables) if variable.output}
    cone: list[Assignment] = []
    for step in reversed(order):
        if step.kind == "variable" and step.target in needed:
            cone.append(step)
            needed |= set() if step.expression is None else model.graph.variables(step.expression)
    cone.reverse()
    return cone if _operations(model, cone) <= _MOST * _operations(model, order) else None


def _operations(model: ScalarModel, steps: Sequence[Assignment]) -> int:
    return len(model.graph.reachable(s.expression for s in steps if s.expression is not None))

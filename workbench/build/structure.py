"""What depends on what: the dependency lists of the model description, and what the outputs need between events."""

from __future__ import annotations

from collections.abc import Sequence

from workbench.build.causalise import Assignment, reads
from workbench.build.scalar_model import ScalarModel


def dependencies(model: ScalarModel, order: Sequence[Assignment]) -> dict[tuple[str, int], frozenset[int]]:
    """Return, for every assignment, the inputs and continuous states that it depends on.

    Keys are those of :attr:`Assignment.key`. A dependency through a relation, a condition or a discrete
    variable counts: it acts in event mode. What was stored at an earlier event does not, nor what acts a delay later.
    """
    knowns = set(model.references("input", "state"))
    result: dict[tuple[str, int], frozenset[int]] = {}
    for step in order:
        total: set[int] = set()
        for key in reads(model, step, delayed=False):
            kind, reference = key
            if kind == "variable" and reference in knowns:
                total.add(reference)
            else:
                total |= result.get(key, frozenset())
        result[step.key] = frozenset(total)
    return result


def of_variable(model: ScalarModel, result: dict[tuple[str, int], frozenset[int]], reference: int) -> list[int]:
    """Return the dependencies of one variable as rising value references."""
    if model.variables[reference].kind == "state":
        return [reference]
    return sorted(result.get(("variable", reference), frozenset()))


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

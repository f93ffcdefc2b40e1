"""What depends on what: the dependency lists of the model description."""

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
    found: dict[tuple[str, int], frozenset[int]] = {}
    for step in order:
        total: set[int] = set()
        for key in reads(model, step, delayed=False):
            kind, reference = key
            if kind == "variable" and reference in knowns:
                total.add(reference)
            else:
                total |= found.get(key, frozenset())
        found[step.key] = frozenset(total)
    return found


def of_variable(model: ScalarModel, found: dict[tuple[str, int], frozenset[int]], reference: int) -> list[int]:
    """Return the dependencies of one variable as rising value references."""
    if model.variables[reference].kind == "state":
        return [reference]
    return sorted(found.get(("variable", reference), frozenset()))

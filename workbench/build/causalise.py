"""Matching and sorting: from residuals to assignments in an order of evaluation.

Each continuous equation is matched with one unknown (derivative or algebraic variable) by augmenting
paths (Kuhn), then everything is sorted. Only blocks of one equation, affine in its unknown, are in the
supported subset; a cycle is an algebraic loop and is refused by name (Cellier and Kofman, *Continuous System
Simulation*, chapter 7). Conditions, relations and discrete variables take part in the same order, so an
event iteration evaluates all of them once, each after what it needs.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter
from typing import NoReturn

from workbench.build.differentiate import partial
from workbench.build.expressions import CONDITION, QUOTIENT, RELATION, VARIABLE, ExpressionGraph
from workbench.build.ir import SourceLocation
from workbench.build.loops import alike_together
from workbench.build.scalar_model import DiscreteEquation, ResidualEquation, ScalarModel
from workbench.build.translate import refuse
from workbench.errors import BuildError


@dataclass(frozen=True, slots=True)
class Assignment:
    """One step of the evaluation: `kind` is "variable", "relation", "quotient", "condition", "discrete" or "delay".

    `target` is a value reference or a slot; `expression` is None for a discrete variable, whose
    branches stand in the model.
    """

    kind: str
    target: int
    expression: int | None
    place: SourceLocation | None = None
    discrete: DiscreteEquation | None = None

    @property
    def key(self) -> tuple[str, int]:
        return ("variable" if self.kind == "discrete" else self.kind, self.target)


def causalise(model: ScalarModel) -> list[Assignment]:
    """Return all assignments of `model` in an order of evaluation.

    Raises:
        BuildError: Too few or too many equations, an equation that is not affine in its unknown, or an algebraic
            loop; named by file and line.
    """
    unknowns = model.references("derivative", "algebraic")
    matching = _match(model, unknowns)
    steps = [
        Assignment("variable", unknown, _solve(model, residual, unknown), residual.place)
        for unknown, residual in matching
    ]
    steps += [Assignment("relation", slot, r.indicator) for slot, r in enumerate(model.relations)]
    steps += [Assignment("quotient", slot, q.argument) for slot, q in enumerate(model.quotients)]
    steps += [Assignment("condition", slot, e) for slot, e in enumerate(model.conditions)]
    steps += [Assignment("delay", number, e) for number, e in enumerate(model.delays)]
    steps += [Assignment("discrete", d.target, None, d.place, d) for d in model.discrete]
    return _sort(model, steps)


def _match(model: ScalarModel, unknowns: Sequence[int]) -> list[tuple[int, ResidualEquation]]:
    if len(unknowns) != len(model.residuals):
        raise BuildError(
            f"{model.name}: {len(model.residuals)} continuous equations for {len(unknowns)} unknowns; "
            "every variable needs exactly one equation"
        )
    wanted = set(unknowns)
    incidence = [sorted(model.graph.variables(r.expression, delayed=False) & wanted) for r in model.residuals]
    # Equations that already stand as `unknown = …` keep that reading.
    owner: dict[int, int] = {}
    for number, residual in enumerate(model.residuals):
        explicit = _explicit_unknown(model.graph, residual.expression, wanted)
        if explicit is not None and explicit not in owner:
            owner[explicit] = number
    for number in range(len(model.residuals)):
        if number not in owner.values() and not _augment(number, incidence, owner, set()):
            residual = model.residuals[number]
            raise BuildError(f"{residual.place}: `{residual.place.text[:80]}` has no unknown of its own left to solve")
    return [(unknown, model.residuals[number]) for unknown, number in sorted(owner.items())]


def _explicit_unknown(graph: ExpressionGraph, expression: int, wanted: set[int]) -> int | None:
    node = graph[expression]
    if node.operation != "subtract":
        return None
    left = graph[node.operands[0]]
    return left.reference if left.operation == VARIABLE and left.reference in wanted else None


def _augment(equation: int, incidence: list[list[int]], owner: dict[int, int], visited: set[int]) -> bool:
    for unknown in incidence[equation]:
        if unknown in visited:
            continue
        visited.add(unknown)
        if unknown not in owner or _augment(owner[unknown], incidence, owner, visited):
            owner[unknown] = equation
            return True
    return False


def _solve(model: ScalarModel, residual: ResidualEquation, unknown: int) -> int:
    """Solve 0 = a·x + b for x."""
    graph, node = model.graph, model.graph[residual.expression]
    if node.operation == "subtract":
        for side, other in (node.operands, node.operands[::-1]):
            target = graph[side]
            if target.operation == VARIABLE and target.reference == unknown and unknown not in graph.variables(other):
                return other
    name = model.variables[unknown].name
    if any(unknown in graph.variables(e) for e in graph.delays_in(residual.expression)):
        refuse(
            residual.place,
            f"a delay() of {name} in the equation for {name}",
            "delay a state: at the start, where nothing is delayed, this is an algebraic loop",
        )
    slope = partial(graph, residual.expression, unknown)
    if unknown in graph.variables(slope):
        refuse(
            residual.place,
            f"an equation that is not affine in {name}",
            f"solve it for {name} by hand",
        )
    rest = graph.substitute(residual.expression, {unknown: graph.number(0.0)})
    return graph.divide(graph.negate(rest), slope)


def _sort(model: ScalarModel, steps: Sequence[Assignment]) -> list[Assignment]:
    by_key = {step.key: number for number, step in enumerate(steps)}
    needs = [[by_key[key] for key in sorted(reads(model, step)) if key in by_key] for step in steps]
    try:
        order = list(TopologicalSorter(dict(enumerate(needs))).static_order())
    except CycleError as error:
        # The cycle comes as [a, b, …, a].
        _refuse_loop(model, [steps[number] for number in error.args[1][:-1]])
    variables = [step.expression if step.kind == "variable" else None for step in steps]
    return [steps[number] for number in alike_together(model.graph, variables, order, needs)]


def reads(model: ScalarModel, step: Assignment, *, delayed: bool = True) -> set[tuple[str, int]]:
    """Return the keys of all that `step` reads: variables, relations, quotients and conditions.

    Args:
        model: the model.
        step: what reads them.
        delayed: whether what acts a delay later counts: it is read at the start.
    """
    graph = model.graph
    if step.discrete is None:
        expressions = [] if step.expression is None else [step.expression]
        if step.kind == "relation" and model.relations[step.target].deadline is not None:
            expressions.append(model.relations[step.target].deadline or 0)
    else:
        expressions = [e for b in step.discrete.branches for e in (b.fires, b.value) if e is not None]
    keys = {("variable", vr) for e in expressions for vr in graph.variables(e, delayed=delayed)}
    for kind in (RELATION, QUOTIENT, CONDITION):
        keys |= {(kind, slot) for e in expressions for slot in graph.leaves(e, kind)}
    return keys


def _refuse_loop(model: ScalarModel, steps: Iterable[Assignment]) -> NoReturn:
    members = [s for s in steps if s.kind in {"variable", "discrete"}]
    names = ", ".join(model.variables[s.target].name for s in members)
    place = next((s.place for s in members if s.place is not None), None)
    if place is None:
        raise BuildError(f"{model.name}: an algebraic loop through {names}; break it with a state or pre()")
    refuse(place, f"an algebraic loop through {names}", "solve it by hand, or break it with a state or pre()")

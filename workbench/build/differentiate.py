"""Forward-mode differentiation of scalar expressions.

The tangent of an expression e(v) in the direction d is Σ (∂e/∂v_k)·d_k; it is built as an expression
again, with the leaves ``tangent(k)`` for d_k (Griewank and Walther, *Evaluating Derivatives*, chapter
3). Relations and integer-valued functions are frozen between events, so their derivative is zero: the
result is exact inside one branch of the model and says nothing about the jump between two.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from workbench.build.expressions import (
    COMPARISONS,
    DELAYED,
    DOT,
    DOT_TANGENT,
    GOES_THROUGH,
    MATRIX,
    MATRIX_TANGENT,
    TANGENT,
    VARIABLE,
    ExpressionGraph,
    ExpressionNode,
    Row,
)

_ZERO_DERIVATIVE = {*COMPARISONS, "not", "and", "or", "sign", "floor", "ceil", "truncate"}

# Rule(graph, expression, operands, tangents of the operands) → tangent
Rule = Callable[[ExpressionGraph, int, tuple[int, ...], list[int]], int]


def _product(graph: ExpressionGraph, a: int, b: int, da: int, db: int) -> int:
    return graph.add(graph.multiply(da, b), graph.multiply(a, db))


def _quotient(graph: ExpressionGraph, e: int, b: int, da: int, db: int) -> int:
    # d(a/b) = (da − (a/b)·db)/b, with the quotient itself reused.
    return graph.divide(graph.subtract(da, graph.multiply(e, db)), b)


def _where_nonzero(graph: ExpressionGraph, tangent: int, derivative: int) -> int:
    """Guard ∞·0: where the operand does not move, the result does not either (sqrt at 0)."""
    return graph.select(graph.apply("equal", tangent, graph.number(0.0)), graph.number(0.0), derivative)


def _power(graph: ExpressionGraph, e: int, operands: tuple[int, ...], tangents: list[int]) -> int:
    (a, b), (da, db) = operands, tangents
    one = graph.number(1.0)
    by_base = graph.multiply(graph.multiply(b, graph.power(a, graph.subtract(b, one))), da)
    tangent = by_base if graph.value(da) is not None else _where_nonzero(graph, da, by_base)
    if graph.value(db) == 0.0:
        return tangent
    by_exponent = graph.multiply(graph.multiply(e, graph.apply("log", a)), db)
    return graph.add(tangent, _where_nonzero(graph, db, by_exponent))


def _unary(derivative: Callable[[ExpressionGraph, int, int], int]) -> Rule:
    """Make a rule out of f'(graph, e, a), where e = f(a)."""

    def rule(graph: ExpressionGraph, e: int, operands: tuple[int, ...], tangents: list[int]) -> int:
        return graph.multiply(derivative(graph, e, operands[0]), tangents[0])

    return rule


def _square(graph: ExpressionGraph, a: int) -> int:
    return graph.multiply(a, a)


def _reciprocal(graph: ExpressionGraph, a: int) -> int:
    return graph.divide(graph.number(1.0), a)


def _one_plus(graph: ExpressionGraph, a: int) -> int:
    return graph.add(graph.number(1.0), a)


def _one_minus(graph: ExpressionGraph, a: int) -> int:
    return graph.subtract(graph.number(1.0), a)


def _root(graph: ExpressionGraph, a: int) -> int:
    return graph.apply("sqrt", a)


def _sqrt_rule(graph: ExpressionGraph, e: int, _operands: tuple[int, ...], tangents: list[int]) -> int:
    return _where_nonzero(graph, tangents[0], graph.divide(tangents[0], graph.multiply(graph.number(2.0), e)))


def _atan2_rule(graph: ExpressionGraph, _e: int, operands: tuple[int, ...], tangents: list[int]) -> int:
    (y, x), (dy, dx) = operands, tangents
    radius = graph.add(_square(graph, y), _square(graph, x))
    return graph.divide(graph.subtract(graph.multiply(x, dy), graph.multiply(y, dx)), radius)


def _extremum(comparison: str) -> Rule:
    def rule(graph: ExpressionGraph, _e: int, operands: tuple[int, ...], tangents: list[int]) -> int:
        return graph.select(graph.apply(comparison, *operands), tangents[0], tangents[1])

    return rule


def _delayed(graph: ExpressionGraph, _e: int, operands: tuple[int, ...], tangents: list[int]) -> int:
    number = int(graph.value(operands[2]) or 0.0)
    return graph.multiply(graph.leaf(GOES_THROUGH, number), tangents[0])


_RULES: dict[str, Rule] = {
    "add": lambda g, _e, _o, t: g.add(t[0], t[1]),
    "subtract": lambda g, _e, _o, t: g.subtract(t[0], t[1]),
    "negate": lambda g, _e, _o, t: g.negate(t[0]),
    "multiply": lambda g, _e, o, t: _product(g, o[0], o[1], t[0], t[1]),
    "divide": lambda g, e, o, t: _quotient(g, e, o[1], t[0], t[1]),
    "power": _power,
    "select": lambda g, _e, o, t: g.select(o[0], t[1], t[2]),
    "lookup": lambda g, _e, o, t: g.lookup(o[0], t[1:]),
    "min": _extremum("less_equal"),
    "max": _extremum("greater_equal"),
    "abs": _unary(lambda g, _e, a: g.apply("sign", a)),
    "sqrt": _sqrt_rule,
    "atan2": _atan2_rule,
    "sin": _unary(lambda g, _e, a: g.apply("cos", a)),
    "cos": _unary(lambda g, _e, a: g.negate(g.apply("sin", a))),
    "tan": _unary(lambda g, e, _a: _one_plus(g, _square(g, e))),
    "asin": _unary(lambda g, _e, a: _reciprocal(g, _root(g, _one_minus(g, _square(g, a))))),
    "acos": _unary(lambda g, _e, a: g.negate(_reciprocal(g, _root(g, _one_minus(g, _square(g, a)))))),
    "atan": _unary(lambda g, _e, a: _reciprocal(g, _one_plus(g, _square(g, a)))),
    "sinh": _unary(lambda g, _e, a: g.apply("cosh", a)),
    "cosh": _unary(lambda g, _e, a: g.apply("sinh", a)),
    "tanh": _unary(lambda g, e, _a: _one_minus(g, _square(g, e))),
    "exp": _unary(lambda _g, e, _a: e),
    "log": _unary(lambda g, _e, a: _reciprocal(g, a)),
    DELAYED: _delayed,
    "log10": _unary(lambda g, _e, a: _reciprocal(g, g.multiply(g.number(2.302585092994046), a))),
}


def _leaf_tangent(graph: ExpressionGraph, node: ExpressionNode, tangents: Mapping[int, int]) -> int:
    if node.operation == VARIABLE:
        return tangents.get(node.reference, graph.number(0.0))
    if node.operation == DOT:
        return _dot_tangent(graph, node.row, tangents)
    if node.operation == MATRIX:
        return _matrix_tangent(graph, node.row, tangents)
    return graph.number(0.0)


def _matrix_tangent(graph: ExpressionGraph, row: Row, tangents: Mapping[int, int]) -> int:
    start, _, x, _, length = row
    moving = range(x, x + length)
    if all(k in tangents and graph[tangents[k]] == ExpressionNode(TANGENT, reference=k) for k in moving):
        return graph.row(MATRIX_TANGENT, row)
    total = graph.number(0.0)
    for factor, k in zip(graph.table[start : start + length], moving, strict=True):
        if k in tangents:
            total = graph.add(total, graph.multiply(graph.number(factor), tangents[k]))
    return total


def _dot_tangent(graph: ExpressionGraph, row: Row, tangents: Mapping[int, int]) -> int:
    a, stride_a, x, stride_x, length = row
    total = graph.number(0.0)
    for first, step, other, other_step in ((x, stride_x, a, stride_a), (a, stride_a, x, stride_x)):
        moving = [first + i * step for i in range(length) if first + i * step in tangents]
        if not moving:
            continue
        if all(graph[tangents[k]] == ExpressionNode(TANGENT, reference=k) for k in moving):
            # A loop over the whole row: values of one factor times tangents of the other.
            total = graph.add(total, graph.row(DOT_TANGENT, (other, other_step, first, step, length)))
            continue
        for k in moving:
            factor = graph.leaf(VARIABLE, other + (k - first) // step * other_step)
            total = graph.add(total, graph.multiply(factor, tangents[k]))
    return total


def tangent(graph: ExpressionGraph, expression: int, moving: Mapping[int, int] | set[int]) -> int:
    """Return the tangent of `expression`.

    Args:
        graph: Where the expression lives; nodes are added to it.
        expression: What to differentiate.
        moving: The value references that move. A mapping gives each its tangent expression; a set stands for
            the leaves ``tangent(k)``.

    Raises:
        KeyError: An operation has no rule (a defect of this module, not of the model).
    """
    seeds = moving if isinstance(moving, Mapping) else graph.tangents_of(moving)
    tangents: dict[int, int] = {}
    for number in graph.reachable([expression]):
        node = graph[number]
        if not node.operands:
            tangents[number] = _leaf_tangent(graph, node, seeds)
        elif node.operation in _ZERO_DERIVATIVE:
            tangents[number] = graph.number(0.0)
        else:
            operand_tangents = [tangents[operand] for operand in node.operands]
            if all(graph.value(t) == 0.0 for t in operand_tangents):
                tangents[number] = graph.number(0.0)
            else:
                tangents[number] = _RULES[node.operation](graph, number, node.operands, operand_tangents)
    return tangents[expression]


def partial(graph: ExpressionGraph, expression: int, reference: int) -> int:
    """Return ∂expression/∂v[reference] as an expression."""
    return tangent(graph, expression, {reference: graph.number(1.0)})

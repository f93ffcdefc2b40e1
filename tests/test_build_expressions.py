"""Expressions and their tangents: folding must not change values, tangents must equal differences."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import pytest
from hypothesis import HealthCheck, assume, example, given, settings
from hypothesis import strategies as st

from workbench.build.differentiate import partial, tangent
from workbench.build.expressions import DOT, DOT_TANGENT, TANGENT, VARIABLE, ExpressionGraph, ExpressionNode, evaluate

N = 4  # variables

UNARY = ["negate", "sin", "cos", "atan", "tanh", "exp", "sinh", "cosh"]
BINARY = ["add", "subtract", "multiply", "divide", "min", "max", "atan2"]

Tree = tuple[object, ...]
leaves = st.one_of(
    st.tuples(st.just("variable"), st.integers(0, N - 1)),
    st.tuples(st.just("number"), st.sampled_from([0.0, 1.0, -1.0, 2.0, 0.5, -3.25])),
)
trees = st.recursive(
    leaves,
    lambda inner: st.one_of(
        st.tuples(st.sampled_from(UNARY), inner),
        st.tuples(st.sampled_from(BINARY), inner, inner),
        st.tuples(st.just("power"), inner, st.tuples(st.just("number"), st.sampled_from([1.0, 2.0, 3.0]))),
        st.tuples(st.just("select"), st.tuples(st.just("greater"), inner, inner), inner, inner),
    ),
    max_leaves=12,
)
points = st.lists(st.floats(-2.0, 2.0), min_size=N, max_size=N)


# That a machine is busy is no defect of what is tested.
PROPERTY = settings(
    max_examples=300, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow]
)  # fmt: skip


def build(graph: ExpressionGraph, tree: Tree) -> int:
    operation = str(tree[0])
    if operation == "variable":
        return graph.leaf(VARIABLE, int(tree[1]))  # type: ignore[call-overload]
    if operation == "number":
        return graph.number(float(tree[1]))  # type: ignore[arg-type]
    operands = [build(graph, part) for part in tree[1:]]  # type: ignore[arg-type]
    return graph.rebuild(operation, operands)


def angle(y: float, x: float) -> float:
    if y == 0.0:
        # On the branch cut the sign of zero decides, and x + 0 → x does not keep it; Modelica knows none.
        raise ZeroDivisionError
    return math.atan2(y, x)


def plain(tree: Tree, v: list[float]) -> float:
    """The same tree without the graph: the reference."""
    operation = str(tree[0])
    if operation == "variable":
        return v[int(tree[1])]  # type: ignore[call-overload]
    if operation == "number":
        return float(tree[1])  # type: ignore[arg-type]
    a = [plain(part, v) for part in tree[1:]]  # type: ignore[arg-type]
    table: dict[str, Callable[[], float]] = {
        "negate": lambda: -a[0],
        "add": lambda: a[0] + a[1],
        "subtract": lambda: a[0] - a[1],
        "multiply": lambda: a[0] * a[1],
        "divide": lambda: a[0] / a[1],
        "min": lambda: min(a),
        "max": lambda: max(a),
        "power": lambda: a[0] ** a[1],
        "greater": lambda: float(a[0] > a[1]),
        "select": lambda: a[1] if a[0] else a[2],
        "atan2": lambda: angle(a[0], a[1]),
    }
    return table[operation]() if operation in table else float(getattr(math, operation)(a[0]))


def value(graph: ExpressionGraph, expression: int, v: list[float], d: Mapping[int, float] | None = None) -> float:
    def leaf(node: ExpressionNode) -> float:
        if node.operation == VARIABLE:
            return v[node.reference]
        if node.operation == TANGENT:
            return (d or {})[node.reference]
        a, stride_a, x, stride_x, length = node.row
        other = v if node.operation == DOT else [(d or {}).get(k, 0.0) for k in range(len(v))]
        return sum(v[a + i * stride_a] * other[x + i * stride_x] for i in range(length))

    return evaluate(graph, expression, leaf)


@PROPERTY
@example(("atan2", ("variable", 1), ("add", ("variable", 0), ("number", 0.0))), [-0.0, 1.0, 0.0, 0.0])
@given(trees, points)
def test_folding_keeps_the_value(tree: Tree, v: list[float]) -> None:
    try:
        expected = plain(tree, v)
    except (ZeroDivisionError, OverflowError):
        expected = math.nan
    assume(math.isfinite(expected) and abs(expected) < 1e12)
    graph = ExpressionGraph()
    assert value(graph, build(graph, tree), v) == pytest.approx(expected, rel=1e-12, abs=1e-12)


@PROPERTY
@given(trees, points, points)
def test_tangent_equals_a_central_difference(tree: Tree, v: list[float], direction: list[float]) -> None:
    graph = ExpressionGraph()
    expression = build(graph, tree)
    exact = value(graph, tangent(graph, expression, set(range(N))), v, dict(enumerate(direction)))
    middle = value(graph, expression, v)
    slopes, kinks = [], []
    for h in (1e-5, 2e-5):
        up = value(graph, expression, [x + h * d for x, d in zip(v, direction, strict=True)])
        down = value(graph, expression, [x - h * d for x, d in zip(v, direction, strict=True)])
        slopes.append((up - down) / (2 * h))
        kinks.append(abs(up - 2 * middle + down) / h)
    scale = max(1.0, abs(middle))
    # Only where the difference itself has converged: not across a kink, not beside a pole.
    assume(all(math.isfinite(s) for s in slopes) and math.isfinite(exact))
    assume(abs(slopes[0] - slopes[1]) < 1e-7 * max(scale, abs(slopes[0])))
    assume(scale < 1e6 and max(kinks) < 1e-2 * scale)
    assert exact == pytest.approx(slopes[0], rel=1e-5, abs=1e-5 * scale)


def test_square_root_at_zero_has_no_slope_where_nothing_moves() -> None:
    graph = ExpressionGraph()
    root = graph.apply("sqrt", graph.leaf(VARIABLE, 0))
    rate = tangent(graph, root, {0})
    assert value(graph, rate, [0.0], {0: 0.0}) == 0.0
    assert value(graph, rate, [4.0], {0: 1.0}) == pytest.approx(0.25)


def test_a_row_product_is_differentiated_by_both_factors() -> None:
    graph = ExpressionGraph()
    row = graph.dot((0, 1), (2, 1), 2)  # v0·v2 + v1·v3
    v = [2.0, 3.0, 5.0, 7.0]
    assert value(graph, row, v) == pytest.approx(31.0)
    moved = tangent(graph, row, {0, 1, 2, 3})
    assert any(graph[n].operation == DOT_TANGENT for n in graph.reachable([moved]))
    assert value(graph, moved, v, {0: 1.0, 1: 10.0, 2: 100.0, 3: 1000.0}) == pytest.approx(5 + 70 + 200 + 3000)
    assert value(graph, partial(graph, row, 3), v) == pytest.approx(3.0)


def test_equal_expressions_are_one_node() -> None:
    graph = ExpressionGraph()
    x, y = graph.leaf(VARIABLE, 0), graph.leaf(VARIABLE, 1)
    assert graph.add(x, y) == graph.add(x, y)
    assert graph.number(0.0) != graph.number(-0.0)
    assert graph.subtract(x, x) == graph.number(0.0)
    assert graph.substitute(graph.multiply(x, y), {0: graph.number(0.0)}) == graph.number(0.0)

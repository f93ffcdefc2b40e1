"""Scalar expressions of a model as a shared graph.

Every expression is an integer, the number of its node in an :class:`ExpressionGraph`. Equal expressions
get equal numbers (hash-consing), so a common part is stored, differentiated and emitted once. The
constructors fold constants and remove neutral elements, which keeps forward-mode derivatives short
(Griewank and Walther, *Evaluating Derivatives*, chapter 3).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

# Leaves carry a number, a reference or a row; all other nodes carry operands.
NUMBER = "number"
VARIABLE = "variable"  # refers to: value reference
PRE = "pre"  # refers to: value reference; the value before this event iteration
TANGENT = "tangent"  # refers to: value reference; its directional derivative
RELATION = "relation"  # refers to: slot of a frozen relation, 0 or 1
QUOTIENT = "quotient"  # refers to: slot of a frozen integer value (floor, ceil, ...)
CONDITION = "condition"  # refers to: number of a when-condition, its value in this event iteration
CONDITION_PRE = "condition_pre"  # ... and in the one before
TICK = "tick"  # refers to: number of a clock that ticks in this event iteration
INITIAL = "initial"  # true while the model is initialised
DOT_TANGENT = "dot_tangent"  # as DOT, with the tangents of x
DOT = "dot"  # a row: (first value reference of a, stride of a, first of x, stride of x, length)
MATRIX = "matrix"  # a row of numbers times variables: as DOT, but a counts in the graph's table
MATRIX_PRE = "matrix_pre"  # ... times their values before this event iteration
MATRIX_TANGENT = "matrix_tangent"  # ... times their tangents
GOES_THROUGH = "goes_through"  # refers to: number of a delay; 1 while its input goes straight through

DELAYED = "delayed"  # operands: what is delayed, by how long [s], number of the delay

# (first value reference of a, stride of a, first value reference of x, stride of x, length)
Row = tuple[int, int, int, int, int]

COMPARISONS: dict[str, Callable[[float, float], bool]] = {
    "greater": lambda a, b: a > b,
    "greater_equal": lambda a, b: a >= b,
    "less": lambda a, b: a < b,
    "less_equal": lambda a, b: a <= b,
    "equal": lambda a, b: a == b,
    "not_equal": lambda a, b: a != b,
}


@dataclass(frozen=True, slots=True)
class ExpressionNode:
    """One node: its operation, the numbers of its operands and, for a leaf, what it stands for."""

    operation: str
    operands: tuple[int, ...] = ()
    number: float = 0.0
    reference: int = -1
    row: Row = (0, 0, 0, 0, 0)


class ExpressionGraph:
    """All expressions of one model.

    Obligations: nodes are only added, never changed; an operand's number is smaller than the number of
    the node that uses it, so rising order is an order of evaluation.
    """

    def __init__(self) -> None:
        self._nodes: list[ExpressionNode] = []
        self._numbers: dict[tuple[object, ...], int] = {}
        self.table: list[float] = []  # numbers of all matrix rows
        self._moving: set[int] = set()
        self._tangents: Mapping[int, int] = {}

    def __getitem__(self, expression: int) -> ExpressionNode:
        return self._nodes[expression]

    def __len__(self) -> int:
        return len(self._nodes)

    def _intern(self, node: ExpressionNode) -> int:
        # repr tells 0.0 from -0.0, which compare equal.
        key = (node.operation, node.operands, repr(node.number), node.reference, node.row)
        number = self._numbers.get(key)
        if number is None:
            number = len(self._nodes)
            self._nodes.append(node)
            self._numbers[key] = number
        return number

    # Leaves

    def number(self, value: float) -> int:
        """Return the constant `value`."""
        return self._intern(ExpressionNode(NUMBER, number=float(value)))

    def leaf(self, operation: str, reference: int) -> int:
        """Return a leaf such as ``leaf(VARIABLE, 3)``."""
        return self._intern(ExpressionNode(operation, reference=reference))

    def row(self, operation: str, row: Row) -> int:
        """Return a leaf that is a product of two rows of variables."""
        return self._intern(ExpressionNode(operation, row=row))

    def value(self, expression: int) -> float | None:
        """Return the number that `expression` is, or None when it is not a constant."""
        node = self._nodes[expression]
        return node.number if node.operation == NUMBER else None

    # Arithmetic

    def add(self, a: int, b: int) -> int:
        """Return a + b."""
        x, y = self.value(a), self.value(b)
        if x is not None and y is not None:
            return self.number(x + y)
        if x == 0.0:
            return b
        if y == 0.0:
            return a
        if self._nodes[b].operation == "negate":
            return self.subtract(a, self._nodes[b].operands[0])
        return self._intern(ExpressionNode("add", (a, b)))

    def subtract(self, a: int, b: int) -> int:
        """Return a - b."""
        x, y = self.value(a), self.value(b)
        if x is not None and y is not None:
            return self.number(x - y)
        if a == b:
            return self.number(0.0)
        if y == 0.0:
            return a
        if x == 0.0:
            return self.negate(b)
        if self._nodes[b].operation == "negate":
            return self.add(a, self._nodes[b].operands[0])
        return self._intern(ExpressionNode("subtract", (a, b)))

    def negate(self, a: int) -> int:
        """Return -a."""
        x = self.value(a)
        if x is not None:
            return self.number(-x)
        node = self._nodes[a]
        if node.operation == "negate":
            return node.operands[0]
        if node.operation == "subtract":
            return self._intern(ExpressionNode("subtract", (node.operands[1], node.operands[0])))
        return self._intern(ExpressionNode("negate", (a,)))

    def multiply(self, a: int, b: int) -> int:
        """Return a·b."""
        x, y = self.value(a), self.value(b)
        if x is not None and y is not None:
            return self.number(x * y)
        if x == 0.0 or y == 0.0:
            return self.number(0.0)
        for factor, other in ((x, b), (y, a)):
            if factor == 1.0:
                return other
            if factor == -1.0:
                return self.negate(other)
        return self._intern(ExpressionNode("multiply", (a, b)))

    def divide(self, a: int, b: int) -> int:
        """Return a/b."""
        x, y = self.value(a), self.value(b)
        if y == 1.0:
            return a
        if y == -1.0:
            return self.negate(a)
        if x is not None and y is not None and y != 0.0:
            return self.number(x / y)
        if x == 0.0 and y != 0.0:
            return self.number(0.0)
        return self._intern(ExpressionNode("divide", (a, b)))

    def power(self, a: int, b: int) -> int:
        """Return a to the power of b."""
        y = self.value(b)
        if y == 1.0:
            return a
        if y == 2.0:
            return self.multiply(a, a)
        return self.apply("power", a, b)

    # Everything else

    def select(self, condition: int, if_true: int, if_false: int) -> int:
        """Return `if_true` where the Boolean `condition` holds, else `if_false`."""
        fixed = self.value(condition)
        if fixed is not None:
            return if_true if fixed != 0.0 else if_false
        if if_true == if_false:
            return if_true
        return self._intern(ExpressionNode("select", (condition, if_true, if_false)))

    def lookup(self, index: int, elements: Sequence[int]) -> int:
        """Return the element number `index` (from 1) of `elements`; outside it is not a number."""
        fixed = self.value(index)
        if fixed is not None and 1 <= fixed <= len(elements):
            return elements[int(fixed) - 1]
        if len(set(elements)) == 1 and self.value(elements[0]) == 0.0:
            return elements[0]
        return self._intern(ExpressionNode("lookup", (index, *elements)))

    def dot(self, a: tuple[int, int], x: tuple[int, int], length: int) -> int:
        """Return Σ v[a + i·stride]·v[x + i·stride]; `a` and `x` are (first value reference, stride)."""
        return self.row(DOT, (*a, *x, length))

    def matrix_row(self, operation: str, numbers: Sequence[float], first: int) -> int:
        """Return Σ numbers[i]·v[first + i]; `operation` is MATRIX or, for values of pre(), MATRIX_PRE.

        A loop over a table, where a sum of products would be long: dense rows of large linear models.
        """
        start = len(self.table)
        self.table.extend(numbers)
        return self.row(operation, (start, 1, first, 1, len(numbers)))

    def apply(self, operation: str, *operands: int) -> int:
        """Return any other operation of :data:`FUNCTIONS` or :data:`COMPARISONS`, folding constants."""
        arithmetic = {
            "add": self.add,
            "subtract": self.subtract,
            "multiply": self.multiply,
            "divide": self.divide,
        }.get(operation)
        if arithmetic is not None:
            return arithmetic(operands[0], operands[1])
        values = [self.value(operand) for operand in operands]
        if all(v is not None for v in values):
            folded = evaluate_operation(operation, [v for v in values if v is not None])
            if math.isfinite(folded):
                return self.number(folded)
        return self._intern(ExpressionNode(operation, operands))

    def boolean(self, operation: str, *operands: int) -> int:
        """Return "and", "or" or "not" of conditions, without operands that decide nothing."""
        if operation == "not":
            return self.apply("not", operands[0])
        a, b = operands
        neutral = 1.0 if operation == "and" else 0.0
        for x, other in ((self.value(a), b), (self.value(b), a)):
            if x is not None:
                return other if (x != 0.0) == (neutral != 0.0) else self.number(1.0 - neutral)
        return self.apply(operation, a, b)

    def substitute(self, expression: int, replacement: dict[int, int]) -> int:
        """Return `expression` with the variables of `replacement` replaced."""
        new: dict[int, int] = {}
        for number in self.reachable([expression]):
            node = self._nodes[number]
            if node.operation == VARIABLE and node.reference in replacement:
                new[number] = replacement[node.reference]
            elif node.operation == DOT:
                new[number] = self._substitute_dot(number, node.row, replacement)
            elif node.operation == MATRIX:
                new[number] = self._substitute_matrix(number, node.row, replacement)
            elif not node.operands or all(new[o] == o for o in node.operands):
                new[number] = number
            else:
                new[number] = self.rebuild(node.operation, [new[o] for o in node.operands])
        return new[expression]

    def _substitute_dot(self, number: int, row: Row, replacement: dict[int, int]) -> int:
        a, stride_a, x, stride_x, length = row
        pairs = [(a + i * stride_a, x + i * stride_x) for i in range(length)]
        if not any(k in replacement for pair in pairs for k in pair):
            return number
        total = self.number(0.0)
        for pair in pairs:
            left, right = (replacement.get(k, self.leaf(VARIABLE, k)) for k in pair)
            total = self.add(total, self.multiply(left, right))
        return total

    def _substitute_matrix(self, number: int, row: Row, replacement: dict[int, int]) -> int:
        if not any(k in replacement for k in self._factors(row)):
            return number
        total = self.number(0.0)
        for k in self._factors(row):
            factor = self.number(self.table[row[0] + k - row[2]])
            total = self.add(total, self.multiply(factor, replacement.get(k, self.leaf(VARIABLE, k))))
        return total

    def rebuild(self, operation: str, operands: Sequence[int]) -> int:
        """Return the node again with other operands, simplified as by its constructor."""
        special: dict[str, Callable[..., int]] = {
            "negate": self.negate,
            "power": self.power,
            "select": self.select,
            "lookup": lambda index, *elements: self.lookup(index, elements),
        }
        build = special.get(operation)
        return build(*operands) if build is not None else self.apply(operation, *operands)

    def tangents_of(self, moving: set[int]) -> Mapping[int, int]:
        """Return the leaves ``tangent(k)`` of value references; those of the last set are kept.

        Args:
            moving: the references; it must not change.
        """
        if self._moving is not moving:
            self._moving, self._tangents = moving, {k: self.leaf(TANGENT, k) for k in moving}
        return self._tangents

    # Walks

    def delays_in(self, expression: int) -> list[int]:
        """Return the delays that `expression` reads."""
        return [number for number in self.reachable([expression]) if self._nodes[number].operation == DELAYED]

    def reachable(self, expressions: Iterable[int], known: Container[int] = (), *, delayed: bool = True) -> list[int]:
        """Return all nodes that `expressions` are made of, in an order of evaluation.

        Args:
            expressions: where the walk begins.
            known: where it ends; these nodes are not among those returned.
            delayed: whether to go on to what acts a delay later.
        """
        seen: set[int] = set()
        stack = list(expressions)
        while stack:
            expression = stack.pop()
            if expression not in seen and expression not in known:
                seen.add(expression)
                node = self._nodes[expression]
                stack.extend(node.operands if delayed or node.operation != DELAYED else ())
        return sorted(seen)

    def leaves(self, expression: int, operation: str) -> Iterator[int]:
        """Yield the references of the leaves of kind `operation` below `expression`."""
        for number in self.reachable([expression]):
            node = self._nodes[number]
            if node.operation == operation:
                yield node.reference
            elif node.operation == MATRIX_PRE and operation == PRE:
                yield from self._factors(node.row)

    def variables(self, expression: int, *, delayed: bool = True) -> set[int]:
        """Return the value references that `expression` reads now (not those it reads as pre).

        Args:
            expression: what reads them.
            delayed: whether those that act a delay later count: they are read at the start.
        """
        result: set[int] = set()
        for number in self.reachable([expression], delayed=delayed):
            node = self._nodes[number]
            if node.operation == VARIABLE:
                result.add(node.reference)
            elif node.operation == DOT:
                a, stride_a, x, stride_x, length = node.row
                result.update(a + i * stride_a for i in range(length))
                result.update(x + i * stride_x for i in range(length))
            elif node.operation == MATRIX:
                result.update(self._factors(node.row))
        return result

    def _factors(self, row: Row) -> list[int]:
        """Return the value references that a matrix row depends on: zeros in the table are not dependencies."""
        a, _, x, _, length = row
        return [x + i for i in range(length) if self.table[a + i] != 0.0]


def _power(a: float, b: float) -> float:
    try:
        return math.pow(a, b)
    except (ValueError, OverflowError, ZeroDivisionError):
        return math.nan


def _guarded(function: Callable[[float], float]) -> Callable[[float], float]:
    def call(x: float) -> float:
        try:
            return float(function(x))
        except (ValueError, OverflowError):
            return math.nan

    return call


FUNCTIONS: dict[str, Callable[..., float]] = {
    "add": lambda a, b: a + b,
    "subtract": lambda a, b: a - b,
    "multiply": lambda a, b: a * b,
    "divide": lambda a, b: a / b if b != 0.0 else math.nan,
    "negate": lambda a: -a,
    "power": _power,
    "not": lambda a: float(a == 0.0),
    "and": lambda a, b: float(a != 0.0 and b != 0.0),
    "or": lambda a, b: float(a != 0.0 or b != 0.0),
    "min": min,
    "max": max,
    "abs": abs,
    "sign": lambda a: float((a > 0.0) - (a < 0.0)),
    "atan2": math.atan2,
    "floor": _guarded(math.floor),
    "ceil": _guarded(math.ceil),
    "truncate": _guarded(math.trunc),
    **{
        name: _guarded(getattr(math, name))
        for name in (
            "sqrt", "sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "exp", "log", "log10",
        )
    },
}  # fmt: skip


def evaluate_operation(operation: str, operands: Sequence[float]) -> float:
    """Return the value of one operation on numbers; raise KeyError for an unknown one."""
    comparison = COMPARISONS.get(operation)
    if comparison is not None:
        return float(comparison(operands[0], operands[1]))
    if operation == "select":
        return operands[1] if operands[0] != 0.0 else operands[2]
    if operation == DELAYED:
        return operands[0]  # so it is at the start
    if operation == "lookup":
        index = int(operands[0])
        return operands[index] if 1 <= index < len(operands) else math.nan
    return float(FUNCTIONS[operation](*operands))


def evaluate(graph: ExpressionGraph, expression: int, leaf: Callable[[ExpressionNode], float]) -> float:
    """Return the value of `expression`; `leaf` gives the values of the leaves that are not numbers."""
    values: dict[int, float] = {}
    for number in graph.reachable([expression]):
        node = graph[number]
        if node.operation == NUMBER:
            values[number] = node.number
        elif not node.operands:
            values[number] = leaf(node)
        else:
            values[number] = evaluate_operation(node.operation, [values[operand] for operand in node.operands])
    return values[expression]

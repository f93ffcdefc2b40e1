"""Write expressions as C: statements of one function, with a name for each common part, and loops."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from workbench.build.emit_tables import c_number
from workbench.build.expressions import (
    COMPARISONS,
    CONDITION,
    CONDITION_PRE,
    DELAYED,
    DOT,
    DOT_TANGENT,
    GOES_THROUGH,
    INITIAL,
    MATRIX,
    MATRIX_PRE,
    MATRIX_TANGENT,
    NUMBER,
    PRE,
    QUOTIENT,
    RELATION,
    TANGENT,
    TICK,
    VARIABLE,
    ExpressionGraph,
    ExpressionNode,
)
from workbench.build.loops import Shapes

__all__ = ["Writer", "bare", "uses_of"]

_INFIX = {
    "add": "+", "subtract": "-", "multiply": "*", "divide": "/",
    "greater": ">", "greater_equal": ">=", "less": "<", "less_equal": "<=", "equal": "==", "not_equal": "!=",
}  # fmt: skip
_CALLS = {
    "power": "pow", "min": "smaller", "max": "larger", "abs": "fabs", "sign": "sign_of", "truncate": "trunc",
}  # fmt: skip
# Operation → text, out of the operands' texts and the same as conditions.
_SPECIAL: dict[str, Callable[[list[str], list[str]], str]] = {
    "negate": lambda t, _c: f"(-{t[0]})",
    "and": lambda _t, c: f"({c[0]} && {c[1]})",
    "or": lambda _t, c: f"({c[0]} || {c[1]})",
    "not": lambda _t, c: f"(!{c[0]})",
    "select": lambda t, c: f"({c[0]} ? {t[1]} : {t[2]})",
    DELAYED: lambda t, _c: f"delayed(f, {', '.join(map(bare, t))})",
    "lookup": lambda t, _c: f"pick({t[0]}, {len(t) - 1}, (const double[]){{{', '.join(t[1:])}}})",
}
_BOOLEAN = {*COMPARISONS, "and", "or", "not"}
_LINE = 110  # an expression longer than this gets a name of its own


@dataclass(slots=True)
class Writer:
    """Emits statements of one C function; common parts are computed once.

    Attributes:
        graph: where the expressions live.
        n_relations: of the model; integer quotients stand behind them.
        uses: how often each node is used in this function.
        shapes: which expressions are alike.
        lines: what is written so far.
        texts: C text of each node that is written.
        prefix: of the names of common parts.
    """

    graph: ExpressionGraph
    n_relations: int
    uses: Mapping[int, int]
    shapes: Shapes
    lines: list[str] = field(default_factory=list)
    texts: dict[int, str] = field(default_factory=dict)
    prefix: str = "t"

    def text(self, expression: int) -> str:
        """Return C text for `expression`, after emitting the parts that deserve a name."""
        for number in self.graph.reachable([expression], self.texts):
            node = self.graph[number]
            written = self._write(number)
            wanted = self.uses.get(number, 0) > 1 or len(written) > _LINE
            # A delay notes its input when it is read: it must not be left out, as by a branch that is not taken.
            if node.operands and (wanted or node.operation == DELAYED):
                name = f"{self.prefix}{number}"
                self.lines.append(f"const double {name} = {bare(written)};")
                written = name
            self.texts[number] = written
        return self.texts[expression]

    def loop(self, left: str, targets: Sequence[int], expressions: Sequence[int], comment: str = "") -> None:
        """Emit assignments that are alike as one loop, in the order in which they stand.

        Args:
            left: what is assigned, with {} for the target, such as "f->v[{}]".
            targets: of the assignments.
            expressions: what they are assigned; of one shape.
            comment: what stands behind it.
        """
        columns, root = _LoopColumns(len(targets)), expressions[0]
        inner = Writer(self.graph, self.n_relations, uses_of(self.graph, [root]), self.shapes, prefix="s")
        inner.texts = self._given(expressions, columns)
        assigned = f"{left.format(columns.whole(targets))} = {bare(inner.text(root))};{comment}"
        self.lines += [
            "{",
            *(f"    {line}" for line in columns.tables),
            f"    for (int i = 0; i < {len(targets)}; i++) {{",
            *(f"        {line}" for line in (*inner.lines, assigned)),
            "    }",
            "}",
        ]

    def _given(self, expressions: Sequence[int], columns: _LoopColumns) -> dict[int, str]:
        """Return the texts of what a pass of a loop does not compute, by the nodes of the first expression."""
        places = list(zip(*(self.shapes.nodes(e) for e in expressions), strict=True))
        moving = {place[0] for place in places if len(set(place)) > 1}
        texts: dict[int, str] = {}
        for place in places:
            operands = self.graph[place[0]].operands
            if place[0] in moving and not operands:
                texts[place[0]] = self._moving_leaf([self.graph[number] for number in place], columns)
            elif place[0] in moving:
                texts |= {o: self.text(o) for o in operands if o not in moving}
        return texts if expressions[0] in moving else {expressions[0]: self.text(expressions[0])}

    def _moving_leaf(self, nodes: Sequence[ExpressionNode], columns: _LoopColumns) -> str:
        operation = nodes[0].operation
        if operation == NUMBER:
            return columns.number([node.number for node in nodes])
        reference = columns.whole([self._place(node) for node in nodes])
        parts = zip(*(node.row for node in nodes), strict=True)
        return _leaf_text(operation, reference, [columns.whole(part) for part in parts])

    def _write(self, number: int) -> str:
        node = self.graph[number]
        if node.operation == NUMBER:
            return c_number(node.number)
        if not node.operands:
            return _leaf_text(node.operation, str(self._place(node)), [str(part) for part in node.row])
        texts = [self.texts[o] for o in node.operands]
        operation = node.operation
        if operation in _INFIX:
            return f"({texts[0]} {_INFIX[operation]} {texts[1]})"
        if operation in _SPECIAL:
            conditions = [self._condition(o) for o in node.operands]
            return _SPECIAL[operation](texts, conditions)
        return f"{_CALLS.get(operation, operation)}({', '.join(bare(t) for t in texts)})"

    def _condition(self, number: int) -> str:
        text = self.texts[number]
        is_boolean = self.graph[number].operation in _BOOLEAN and text.startswith("(")
        return text if is_boolean else f"({text} != 0.0)"

    def _place(self, node: ExpressionNode) -> int:
        """Return what a leaf refers to, as a place in its array."""
        return node.reference + (self.n_relations if node.operation == QUOTIENT else 0)


def uses_of(graph: ExpressionGraph, expressions: Iterable[int]) -> dict[int, int]:
    """Return how often each node below `expressions` is used, by them or by other nodes."""
    roots = list(expressions)
    uses: dict[int, int] = {}
    for number in graph.reachable(roots):
        for operand in graph[number].operands:
            uses[operand] = uses.get(operand, 0) + 1
    for root in roots:
        uses[root] = uses.get(root, 0) + 1
    return uses


class _LoopColumns:
    """What changes from pass to pass of a loop, as text in `i`: a straight line, or an entry of a table."""

    def __init__(self, count: int) -> None:
        self.count = count
        self.tables: list[str] = []
        self._known: dict[tuple[str, ...], str] = {}

    def whole(self, values: Sequence[int]) -> str:
        first, step = values[0], values[1] - values[0]
        if step == 0 and values.count(first) == len(values):
            return str(first)
        if all(value == first + i * step for i, value in enumerate(values)):
            return f"{first} + i" if step == 1 else f"{first} + {step} * i" if step > 0 else f"{first} - {-step} * i"
        return self._table("int", tuple(map(str, values)))

    def number(self, values: Sequence[float]) -> str:
        return self._table("double", tuple(map(c_number, values)))

    def _table(self, kind: str, values: tuple[str, ...]) -> str:
        name = self._known.get(values)
        if name is None:
            name = self._known[values] = f"k{len(self._known)}"
            rows = (f"    {', '.join(values[at : at + 8])}," for at in range(0, len(values), 8))
            self.tables += [f"static const {kind} {name}[] = {{", *rows, "};"]
        return f"{name}[i]"


def _leaf_text(operation: str, reference: str, row: Sequence[str]) -> str:
    if operation in {DOT, DOT_TANGENT}:
        a, stride_a, x, stride_x, length = row
        other = "d" if operation == DOT_TANGENT else "f->v"
        return f"dot(f->v + {a}, {stride_a}, {other} + {x}, {stride_x}, {length})"
    if operation in _MATRIX_ROWS:
        start, _, x, _, length = row
        return f"dot(matrix_rows + {start}, 1, {_MATRIX_ROWS[operation]} + {x}, 1, {length})"
    return _LEAVES[operation].format(reference)


_MATRIX_ROWS = {MATRIX: "f->v", MATRIX_PRE: "f->pre", MATRIX_TANGENT: "d"}
_LEAVES = {
    VARIABLE: "f->v[{}]",
    PRE: "f->pre[{}]",
    TANGENT: "d[{}]",
    RELATION: "f->frozen[{}]",
    CONDITION: "f->condition[{}]",
    CONDITION_PRE: "f->condition_pre[{}]",
    TICK: "f->tick[{}]",
    QUOTIENT: "f->frozen[{}]",
    INITIAL: "(double)f->initial",
    GOES_THROUGH: "goes_through(f, {})",
}


def bare(text: str) -> str:
    """Drop one pair of brackets that encloses the whole text."""
    if not (text.startswith("(") and text.endswith(")")):
        return text
    depth = 0
    for position, character in enumerate(text):
        depth += (character == "(") - (character == ")")
        if depth == 0 and position < len(text) - 1:
            return text
    return text[1:-1]

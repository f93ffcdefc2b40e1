"""Translate the front end's expressions into scalar expressions.

Arrays become lists of scalars, loops are unrolled over their domains (known at build time) and functions
are executed symbolically, statement by statement, so that one mechanism differentiates and emits all.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise, product
from typing import NoReturn

from workbench.build.differentiate import partial
from workbench.build.expressions import COMPARISONS, DELAYED, NUMBER, PRE, QUOTIENT, RELATION, VARIABLE, ExpressionGraph
from workbench.build.ir import Dae, Json, SourceLocation
from workbench.build.scalar_model import TIME, Quotient, Relation
from workbench.errors import BuildError

ADVICE = {
    "string": "String variables do not exist in the supported subset: use an Integer or an enumeration",
    "spatial_distribution": "write the discretised equations",
    "external": "external functions cannot be shipped in a portable FMU: write the function in Modelica",
    "previous": "clocked partitions are outside the subset: use `when sample(start, period)` and pre()",
    "hold": "clocked partitions are outside the subset: use `when sample(start, period)` and pre()",
    "model_event_transaction": "write it in the equation section, with `=` in place of `:=`",
    "initial_equation": "give the start value instead: Real x(start = …, fixed = true)",
}


def refuse(place: SourceLocation, construct: str, advice: str) -> NoReturn:
    """Raise BuildError: file, line, construct, what to write instead."""
    excerpt = f" in `{place.text[:80]}`" if place.text else ""
    raise BuildError(f"{place}: {construct} is not supported{excerpt}; {advice}")


@dataclass(frozen=True, slots=True)
class Array:
    """Scalar expressions in row-major order; shape () is a scalar."""

    shape: tuple[int, ...]
    elements: tuple[int, ...]

    @property
    def scalar(self) -> int:
        return self.elements[0]


@dataclass(slots=True)
class Scope:
    """What an expression is translated in: loop variables, function values, and whether relations freeze."""

    events: bool
    binders: dict[tuple[int, int], int] = field(default_factory=dict)
    parameters: list[Array] = field(default_factory=list)
    values: dict[int, Array] = field(default_factory=dict)


class Translator:
    """Turns node numbers of a :class:`Dae` into :class:`Array` of graph expressions.

    Obligations: `layout[i]` gives the first value reference of IR variable i, `derivatives[i]` that of
    its derivative; `constants[i]` the elements of a variable that is folded; `continuous` the value
    references that change between events. Relations and quotients found are appended to the lists.
    """

    def __init__(
        self,
        dae: Dae,
        graph: ExpressionGraph,
        *,
        layout: Mapping[int, int],
        derivatives: Mapping[int, int],
        constants: Mapping[int, Array],
        continuous: set[int],
    ) -> None:
        self.dae, self.graph = dae, graph
        self.layout, self.derivatives, self.constants, self.continuous = layout, derivatives, constants, continuous
        self._leaves: dict[tuple[str, int], Array] = {}
        self.relations: list[Relation] = []
        self.quotients: list[Quotient] = []
        self.delays: list[int] = []
        self.delay_times: set[int] = set()
        self._slots: dict[tuple[object, ...], int] = {}
        self._handlers: dict[str, Callable[[int, Json, Scope], Array]] = {
            "literal": self._literal,
            "coordinate": self._coordinate,
            "unary": self._unary,
            "binary": self._binary,
            "builtin": self._builtin,
            "conditional": self._conditional,
            "index": self._index,
            "array": self._array,
            "comprehension": self._comprehension,
            "call": self._call,
            "function_value": self._function_value,
            "runtime_quotient_owner": self._quotient_owner,
        }

    def array(self, number: int, scope: Scope) -> Array:
        """Translate expression `number`; raises BuildError for what is outside the subset."""
        node = self.dae.node(number)
        kind, body = (node, None) if isinstance(node, str) else next(iter(node.items()))
        handler = self._handlers.get(kind)
        if handler is None:
            refuse(self.dae.place_of(number), kind.replace("_", " "), ADVICE.get(kind, "rewrite it in the subset"))
        return handler(number, body, scope)

    def scalar(self, number: int, scope: Scope) -> int:
        """Translate an expression that must be a scalar."""
        array = self.array(number, scope)
        if array.shape not in {(), (1,)}:
            refuse(self.dae.place_of(number), "an array where a scalar is needed", "index the array")
        return array.scalar

    # Leaves

    def _literal(self, number: int, body: Json, _scope: Scope) -> Array:
        kind, value = next(iter(body.items()))
        if kind == "string":
            refuse(self.dae.place_of(number), "a String value", ADVICE["string"])
        return Array((), (self.graph.number(float(value)),))

    def _coordinate(self, number: int, body: Json, scope: Scope) -> Array:
        if body == "time":
            return Array((), (self.graph.leaf(VARIABLE, TIME),))
        kind, index = next(iter(body.items()))
        if kind == "binder":
            return Array((), (self.graph.number(scope.binders[index["domain"], index["ordinal"]]),))
        if kind == "function_parameter":
            return scope.parameters[int(index["ordinal"])]
        if kind == "delay":
            return self._delayed(index, scope)
        if kind not in _COORDINATES:
            refuse(self.dae.place_of(number), kind.replace("_", " "), ADVICE.get(kind, "rewrite it in the subset"))
        if index in self.constants:
            return self.constants[index]
        shape = self.dae.variables[index].type.dimensions
        first = self.derivatives[index] if kind == "derivative" else self.layout[index]
        # pre(state) is the state itself: a reinit acts at the end of the iteration.
        leaf = PRE if kind in {"pre_discrete_real", "pre_discrete_value"} else VARIABLE
        known = leaf, first
        if known not in self._leaves:  # an index takes one of them at a time
            elements = tuple(self.graph.leaf(leaf, first + k) for k in range(math.prod(shape)))
            self._leaves[known] = Array(shape, elements)
        return self._leaves[known]

    def _delayed(self, number: int, scope: Scope) -> Array:
        """Return delay(e, T), each element of e with a past of its own."""
        entry = self.dae.storage["delays"][number]
        place = self.dae.place(entry["provenance"])
        time = next(iter(entry["kind"].values()))["delay_time"]
        lag = self.scalar(time if isinstance(time, int) else time["expression"], scope)
        parameters = {
            self.layout[i] + k
            for i, v in enumerate(self.dae.variables)
            if v.role == "parameter" and i in self.layout
            for k in range(math.prod(v.type.dimensions))
        }
        if not self.graph.variables(lag) <= parameters:
            refuse(
                place,
                "a delay() whose time varies",
                "make the time a constant or a parameter, or use the block `variable_delay` of a system file",
            )
        self.delay_times.add(lag)
        return self._map(place, [self.array(entry["source"], scope)], lambda e: self._one_delay(e, lag))

    def _one_delay(self, expression: int, lag: int) -> int:
        if self.graph.value(expression) is not None:
            return expression
        slot = self._slots.setdefault((DELAYED, expression, lag), len(self.delays))
        if slot == len(self.delays):
            self.delays.append(self.graph.apply(DELAYED, expression, lag, self.graph.number(slot)))
        return self.delays[slot]

    # Operators

    def _map(self, place: SourceLocation, arrays: Sequence[Array], function: Callable[..., int]) -> Array:
        """Apply `function` element by element; scalars are repeated."""
        shapes = {a.shape for a in arrays if a.shape != ()}
        if len(shapes) > 1:
            refuse(place, f"an operation on arrays of shapes {sorted(shapes)}", "use equal shapes")
        if not shapes:
            return Array((), (function(*(a.scalar for a in arrays)),))
        shape = shapes.pop()
        columns = [a.elements if a.shape != () else a.elements * math.prod(shape) for a in arrays]
        return Array(shape, tuple(function(*row) for row in zip(*columns, strict=True)))

    def _unary(self, number: int, body: Json, scope: Scope) -> Array:
        operand = self.array(body["operand"], scope)
        functions = {"negate": self.graph.negate, "not": lambda a: self.graph.boolean("not", a), "plus": lambda a: a}
        function = functions.get(body["operator"])
        if function is None:
            refuse(self.dae.place_of(number), f"the operator {body['operator']}", "rewrite it in the subset")
        return self._map(self.dae.place_of(number), [operand], function)

    def _binary(self, number: int, body: Json, scope: Scope) -> Array:
        operator = str(body["operator"]).removeprefix("elementwise_")
        left, right = self.array(body["lhs"], scope), self.array(body["rhs"], scope)
        place = self.dae.place_of(number)
        if operator in COMPARISONS:
            return self._map(place, [left, right], lambda a, b: self.relation(operator, a, b, scope))
        if body["operator"] == "multiply" and left.shape and right.shape:
            return self._matrix_product(place, left, right)
        functions: dict[str, Callable[[int, int], int]] = {
            "add": self.graph.add,
            "subtract": self.graph.subtract,
            "multiply": self.graph.multiply,
            "divide": self.graph.divide,
            "power": self.graph.power,
            "and": lambda a, b: self.graph.boolean("and", a, b),
            "or": lambda a, b: self.graph.boolean("or", a, b),
        }
        function = functions.get(operator)
        if function is None:
            refuse(place, f"the operator {operator}", "rewrite it in the subset")
        return self._map(place, [left, right], function)

    def _matrix_product(self, place: SourceLocation, left: Array, right: Array) -> Array:
        rows = left.shape if len(left.shape) == 2 else (1, left.shape[0])
        columns = right.shape if len(right.shape) == 2 else (right.shape[0], 1)
        if rows[1] != columns[0]:
            refuse(place, f"a product of shapes {left.shape} and {right.shape}", "make the inner lengths equal")
        elements = [
            self._dot(left.elements[i * rows[1] : (i + 1) * rows[1]], right.elements[j :: columns[1]])
            for i in range(rows[0])
            for j in range(columns[1])
        ]
        return Array((*left.shape[:-1], *right.shape[1:]), tuple(elements))

    def _dot(self, left: Sequence[int], right: Sequence[int]) -> int:
        a, x = self._run(left), self._run(right)
        if a is not None and x is not None and len(left) > 3:
            return self.graph.dot(a, x, len(left))
        total = self.graph.number(0.0)
        for factor, other in zip(left, right, strict=True):
            total = self.graph.add(total, self.graph.multiply(factor, other))
        return total

    def _run(self, elements: Sequence[int]) -> tuple[int, int] | None:
        """Return (first value reference, stride) when `elements` are evenly spaced variables."""
        nodes = [self.graph[e] for e in elements]
        references = [n.reference for n in nodes if n.operation == VARIABLE]
        if len(references) != len(elements) or len(references) < 2:
            return None
        stride = references[1] - references[0]
        even = all(b - a == stride for a, b in pairwise(references))
        return (references[0], stride) if even and stride > 0 else None

    def _conditional(self, number: int, _body: Json, scope: Scope) -> Array:
        *pairs, otherwise = self.dae.operands(number)
        result = self.array(otherwise, scope)
        for condition, value in reversed(list(zip(pairs[::2], pairs[1::2], strict=True))):
            test, chosen = self.array(condition, scope), self.array(value, scope)
            result = self._map(self.dae.place_of(number), [test, chosen, result], self.graph.select)
        return result

    # Functions

    def _builtin(self, number: int, body: Json, scope: Scope) -> Array:
        name, place = str(body["builtin"]), self.dae.place_of(number)
        if name == "no_event":
            return self.array(self.dae.operands(number)[0], Scope(False, scope.binders, scope.parameters, scope.values))
        operands = [self.array(o, scope) for o in self.dae.operands(number)]
        if name in _ROUNDINGS:
            return self._map(place, operands, lambda a: self._rounded(name, a, scope))
        if name in _QUOTIENTS:
            return self._map(place, operands, lambda x, y: self._quotient(name, x, y, scope))
        if name in _REDUCTIONS and len(operands) == 1:
            return Array((), (self._reduce(name, operands[0].elements),))
        if name in _ELEMENTARY:
            return self._map(place, operands, lambda *o: self.graph.apply(name, *o))
        rearrange: dict[str, Callable[[], Array]] = {
            "smooth": lambda: operands[1],
            "promoted_cat1": lambda: _concatenate(operands, axis=0),
            "promoted_cat2": lambda: _concatenate(operands, axis=1),
            "size": lambda: self._size(operands[0], operands[1], place),
            "transpose": lambda: _transposed(operands[0]),
        }
        if name not in rearrange:
            refuse(place, f"the function {name}()", ADVICE.get(name, "rewrite it with elementary functions"))
        return rearrange[name]()

    def _size(self, array: Array, axis: Array, place: SourceLocation) -> Array:
        return Array((), (self.graph.number(array.shape[int(self._fixed(axis, place)) - 1]),))

    def _reduce(self, name: str, elements: Sequence[int]) -> int:
        combine: dict[str, Callable[[int, int], int]] = {
            "sum": self.graph.add,
            "product": self.graph.multiply,
            "min": lambda a, b: self.graph.apply("min", a, b),
            "max": lambda a, b: self.graph.apply("max", a, b),
        }
        total = elements[0]
        for element in elements[1:]:
            total = combine[name](total, element)
        return total

    def _fixed(self, array: Array, place: SourceLocation) -> float:
        value = self.graph.value(array.scalar)
        if value is None:
            refuse(place, "a size that is not known at build time", "use a constant or final parameter")
        return value

    def _quotient_owner(self, number: int, body: Json, scope: Scope) -> Array:
        x, y = self.scalar(body["lhs"], scope), self.scalar(body["rhs"], scope)
        return Array((), (self._quotient(str(body["builtin"]), x, y, scope),))

    def _quotient(self, name: str, x: int, y: int, scope: Scope) -> int:
        """Return mod(x, y) = x - floor(x/y)·y, div(x, y) = truncate(x/y) or rem(x, y) = x - div(x, y)·y."""
        ratio = self.graph.divide(x, y)
        whole = self._rounded("floor", ratio, scope) if name == "mod" else self._truncated(ratio, scope)
        return whole if name == "div" else self.graph.subtract(x, self.graph.multiply(whole, y))

    def _rounded(self, name: str, argument: int, scope: Scope) -> int:
        if name == "ceil":
            return self.graph.negate(self._rounded("floor", self.graph.negate(argument), scope))
        if not scope.events or not self._moves(argument):
            return self.graph.apply("floor", argument)
        slot = self._slots.setdefault(("floor", argument), len(self.quotients))
        if slot == len(self.quotients):
            self.quotients.append(Quotient(argument))
        return self.graph.leaf(QUOTIENT, slot)

    def _truncated(self, argument: int, scope: Scope) -> int:
        if not scope.events or not self._moves(argument):
            return self.graph.apply("truncate", argument)
        positive = self.relation("greater_equal", argument, self.graph.number(0.0), scope)
        up = self._rounded("floor", argument, scope)
        return self.graph.select(positive, up, self._rounded("ceil", argument, scope))

    # Relations

    def _moves(self, expression: int) -> bool:
        return bool(self.graph.variables(expression) & self.continuous)

    def relation(self, operator: str, a: int, b: int, scope: Scope) -> int:
        """Return the relation: frozen between events when a side moves continuously, else plain."""
        difference = self.graph.subtract(a, b)
        frozen = scope.events and operator not in {"equal", "not_equal"} and self._moves(difference)
        if not frozen:
            return self.graph.apply(operator, a, b)
        slot = self._slots.setdefault((operator, difference), len(self.relations))
        if slot == len(self.relations):
            self.relations.append(self._new_relation(operator, difference))
        return self.graph.leaf(RELATION, slot)

    def _new_relation(self, operator: str, difference: int) -> Relation:
        """Choose z so that the relation is exactly z > 0 or exactly z <= 0."""
        flipped = operator in {"greater_equal", "less"}
        z = self.graph.negate(difference) if flipped else difference
        positive = operator in {"greater", "less"}
        moving = self.graph.variables(z) & self.continuous
        if moving == {TIME}:
            slope = self.graph.value(partial(self.graph, z, TIME))
            if slope:
                deadline = self.graph.divide(
                    self.graph.negate(self.graph.substitute(z, {TIME: self.graph.number(0.0)})),
                    self.graph.number(slope),
                )
                return Relation(z, positive == (slope > 0.0), deadline)
        return Relation(z, positive)

    # Arrays

    def _array(self, number: int, _body: Json, scope: Scope) -> Array:
        rows = [self.array(o, scope) for o in self.dae.operands(number)]
        return Array((len(rows), *rows[0].shape), tuple(e for row in rows for e in row.elements))

    def _index(self, number: int, body: Json, scope: Scope) -> Array:
        base = self.array(body["base"], scope)
        place = self.dae.place_of(number)
        axes = [
            self._subscript(s["kind"], n, scope, place)
            for s, n in zip(self.dae.subscripts(number), base.shape, strict=False)
        ]
        axes += [list(range(n)) for n in base.shape[len(axes) :]]
        shape = tuple(len(axis) for axis in axes if isinstance(axis, list))
        moving = [k for k, axis in enumerate(axes) if isinstance(axis, int)]
        if not moving:
            picks = [axis if isinstance(axis, (list, tuple)) else [] for axis in axes]
            elements = [base.elements[_offset(where, base.shape)] for where in product(*picks)]
            return Array(shape, tuple(elements))
        if len(base.shape) != 1:
            refuse(place, "an index that varies at run time in a matrix", "use a vector or write the row out")
        return Array((), (self.graph.lookup(axes[0], base.elements),))  # type: ignore[arg-type]

    def _subscript(self, kind: Json, length: int, scope: Scope, place: SourceLocation) -> list[int] | tuple[int] | int:
        """Return positions (list: the axis stays; tuple: it goes), or an expression that varies."""
        if kind == "whole":
            return list(range(length))
        name, expression = next(iter(kind.items()))
        if name != "index":
            return refuse(place, f"the subscript {name}", "index with an Integer or with `:`")
        index = self.array(expression, scope)
        values = [self.graph.value(e) for e in index.elements]
        if index.shape == () and values[0] is None:
            return index.scalar
        positions = [int(v) - 1 for v in values if v is not None]
        if len(positions) != len(values) or any(not 0 <= p < length for p in positions):
            refuse(place, f"an index outside 1…{length}", "check the bounds")
        return positions if index.shape else (positions[0],)

    def _comprehension(self, _number: int, body: Json, scope: Scope) -> Array:
        rows = [self.array(body["body"], inner) for inner in self.iterate(body["domain"], scope)]
        shape = tuple(len(_range(b)) for b in self.dae.binders(body["domain"]))
        return Array((*shape, *rows[0].shape), tuple(e for row in rows for e in row.elements))

    def iterate(self, domain: int, scope: Scope) -> Iterator[Scope]:
        """Yield `scope` with the loop variables of `domain` set, in row-major order."""
        binders = self.dae.binders(domain)
        for values in product(*(_range(b) for b in binders)):
            own = {(domain, position): value for position, value in enumerate(values)}
            yield Scope(scope.events, {**scope.binders, **own}, scope.parameters, scope.values)

    # Modelica functions

    def _call(self, number: int, body: Json, scope: Scope) -> Array:
        function = self.dae.storage["functions"][body["function"]]
        if function.get("external") is not None:
            refuse(self.dae.place_of(number), f"the external function {function['name']}", ADVICE["external"])
        arguments = [self.array(o, scope) for o in self.dae.operands(number)]
        inner = Scope(False, {}, arguments, {})
        self._execute(function["statements"], inner, self.dae.place_of(number))
        return inner.values[body["output"]]

    def _function_value(self, number: int, body: Json, scope: Scope) -> Array:
        if body["value"] not in scope.values:
            refuse(self.dae.place_of(number), "a function variable that is read before it is assigned", "assign it")
        return scope.values[body["value"]]

    def _execute(self, statements: Sequence[Json], scope: Scope, place: SourceLocation) -> None:
        for statement in statements:
            kind, body = next(iter(statement.items()))
            if kind == "assignment":
                scope.values[body["target"]] = self.array(body["rhs"], scope)
            elif kind == "assignment_group":
                new = {a["target"]: self.array(a["rhs"], scope) for a in body["assignments"]}
                scope.values.update(new)
            elif kind == "for":
                for inner in self.iterate(body["domain"], scope):
                    self._execute(body["statements"], inner, place)
            else:
                refuse(place, f"the statement {kind} in a function", "use if, for, while and a single exit")


_COORDINATES = {
    "parameter", "constant", "input", "state", "derivative", "algebraic", "discrete_real", "discrete_value",
    "pre_state", "pre_discrete_real", "pre_discrete_value",
}  # fmt: skip
_REDUCTIONS = {"sum", "product", "min", "max"}
_QUOTIENTS = {"mod", "div", "rem"}
_ROUNDINGS = {"floor", "ceil", "integer"}
_ELEMENTARY = {
    "abs", "sign", "sqrt", "sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "exp",
    "log", "log10", "min", "max",
}  # fmt: skip


def _range(binder: Json) -> range:
    step = int(binder["step"])
    return range(int(binder["lower"]), int(binder["upper"]) + (1 if step > 0 else -1), step)


def _offset(position: Sequence[int], shape: Sequence[int]) -> int:
    offset = 0
    for index, length in zip(position, shape, strict=True):
        offset = offset * length + index
    return offset


def _transposed(array: Array) -> Array:
    rows, columns = array.shape
    return Array((columns, rows), tuple(array.elements[i * columns + j] for j in range(columns) for i in range(rows)))


def _concatenate(operands: Sequence[Array], *, axis: int) -> Array:
    """Join as matrices: [a, b; c, d]."""
    matrices = [a if len(a.shape) == 2 else Array(_as_matrix(a.shape), a.elements) for a in operands]
    if axis == 0:
        rows = sum(m.shape[0] for m in matrices)
        return Array((rows, matrices[0].shape[1]), tuple(e for m in matrices for e in m.elements))
    elements = [
        e
        for i in range(matrices[0].shape[0])
        for m in matrices
        for e in m.elements[i * m.shape[1] : (i + 1) * m.shape[1]]
    ]
    return Array((matrices[0].shape[0], sum(m.shape[1] for m in matrices)), tuple(elements))


def _as_matrix(shape: tuple[int, ...]) -> tuple[int, int]:
    return (1, 1) if shape == () else (shape[0], 1)


__all__ = ["ADVICE", "NUMBER", "Array", "Scope", "Translator", "refuse"]

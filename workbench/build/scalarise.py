"""From the front end's DAE to a :class:`~workbench.build.scalar_model.ScalarModel`."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any

from workbench.build.expressions import CONDITION, CONDITION_PRE, INITIAL, TICK, VARIABLE, ExpressionGraph
from workbench.build.ir import Dae, IrVariable, Json
from workbench.build.scalar_model import (
    TIME,
    Action,
    ConditionalBranch,
    DiscreteEquation,
    ModelClock,
    ResidualEquation,
    ScalarModel,
    ScalarVariable,
)
from workbench.build.translate import ADVICE, Array, Scope, Translator, refuse
from workbench.build.units import rate_unit
from workbench.errors import BuildError

_CALLED = {"model_event_transactions": "a when clause in an algorithm section"}
_KINDS = {
    "input": "input",
    "parameter": "parameter",
    "constant": "constant",
    "state": "state",
    "algebraic": "algebraic",
    "output": "algebraic",
    "discrete_real": "discrete",
    "discrete_value": "discrete",
}


def scalarise(dae: Dae, name: str, description: str) -> ScalarModel:
    """Return the model without arrays.

    Raises:
        BuildError: Something is outside the supported subset: the message names file, line, construct and what to
            write instead.
    """
    return _Scalariser(dae, name, description).run()


class _Scalariser:
    def __init__(self, dae: Dae, name: str, description: str) -> None:
        self.dae = dae
        self.graph = ExpressionGraph()
        self.model = ScalarModel(name, description, self.graph)
        self.layout: dict[int, int] = {}
        self.derivatives: dict[int, int] = {}
        self.constants: dict[int, Array] = {}
        self.continuous: set[int] = set()
        self.translator = Translator(
            dae,
            self.graph,
            layout=self.layout,
            derivatives=self.derivatives,
            constants=self.constants,
            continuous=self.continuous,
        )
        self.plain = Scope(events=False)
        self.eventful = Scope(events=True)

    def run(self) -> ScalarModel:
        self._refuse_unsupported()
        self._declare()
        self._continuous_equations()
        self._clocks()
        self._conditions()
        self._discrete_equations()
        self._actions()
        self.model.relations = self.translator.relations
        self.model.quotients = self.translator.quotients
        self.model.delays = self.translator.delays
        self._fix(self.translator.delay_times)
        return self.model

    def _refuse_unsupported(self) -> None:
        storage = self.dae.storage
        for entry in storage["initialization_equation_operations"]:
            body = next(iter(entry.values()))
            refuse(self.dae.place(body["provenance"]), "an initial equation", ADVICE["initial_equation"])
        for key in ("previous_values", "terminals", "model_event_transactions"):
            for entry in storage[key]:
                construct = _CALLED.get(key, key.removesuffix("s").replace("_", " "))
                place = self.dae.place(entry.get("provenance", {}))
                refuse(place, construct, ADVICE.get(key.removesuffix("s"), "rewrite it in the subset"))

    # Variables

    def _fix(self, expressions: set[int]) -> None:
        """Declare the parameters fixed that delays depend on: the past is kept for so long and no longer."""
        waiting = [r for e in expressions for r in self.graph.variables(e)]
        while waiting:
            reference = waiting.pop()
            self._replace(reference, fixed=True)
            waiting += self.graph.variables(self.model.bindings[reference]) if reference in self.model.bindings else ()

    def _declare(self) -> None:
        zero = self.graph.number(0.0)
        self.model.variables.append(
            ScalarVariable("time", "real", "time", False, zero, unit="s", description="Simulation time")
        )
        self.continuous.add(TIME)
        ordered = sorted(enumerate(self.dae.variables), key=lambda item: item[1].role == "state")
        for number, variable in ordered:
            self._lay_out(number, variable)
        for number, variable in ordered:
            if variable.role == "state":
                self._lay_out_derivative(number, variable)
        for number, variable in enumerate(self.dae.variables):
            if number not in self.constants:
                self._declare_values(number, variable)

    def _lay_out(self, number: int, variable: IrVariable) -> None:
        """Reserve the value references of one declared variable, or fold a constant."""
        if variable.type.scalar == "string":
            refuse(variable.place, f"the String variable {variable.name}", ADVICE["string"])
        if variable.role not in _KINDS:
            refuse(variable.place, f"the {variable.role.replace('_', ' ')} {variable.name}", "rewrite it")
        first = len(self.model.variables)
        self.layout[number] = first
        for element in _elements(variable):
            self.model.variables.append(self._scalar_variable(variable, element))
            if self.model.variables[-1].continuous:
                self.continuous.add(len(self.model.variables) - 1)
        if _is_folded(variable):
            self._fold(number, variable, first)

    def _scalar_variable(self, variable: IrVariable, element: str) -> ScalarVariable:
        attributes = variable.attributes
        kind = "constant" if _is_folded(variable) else _KINDS[variable.role]
        return ScalarVariable(
            name=variable.name + element,
            type=variable.type.scalar,
            kind=kind,
            output=variable.causality == "output",
            start=self.graph.number(0.0),
            unit=attributes.get("unit"),
            description=attributes.get("description"),
            minimum=self._attribute(attributes, "min", element),
            maximum=self._attribute(attributes, "max", element),
            nominal=self._attribute(attributes, "nominal", element),
            continuous=variable.variability == "continuous" and kind not in {"parameter", "constant"},
            literals=tuple(self.dae.enumerations.get(variable.name, ())),
            place=variable.place,
        )

    def _attribute(self, attributes: Mapping[str, Json], name: str, element: str) -> float | None:
        expression = attributes.get(name)
        if expression is None:
            return None
        array = self.translator.array(expression, self.plain)
        index = 0 if array.shape == () or not element else _position(element, array.shape)
        return self.graph.value(array.elements[index])

    def _fold(self, number: int, variable: IrVariable, first: int) -> None:
        source = variable.attributes.get("binding")
        array = self.translator.array(variable.attributes["start"] if source is None else source, self.plain)
        array = _spread(array, variable.type.dimensions)
        self.constants[number] = array
        for offset, element in enumerate(array.elements):
            self._replace(first + offset, start=element)

    def _replace(self, reference: int, **changes: Any) -> None:  # noqa: ANN401 - any field of the dataclass
        self.model.variables[reference] = replace(self.model.variables[reference], **changes)

    def _lay_out_derivative(self, number: int, variable: IrVariable) -> None:
        self.derivatives[number] = len(self.model.variables)
        unit = variable.attributes.get("unit")
        for offset, element in enumerate(_elements(variable)):
            self.continuous.add(len(self.model.variables))
            self.model.variables.append(
                ScalarVariable(
                    name=f"der({variable.name}{element})",
                    type="real",
                    kind="derivative",
                    output=False,
                    start=self.graph.number(0.0),
                    unit=rate_unit(unit),
                    description=f"Time derivative of {variable.name}{element}",
                    derivative_of=self.layout[number] + offset,
                    place=variable.place,
                )
            )

    def _declare_values(self, number: int, variable: IrVariable) -> None:
        """Bind parameters and give start values."""
        attributes, first = variable.attributes, self.layout[number]
        source = attributes.get("binding") if variable.role == "parameter" else None
        source = attributes.get("start") if source is None else source
        if source is None:
            return
        array = _spread(self.translator.array(source, self.plain), variable.type.dimensions)
        if variable.role == "parameter" and attributes.get("fixed") == [False]:
            refuse(variable.place, f"the parameter {variable.name} with fixed = false", "give it a value")
        for offset, element in enumerate(array.elements):
            reads = self.graph.variables(element)
            if variable.role == "parameter" and reads:
                self.model.bindings[first + offset] = element
                self._replace(first + offset, kind="calculated")
            elif reads and variable.role not in {"state", "discrete_real", "discrete_value", "algebraic", "output"}:
                refuse(variable.place, f"a start value of {variable.name} that depends on others", "give a number")
            self._replace(first + offset, start=element)

    # Equations

    def _residuals(self, entries: Json) -> Iterator[tuple[int, Json]]:
        """Yield (scalar residual, provenance) of plain and structured equations."""
        for entry in entries:
            kind, body = next(iter(entry.items()))
            scopes = [self.eventful]
            expressions = [body["residual"]] if kind == "residual" else body["bodies"]
            if kind == "structured" and body["scalar_view"] == "BinderSubstitution":
                scopes = list(self.translator.iterate(body["domain"], self.eventful))
            for scope in scopes:
                for expression in expressions:
                    for scalar in self.translator.array(expression, scope).elements:
                        yield scalar, body.get("provenance", entry.get("provenance", {}))

    def _continuous_equations(self) -> None:
        for scalar, provenance in self._residuals(self.dae.storage["continuous_equation_operations"]):
            self.model.residuals.append(ResidualEquation(scalar, self.dae.place(provenance)))

    def _clocks(self) -> None:
        for clock in self.dae.storage["clocks"]:
            kind, body = next(iter(clock["kind"].items()))
            place = self.dae.place(clock["provenance"])
            if kind != "periodic" or body.get("anchor") != "absolute":
                refuse(place, f"a {kind} clock", "use `when sample(start, period)` with constants")
            self._refuse_tunable_period(place.text, place)
            lattice = body["lattice"]
            period, phase = lattice["period"], lattice["phase"]
            self.model.clocks.append(
                ModelClock((int(period["num"]), int(period["den"])), (int(phase["num"]), int(phase["den"])))
            )

    def _refuse_tunable_period(self, text: str, place: Any) -> None:  # noqa: ANN401
        """The front end bakes a parameter's default into the clock; the user could not change it."""
        names = set(re.findall(r"[A-Za-z_][\w.]*", text.partition("(")[2]))
        for variable in self.dae.variables:
            local = variable.name.rpartition(".")[2]
            if variable.role == "parameter" and not _is_folded(variable) and {variable.name, local} & names:
                refuse(
                    place,
                    f"the parameter {variable.name} as a sample period",
                    "declare it `constant` or `final parameter`, or use the deadline pattern "
                    "`when time >= pre(next) then next = pre(next) + period`",
                )

    def _conditions(self) -> None:
        for entry in self.dae.storage["conditions"]:
            self.model.conditions.append(self._condition(entry["node"]))

    def _condition(self, node: Json) -> int:
        if node == "always":
            return self.graph.number(1.0)
        if node == "initial":
            return self.graph.leaf(INITIAL, 0)
        kind, body = next(iter(node.items()))
        leaf, boolean = self.graph.leaf, self.graph.boolean
        handlers: dict[str, Callable[[], int]] = {
            "relation": lambda: self._relation(body),
            "discrete": lambda: self.translator.scalar(body, self.eventful),
            "clock": lambda: leaf(TICK, body),
            "not": lambda: boolean("not", leaf(CONDITION, body)),
            "and": lambda: boolean("and", leaf(CONDITION, body["lhs"]), leaf(CONDITION, body["rhs"])),
            "or": lambda: boolean("or", leaf(CONDITION, body["lhs"]), leaf(CONDITION, body["rhs"])),
            "any_rise": lambda: boolean("or", self._rise(body["lhs"]), self._rise(body["rhs"])),
            # A root that the front end made for mod() and div(); our own quotients carry their events.
            "quotient_owner": lambda: self.graph.number(0.0),
        }
        if kind not in handlers:
            raise BuildError(f"{self.model.name}: the condition {kind} is not supported; rewrite the when clause")
        return handlers[kind]()

    def _relation(self, number: int) -> int:
        entry = self.dae.storage["relations"][number]
        kind, body = next(iter(entry.items()))
        if kind != "relation":
            return self.graph.number(0.0)
        if number not in self._conditional_relations():
            # A root of an if-expression or of floor(); the equation that holds it makes its own relation.
            return self.graph.number(0.0)
        return self.translator.scalar(body["expression"], self.eventful)

    def _conditional_relations(self) -> set[int]:
        """Return the relations that a when clause or an assert acts on, through conditions."""
        nodes = [entry["node"] for entry in self.dae.storage["conditions"]]
        used: set[int] = set()
        stack = [c for pair in self._activations() for c in pair]
        while stack:
            number = stack.pop()
            if number not in used:
                used.add(number)
                stack.extend(_operands_of(nodes[number]))
        return {nodes[c]["relation"] for c in used if isinstance(nodes[c], dict) and "relation" in nodes[c]}

    def _activations(self) -> Iterator[tuple[int, int]]:
        storage = self.dae.storage
        entries = [e["activation"] for e in storage["discrete_real_equations"]]
        entries += [b["activation"] for owner in storage["discrete_value_owners"] for b in owner["branches"]]
        for activation in entries:
            if activation != "always":
                yield activation["when"]["trigger"], activation["when"]["guard"]
        for action in storage["event_actions"]:
            yield action["trigger"], action["guard"]

    def _rise(self, number: int) -> int:
        """Return the expression of "condition `number` has just become true"."""
        node = self.dae.storage["conditions"][number]["node"]
        now = self.graph.leaf(CONDITION, number)
        if node in {"always", "initial"} if isinstance(node, str) else next(iter(node)) in {"clock", "any_rise"}:
            return now
        # While the model is initialised only `when initial()` acts.
        before = self.graph.boolean("or", self.graph.leaf(CONDITION_PRE, number), self.graph.leaf(INITIAL, 0))
        return self.graph.boolean("and", now, self.graph.boolean("not", before))

    def _fires(self, activation: Json) -> int | None:
        if activation == "always":
            return None
        when = activation["when"]
        return self._fire(when["trigger"], when["guard"])

    def _fire(self, trigger: int, guard: int) -> int:
        rise = self._rise(trigger)
        return rise if trigger == guard else self.graph.boolean("and", rise, self.graph.leaf(CONDITION, guard))

    def _discrete_equations(self) -> None:
        equations: dict[int, DiscreteEquation] = {}

        def add(target: int, value: int, activation: Json, provenance: Json) -> None:
            place = self.dae.place(provenance)
            equation = equations.setdefault(target, DiscreteEquation(target, place))
            equation.branches.append(ConditionalBranch(self._fires(activation), value))

        for entry in self.dae.storage["discrete_real_equations"]:
            scope = self._scope_of(entry["activation"])
            for scalar in self._real_residuals(entry, scope):
                target, value = self._solve_discrete(scalar, entry)
                add(target, value, entry["activation"], entry["provenance"])
        for owner in self.dae.storage["discrete_value_owners"]:
            for target, value, activation in self._owned_values(owner):
                add(target, value, activation, owner.get("provenance", {}))
        self.model.discrete = list(equations.values())

    def _scope_of(self, activation: Json) -> Scope:
        return self.eventful if activation == "always" else self.plain

    def _real_residuals(self, entry: Json, scope: Scope) -> Iterator[int]:
        if "residual" in entry:
            yield from self.translator.array(entry["residual"], scope).elements
            return
        place = self.dae.place(entry.get("provenance", {}))
        refuse(place, "this form of a discrete equation", "assign the whole variable in the when clause")

    def _solve_discrete(self, residual: int, entry: Json) -> tuple[int, int]:
        node = self.graph[residual]
        if node.operation == "subtract":
            for side, other in (node.operands, node.operands[::-1]):
                target = self.graph[side]
                if target.operation == VARIABLE and self.model.variables[target.reference].kind == "discrete":
                    return target.reference, other
        if node.operation == VARIABLE:  # x − 0 was simplified
            return node.reference, self.graph.number(0.0)
        if node.operation == "add":  # x − (−e) was simplified
            target, other = self.graph[node.operands[0]], node.operands[1]
            if target.operation == VARIABLE:
                return target.reference, self.graph.negate(other)
        place = self.dae.place(entry["provenance"])
        return refuse(place, "an implicit discrete equation", "write `variable = expression` in the when clause")

    def _owned_values(self, owner: Json) -> Iterator[tuple[int, int, Json]]:
        for branch in owner["branches"]:
            scope = self._scope_of(branch["activation"])
            for target, value in zip(owner["targets"], branch["values"], strict=True):
                shape = self.dae.variables[target].type.dimensions
                if "value" not in value:
                    refuse(self.dae.place(owner.get("provenance", {})), "this discrete assignment", "assign a value")
                array = _spread(self.translator.array(value["value"], scope), shape)
                for offset, element in enumerate(array.elements):
                    yield self.layout[target] + offset, element, branch["activation"]

    def _actions(self) -> None:
        for entry in self.dae.storage["event_actions"]:
            kind, body = next(iter(entry["kind"].items()))
            fires = self._fire(entry["trigger"], entry["guard"])
            place = self.dae.place(entry.get("provenance", {}))
            if kind == "reinitialize":
                value = self.translator.scalar(body["value"], self.plain)
                self.model.actions.append(Action("reinit", fires, self.layout[body["state"]], value))
            elif kind in {"terminate", "assert"}:
                self.model.actions.append(Action(kind, fires, message=self._text(body["message"])))
            else:
                refuse(place, kind, "use reinit, terminate or assert")

    def _text(self, expression: int) -> str:
        node = self.dae.node(expression)
        literal = node.get("literal", {}) if isinstance(node, dict) else {}
        if "string" not in literal:
            refuse(self.dae.place_of(expression), "a message that is computed", "use a literal text")
        return str(literal["string"])


def _operands_of(node: Json) -> list[int]:
    if isinstance(node, str):
        return []
    kind, body = next(iter(node.items()))
    if kind == "not":
        return [body]
    return [body["lhs"], body["rhs"]] if kind in {"and", "or", "any_rise"} else []


def _is_folded(variable: IrVariable) -> bool:
    """Constants, final and structural parameters: the front end has already used their values."""
    return variable.role == "constant" or (variable.role == "parameter" and bool(variable.attributes.get("evaluable")))


def _elements(variable: IrVariable) -> list[str]:
    """Return "[1]", "[2]", … in row-major order, or "" for a scalar."""
    names = [""]
    for position, length in enumerate(variable.type.dimensions):
        separator = "[" if position == 0 else ","
        names = [f"{name}{separator}{i}" for name in names for i in range(1, length + 1)]
    return [f"{name}]" if name else name for name in names]


def _position(element: str, shape: tuple[int, ...]) -> int:
    position = 0
    for index, length in zip(element.strip("[]").split(","), shape, strict=True):
        position = position * length + int(index) - 1
    return position


def _spread(array: Array, shape: tuple[int, ...]) -> Array:
    """Repeat a scalar over the shape of the variable that it is given to."""
    if array.shape == () and shape != ():
        return Array(shape, array.elements * math.prod(shape))
    return Array(shape, array.elements)

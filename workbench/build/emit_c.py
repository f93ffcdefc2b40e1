"""Write the model as C: one file, model.c, that core.c drives through model.h."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from workbench.build.causalise import Assignment
from workbench.build.differentiate import tangent
from workbench.build.emit_expressions import Writer, bare, uses_of
from workbench.build.emit_tables import c_number, c_string, indicator_references, tables
from workbench.build.loops import Shapes
from workbench.build.scalar_model import TIME, ScalarModel
from workbench.build.structure import output_cone


class _Emitter:
    def __init__(self, model: ScalarModel, order: Sequence[Assignment]) -> None:
        self.model, self.order, self.graph = model, order, model.graph
        self.indicators = indicator_references(model)
        self.shapes = Shapes(model.graph)

    def _writer(self, expressions: Iterable[int]) -> Writer:
        """Count how often each node is used in one function, then write it."""
        return Writer(self.graph, len(self.model.relations), uses_of(self.graph, expressions), self.shapes)

    def function(self, signature: str, writer: Writer, unused: Sequence[str] = ()) -> str:
        body = [f"(void){name};" for name in unused] + writer.lines
        return signature + "\n{\n" + "".join(f"    {line}\n" for line in body) + "}\n"

    # Evaluation

    def continuous(self) -> str:
        steps = [s for s in self.order if s.kind in {"variable", "relation", "quotient", "delay"}]
        writer = self._writer(e for s in steps for e in self._read(s))
        self._assign_all(writer, steps)
        return self.function("void model_continuous(const Frame *f)", writer, ["f"])

    def outputs(self) -> str:
        """What reading an output needs between events; empty where all is evaluated for it."""
        cone = output_cone(self.model, self.order)
        steps = cone or []
        writer = self._writer(e for s in steps for e in self._read(s))
        self._assign_all(writer, steps)
        flag = f"const bool model_outputs_apart = {'true' if cone is not None else 'false'};\n\n"
        return flag + self.function("void model_outputs(const Frame *f)", writer, ["f"])

    def discrete(self) -> str:
        writer = self._writer(e for s in self.order for e in self._read(s))
        self._assign_all(writer, self.order)
        return self.function("void model_discrete(const Frame *f)", writer, ["f"])

    def _read(self, step: Assignment) -> list[int]:
        if step.discrete is not None:
            return [e for b in step.discrete.branches for e in (b.fires, b.value) if e is not None]
        if step.kind == "relation":
            relation = self.model.relations[step.target]
            return [relation.indicator if relation.deadline is None else relation.deadline]
        return [] if step.expression is None else [step.expression]

    def _assign_all(self, writer: Writer, steps: Sequence[Assignment]) -> None:
        for places, loop in self.shapes.runs([s.expression if s.kind == "variable" else None for s in steps]):
            if loop:
                self._loop(writer, "f->v[{}]", [(steps[p].target, steps[p].expression or 0) for p in places])
            else:
                for place in places:
                    self._assign(writer, steps[place])

    def _loop(self, writer: Writer, left: str, assigned: Sequence[tuple[int, int]]) -> None:
        first, last = (_comment(self._name(target)) for target, _ in (assigned[0], assigned[-1]))
        writer.loop(left, [t for t, _ in assigned], [e for _, e in assigned], f" /* {first} ... {last} */")

    def _name(self, reference: int) -> str:
        variables = self.model.variables
        return variables[reference].name if reference < len(variables) else "event indicator"

    def _assign(self, writer: Writer, step: Assignment) -> None:
        handlers = {
            "variable": self._assign_variable,
            "relation": self._assign_relation,
            "quotient": self._assign_quotient,
            "condition": self._assign_condition,
            "discrete": self._assign_discrete,
            "delay": self._note_delay,
        }
        handlers[step.kind](writer, step)

    def _assign_variable(self, writer: Writer, step: Assignment) -> None:
        text = bare(writer.text(step.expression or 0)) if step.expression is not None else "0.0"
        writer.lines.append(f"f->v[{step.target}] = {text}; /* {_comment(self.model.variables[step.target].name)} */")

    def _assign_relation(self, writer: Writer, step: Assignment) -> None:
        relation, slot = self.model.relations[step.target], step.target
        if relation.deadline is not None:
            after = f"reached(f->v[{TIME}], {bare(writer.text(relation.deadline))})"
            value = after if relation.holds_when_positive else f"!{after}"
        else:
            reference = self.indicators["relation", slot]
            writer.lines.append(f"f->v[{reference}] = {bare(writer.text(relation.indicator))};")
            value = f"f->v[{reference}] {'>' if relation.holds_when_positive else '<='} 0.0"
        writer.lines.append(f"f->frozen[{slot}] = f->fresh ? {value} : f->frozen[{slot}];")

    def _assign_quotient(self, writer: Writer, step: Assignment) -> None:
        argument = writer.text(self.model.quotients[step.target].argument)
        slot = len(self.model.relations) + step.target
        first = self.indicators["quotient", step.target]
        writer.lines.append(f"f->frozen[{slot}] = f->fresh ? floor({bare(argument)}) : f->frozen[{slot}];")
        writer.lines.append(f"f->v[{first}] = f->frozen[{slot}] + 1.0 - {argument};")
        writer.lines.append(f"f->v[{first + 1}] = f->frozen[{slot}] - {argument};")

    def _assign_condition(self, writer: Writer, step: Assignment) -> None:
        if step.expression is not None:
            writer.lines.append(f"f->condition[{step.target}] = {bare(writer.text(step.expression))};")

    def _note_delay(self, writer: Writer, step: Assignment) -> None:
        """Have it read wherever the model is evaluated, so that it notes its input."""
        if step.expression is not None:
            writer.lines.append(f"(void){writer.text(step.expression)};")

    def _assign_discrete(self, writer: Writer, step: Assignment) -> None:
        if step.discrete is None:
            return
        value = f"f->pre[{step.target}]"
        for branch in reversed(step.discrete.branches):
            chosen = writer.text(branch.value)
            if branch.fires is None:
                value = chosen
            else:
                fires = writer.text(branch.fires)
                value = f"(({fires} != 0.0) ? {chosen} : {value})"
        name = self.model.variables[step.target].name
        writer.lines.append(f"f->v[{step.target}] = {bare(value)}; /* {_comment(name)} */")

    # Starts and parameters

    def start_values(self) -> str:
        lines = []
        for reference, variable in enumerate(self.model.variables):
            value = self.graph.value(variable.start)
            if value:
                lines.append(f"v[{reference}] = {c_number(value)}; /* {_comment(variable.name)} */")
        writer = Writer(self.graph, 0, {}, self.shapes, ["(void)v;", *lines])
        return self.function("void model_start_values(double *v)", writer)

    def parameters(self) -> str:
        order = parameter_order(self.model)
        writer = self._writer(self.model.bindings[r] for r in order)
        for reference in order:
            text = bare(writer.text(self.model.bindings[reference]))
            name = _comment(self.model.variables[reference].name)
            writer.lines.append(f"f->v[{reference}] = {text}; /* {name} */")
        return self.function("void model_parameters(const Frame *f)", writer, ["f"])

    def start_expressions(self) -> str:
        items = [
            (reference, v.start)
            for reference, v in enumerate(self.model.variables)
            if self.graph.variables(v.start) and v.kind != "calculated"
        ]
        writer = self._writer(start for _, start in items)
        for reference, start in items:
            writer.lines.append(f"f->v[{reference}] = f->pre[{reference}] = {bare(writer.text(start))};")
        return self.function("void model_start_expressions(const Frame *f)", writer, ["f"])

    # Events

    def actions(self) -> str:
        states = {reference: number for number, reference in enumerate(self.model.states)}
        expressions = [e for a in self.model.actions for e in (a.fires, a.value) if e is not None]
        writer = self._writer(expressions)
        writer.lines.append("unsigned fired = ACTION_NONE;")
        for action in self.model.actions:
            fires = writer.text(action.fires)
            if action.kind == "reinit" and action.state is not None and action.value is not None:
                then = f"x[{states[action.state]}] = {bare(writer.text(action.value))};"
            else:
                then = f"*message = {c_string(action.message)};"
            flag = f"fired |= (unsigned)ACTION_{action.kind.upper()};"
            writer.lines += [f"if ({fires} != 0.0) {{", f"    {then}", f"    {flag}", "}"]
        writer.lines.append("return fired;")
        signature = "unsigned model_actions(const Frame *f, double *x, const char **message)"
        return self.function(signature, writer, ["f", "x", "message"])

    def next_deadline(self) -> str:
        deadlines = [r.deadline for r in self.model.relations if r.deadline is not None]
        writer = self._writer(deadlines)
        writer.lines.append("double next = HUGE_VAL;")
        for deadline in deadlines:
            text = writer.text(deadline)
            writer.lines.append(f"if (!reached(f->v[{TIME}], {bare(text)})) {{")
            writer.lines += [f"    next = smaller(next, {bare(text)});", "}"]
        writer.lines.append("return next;")
        return self.function("double model_next_deadline(const Frame *f)", writer, ["f"])

    # Derivatives

    def tangents(self) -> str:
        """Forward mode over parameters, then over all continuous assignments in their order."""
        moving = {
            r for r, v in enumerate(self.model.variables) if v.type == "real" and v.kind not in {"time", "constant"}
        }
        targets = [(r, self.model.bindings[r]) for r in parameter_order(self.model)]
        for step in self.order:
            if step.kind == "variable" and step.expression is not None:
                targets.append((step.target, step.expression))
            elif step.kind == "relation" and ("relation", step.target) in self.indicators:
                reference = self.indicators["relation", step.target]
                targets.append((reference, self.model.relations[step.target].indicator))
            elif step.kind == "quotient":
                argument = self.graph.negate(self.model.quotients[step.target].argument)
                reference = self.indicators["quotient", step.target]
                targets += [(reference, argument), (reference + 1, argument)]
        derivatives = [(r, tangent(self.graph, e, moving)) for r, e in targets]
        writer = self._writer(e for _, e in derivatives)
        for places, loop in self.shapes.runs([e for _, e in derivatives]):
            if loop:
                self._loop(writer, "d[{}]", [derivatives[place] for place in places])
                continue
            for reference, expression in (derivatives[place] for place in places):
                writer.lines.append(f"d[{reference}] = {bare(writer.text(expression))};")
        return self.function("void model_tangent(const Frame *f, double *d)", writer, ["f", "d"])


def parameter_order(model: ScalarModel) -> list[int]:
    """Return the calculated parameters, each after those it needs."""
    order: list[int] = []

    def visit(reference: int) -> None:
        if reference in model.bindings and reference not in order:
            for needed in sorted(model.graph.variables(model.bindings[reference])):
                visit(needed)
            order.append(reference)

    for reference in sorted(model.bindings):
        visit(reference)
    return order


def _comment(text: str) -> str:
    return text.replace("*/", "* /").replace("/*", "/ *")


def _matrix_rows(numbers: Sequence[float]) -> list[str]:
    if not numbers:
        return []
    lines = [", ".join(map(c_number, numbers[i : i + 4])) for i in range(0, len(numbers), 4)]
    return ["static const double matrix_rows[] = {\n" + "".join(f"    {line},\n" for line in lines) + "};\n"]


def emit_equations(model: ScalarModel, order: Sequence[Assignment]) -> str:
    """Return all functions of model.h as C text."""
    emitter = _Emitter(model, order)
    return "\n".join(
        [
            *_matrix_rows(model.graph.table),
            emitter.start_values(),
            emitter.parameters(),
            emitter.start_expressions(),
            emitter.continuous(),
            emitter.outputs(),
            emitter.discrete(),
            emitter.actions(),
            emitter.next_deadline(),
            emitter.tangents(),
        ]
    )


def emit_model(
    model: ScalarModel,
    equations: str,
    token: str,
    *,
    stiff: bool,
    tolerance: float,
    origin: str = "its Modelica source",
) -> str:
    """Return the whole of model.c.

    Args:
        model: The scalar model.
        equations: What :func:`emit_equations` returned.
        token: FMI 2 GUID and FMI 3 instantiation token.
        stiff: Whether Co-Simulation integrates with the implicit method.
        tolerance: Relative tolerance of Co-Simulation when the environment gives none.
        origin: What the model was generated from.
    """
    head = f"/* model.c: {_comment(model.name)}, generated from {origin}. */\n"
    constants = tables(model, token, stiff=stiff, tolerance=tolerance)
    return f'{head}#include "model.h"\n\n{constants}\n{equations}'

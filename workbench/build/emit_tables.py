"""Write the constant tables of model.c: variables, value references, start facts, clocks."""

from __future__ import annotations

import math
from collections.abc import Sequence

from workbench.build.expressions import PRE
from workbench.build.scalar_model import ScalarModel, ScalarVariable


def c_number(value: float) -> str:
    """Return the shortest C literal that reads back as exactly `value`."""
    if math.isnan(value):
        return "NAN"
    if math.isinf(value):
        return "HUGE_VAL" if value > 0 else "(-HUGE_VAL)"
    text = repr(value)
    text = text if any(c in text for c in ".e") else text + ".0"
    return f"({text})" if text.startswith("-") else text


def c_string(text: str) -> str:
    """Return a C string literal; bytes outside ASCII are written in octal."""
    out = "".join(chr(b) if 32 <= b < 127 and chr(b) not in '"\\?' else f"\\{b:03o}" for b in text.encode())
    return f'"{out}"'


def indicator_references(model: ScalarModel) -> dict[tuple[str, int], int]:
    """Return the value reference of each event indicator, after all variables.

    Keys are ("relation", slot) and ("quotient", slot); a quotient has two indicators, the second one
    behind the first.
    """
    next_reference = len(model.variables)
    result: dict[tuple[str, int], int] = {}
    for slot, relation in enumerate(model.relations):
        if relation.deadline is None:
            result["relation", slot] = next_reference
            next_reference += 1
    for slot in range(len(model.quotients)):
        result["quotient", slot] = next_reference
        next_reference += 2
    return result


CAUSALITIES = {
    "time": "CAUSALITY_INDEPENDENT",
    "input": "CAUSALITY_INPUT",
    "parameter": "CAUSALITY_PARAMETER",
    "calculated": "CAUSALITY_CALCULATED_PARAMETER",
}
_ROLES = {"state": "ROLE_STATE", "derivative": "ROLE_DERIVATIVE", "discrete": "ROLE_DISCRETE_STATE"}
_TYPES = {
    "real": "TYPE_REAL",
    "integer": "TYPE_INTEGER",
    "boolean": "TYPE_BOOLEAN",
    "enumeration": "TYPE_ENUMERATION",
}


def variability(variable: ScalarVariable) -> str:
    """Return FMI's variability of a variable."""
    tunable = "fixed" if variable.fixed else "tunable"
    fixed = {"parameter": tunable, "calculated": tunable, "constant": "constant"}.get(variable.kind)
    return fixed or ("continuous" if variable.continuous else "discrete")


def initial(model: ScalarModel, variable: ScalarVariable, *, remembers: bool) -> str:
    """Return FMI's `initial`: exact only for starts that are numbers; `remembers`: set by a when clause."""
    if variable.kind in {"time", "input"}:
        return "none"
    if variable.kind in {"parameter", "constant"}:
        return "exact"
    if variable.kind == "state" or (variable.kind == "discrete" and remembers):
        return "exact" if model.graph.value(variable.start) is not None else "calculated"
    return "calculated"


def remembering(model: ScalarModel) -> set[int]:
    """Return the discrete variables that keep a value from event to event."""
    keep = {d.target for d in model.discrete if all(b.fires is not None for b in d.branches)}
    pre = set()
    expressions = [e for d in model.discrete for b in d.branches for e in (b.fires, b.value) if e is not None]
    expressions += [r.indicator for r in model.relations] + [r.deadline for r in model.relations if r.deadline]
    for expression in expressions:
        pre |= set(model.graph.leaves(expression, PRE))
    return keep | pre


def _info_row(model: ScalarModel, variable: ScalarVariable, *, remembers: bool) -> str:
    causality = "CAUSALITY_OUTPUT" if variable.output else CAUSALITIES.get(variable.kind, "CAUSALITY_LOCAL")
    return (
        f"    {{{_TYPES[variable.type]}, {causality}, VARIABILITY_{variability(variable).upper()}, "
        f"INITIAL_{initial(model, variable, remembers=remembers).upper()}, {_ROLES.get(variable.kind, 'ROLE_OTHER')}}},"
    )


def _table(declaration: str, rows: Sequence[str], empty: str) -> str:
    return f"static const {declaration}[] = {{\n" + "\n".join(rows or [f"    {empty}"]) + "\n};\n"


def _references(name: str, references: Sequence[int]) -> str:
    return _table(f"unsigned {name}", [f"    {r}," for r in references], "0")


def tables(model: ScalarModel, token: str, *, stiff: bool, tolerance: float) -> str:
    """Return all constant tables as C text."""
    remember = remembering(model)
    n_all = len(model.variables) + model.n_indicators
    indicator = "    {TYPE_REAL, CAUSALITY_LOCAL, VARIABILITY_CONTINUOUS, INITIAL_CALCULATED, ROLE_OTHER},"
    names = [v.name for v in model.variables] + [f"event_indicator[{i + 1}]" for i in range(model.n_indicators)]
    bounds = [
        [c_number(b if b is not None else default) for b in values] + [c_number(default)] * model.n_indicators
        for values, default in (
            ([v.minimum for v in model.variables], -math.inf),
            ([v.maximum for v in model.variables], math.inf),
        )
    ]
    discrete = [r for r, v in enumerate(model.variables) if v.kind == "discrete"]
    nominals = [c_number(model.variables[s].nominal or 1.0) for s in model.states]
    clocks = [f"    {{{c.period[0]}, {c.period[1]}, {c.phase[0]}, {c.phase[1]}}}," for c in model.clocks]
    of_state = model.derivatives
    has_time_events = bool(model.clocks or model.delays) or any(r.deadline is not None for r in model.relations)
    rows = [_info_row(model, v, remembers=r in remember) for r, v in enumerate(model.variables)]
    return "\n".join(
        [
            _table("VariableInfo variables", rows + [indicator] * model.n_indicators, "{0}"),
            _table("char *const names", [f"    {c_string(n)}," for n in names], "NULL"),
            _references("states", model.states),
            _references("derivatives", [of_state[s] for s in model.states]),
            _references("discrete", discrete),
            _references("indicators", range(len(model.variables), n_all)),
            _table("double state_nominals", [f"    {n}," for n in nominals], "0.0"),
            _table("double minimum", [f"    {b}," for b in bounds[0]], "0.0"),
            _table("double maximum", [f"    {b}," for b in bounds[1]], "0.0"),
            _table("ClockInfo clocks", clocks, "{0, 1, 0, 1}"),
            "const ModelInfo model_info = {",
            f"    .name = {c_string(model.name.replace('.', '_'))},",
            f"    .token = {c_string(token)},",
            f"    .n_variables = {n_all},",
            f"    .n_states = {len(model.states)},",
            f"    .n_indicators = {model.n_indicators},",
            f"    .n_relations = {len(model.relations) + len(model.quotients)},",
            f"    .n_memory = {2 * len(model.conditions) + 2 * len(model.clocks)},",
            "    .variables = variables,",
            "    .names = names,",
            "    .states = states,",
            "    .derivatives = derivatives,",
            "    .state_nominals = state_nominals,",
            "    .minimum = minimum,",
            "    .maximum = maximum,",
            f"    .has_time_events = {str(has_time_events).lower()},",
            f"    .stiff = {str(stiff).lower()},",
            f"    .default_tolerance = {c_number(tolerance)},",
            "};\n",
            "const ModelLayout model_layout = {",
            f"    .n_frozen = {len(model.relations) + len(model.quotients)},",
            f"    .n_conditions = {len(model.conditions)},",
            f"    .n_clocks = {len(model.clocks)},",
            f"    .n_discrete = {len(discrete)},",
            f"    .n_delays = {len(model.delays)},",
            "    .discrete = discrete,",
            "    .indicators = indicators,",
            "    .clocks = clocks,",
            "};\n",
        ]
    )

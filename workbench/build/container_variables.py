"""What a container FMU shows: the system's inputs and outputs, and the parts' parameters."""

# ruff: noqa: ANN401 - FMPy's classes have no types
from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from fmpy.model_description import ModelVariable, Unit

from workbench.build.container_parts import ContainerPart, word
from workbench.errors import InputError
from workbench.fmi.variable import Value, Variable
from workbench.system.description import Port, Resolved

__all__ = ["ContainerVariable", "shown_units", "shown_variables"]

# FMPy's word for a type → FMI 2.0's.
_FMI2: Mapping[str, str] = {"Float64": "Real", "Int32": "Integer", "Boolean": "Boolean"}
_ZERO: Mapping[str, Value] = {"Float64": 0.0, "Int32": 0, "Boolean": False}
_LEVELS = ("exact", "approx")  # `initial` of variables whose start value is set from outside


@dataclass(frozen=True, eq=False)
class ContainerVariable:
    """One variable of the container.

    Attributes:
        variable: FMPy's description.
        ports: what it stands for; all of them are set, the first is shown.
    """

    variable: Any
    ports: tuple[Port, ...]


def shown_variables(
    parts: Sequence[ContainerPart], resolved: Resolved, starts: Mapping[str, Value], *, fmi: int
) -> list[ContainerVariable]:
    """Return the container's variables, without time.

    Args:
        parts: of the container.
        resolved: the system's connections, inputs and outputs.
        starts: start values of the system's inputs.
        fmi: version of the container, 2 or 3.

    Raises:
        InputError: an input, output or start value is of a type that a container cannot pass on.
    """
    result = [_input(parts, name, ports, starts.get(name), fmi) for name, ports in resolved.inputs.items()]
    result += [_output(parts, name, port, fmi) for name, port in resolved.outputs.items()]
    driven = {(w.to_component, w.destination.name) for w in resolved.wires}
    driven |= {(p.component, p.variable.name) for ports in resolved.inputs.values() for p in ports}
    for number, part in enumerate(parts):
        result += [_start(part, Port(number, v), fmi) for v in _set_from_outside(part, number, driven)]
    return result


def _input(
    parts: Sequence[ContainerPart], name: str, ports: Sequence[Port], start: Value | None, fmi: int
) -> ContainerVariable:
    kinds = [_word(parts, port, f"input {name}") for port in ports]
    if len(set(kinds)) > 1:
        raise InputError(f"input {name}: drives inputs of different types, which a container does not convert")
    first = ports[0]
    given = [parts[p.component].starts.get(p.variable.name, p.variable.start) for p in ports]
    value = next((v for v in (start, *given) if v is not None), _ZERO[kinds[0]])
    moves = all(p.variable.variability == "continuous" for p in ports)
    made = _made(name, first.variable, kinds[0], fmi)
    made.causality, made.variability = "input", "continuous" if moves else "discrete"
    made.start = _literal(value, kinds[0])
    return ContainerVariable(made, tuple(ports))


def _output(parts: Sequence[ContainerPart], name: str, port: Port, fmi: int) -> ContainerVariable:
    kind = _word(parts, port, f"output {name}")
    made = _made(name, port.variable, kind, fmi)
    made.causality, made.initial = "output", "calculated"
    made.variability = "continuous" if port.variable.variability == "continuous" else "discrete"
    return ContainerVariable(made, (port,))


def _word(parts: Sequence[ContainerPart], port: Port, where: str) -> str:
    try:
        return word(parts[port.component], port.variable)
    except InputError as error:
        raise InputError(f"{where}: {parts[port.component].name}: {error}") from None


# -- parameters and start values --------------------------------------------------------------


def _set_from_outside(part: ContainerPart, number: int, driven: set[tuple[int, str]]) -> Iterator[Variable]:
    """Return the part's parameters and what else the system sets; one of several names for the same value."""
    seen = set()
    for variable in sorted(part.variables.values(), key=lambda v: v.name not in part.starts):
        wanted = variable.name in part.starts or (_is_parameter(part, variable) and variable.start is not None)
        if not wanted or (number, variable.name) in driven or variable.value_reference in seen:
            continue
        seen.add(variable.value_reference)
        yield variable


def _is_parameter(part: ContainerPart, variable: Variable) -> bool:
    if variable.causality != "parameter":
        return False
    try:
        word(part, variable)
    except InputError:
        return False  # it keeps the FMU's value
    return True


def _start(part: ContainerPart, port: Port, fmi: int) -> ContainerVariable:
    variable = port.variable
    try:
        kind = word(part, variable)
        made = _made(f"{part.name}.{variable.name}", variable, kind, fmi)
        made.causality, made.variability = _role(part, variable)
    except InputError as error:
        raise InputError(f"component {part.name}: its start value cannot be set in a container: {error}") from None
    value = part.starts.get(variable.name, variable.start)
    made.initial, made.start = "exact", _literal(_ZERO[kind] if value is None else value, kind)
    return ContainerVariable(made, (port,))


def _role(part: ContainerPart, variable: Variable) -> tuple[str, str]:
    """Return causality and variability in the container of what has a start value."""
    if variable.causality == "parameter":
        return "parameter", "tunable" if variable.variability == "tunable" else "fixed"
    if variable.causality == "input":
        return "parameter", "tunable"  # nothing drives it
    if part.shown[variable.name].initial in _LEVELS and variable.causality in ("local", "output"):
        return "local", variable.variability
    raise InputError(f"'{variable.name}' is a {variable.causality} without a start value of its own")


def _made(name: str, like: Variable, kind: str, fmi: int) -> Any:
    return ModelVariable(
        name=name,
        type=_FMI2[kind] if fmi == 2 else kind,
        unit=like.unit if kind == "Float64" else None,
        description=like.description,
    )


def _literal(value: Value, kind: str) -> str:
    """Return a value as XML and the container's configuration write it."""
    if kind == "Boolean":
        return "true" if value else "false"
    return repr(float(value)) if kind == "Float64" else str(int(value))


# -- units ------------------------------------------------------------------------------------


def shown_units(parts: Sequence[ContainerPart], shown: Sequence[ContainerVariable]) -> list[Any]:
    """Return the definitions of the units that the variables have; of the first part that defines each."""
    defined: dict[str, Any] = {}
    for part in parts:
        for unit in part.described.unitDefinitions:
            defined.setdefault(unit.name, unit)
    names = dict.fromkeys(s.variable.unit for s in shown if s.variable.unit)
    return [defined.get(name) or Unit(name=name) for name in names]

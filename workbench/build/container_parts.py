"""The FMUs of a container: which components it can hold, and which connections."""

# ruff: noqa: ANN401 - FMPy's classes have no types
from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fmpy import read_model_description
from fmpy.model_description import ValidationError

from workbench.errors import FmuError, InputError, article
from workbench.fmi.archive import locate
from workbench.fmi.variable import FLOAT_TYPES, Value, Variable
from workbench.fmi.wiring import Wire
from workbench.system.description import (
    BlockComponent,
    Component,
    FmuComponent,
    FunctionComponent,
    GainComponent,
    LinearComponent,
    Resolved,
    SumComponent,
)
from workbench.system.fmu_facts import fmu_facts
from workbench.system.order import plan

__all__ = ["ContainerPart", "container_part", "container_wires", "word"]

_BLOCKS: Mapping[type, str] = {
    LinearComponent: "a linear system is not an FMU; make it one with `workbench build` and connect that",
    GainComponent: "a gain is not an FMU, and a container holds only FMUs",
    SumComponent: "a sum is not an FMU, and a container holds only FMUs",
    BlockComponent: "a block is not an FMU, and a container holds only FMUs",
    FunctionComponent: "a Python function exists only in this process, and a container holds only FMUs",
}
_CLOSE = 1e-9  # relative; of a step to a multiple of another


@dataclass(frozen=True, eq=False)
class ContainerPart:
    """One FMU of a container.

    Attributes:
        component: as it is written down.
        path: the FMU, a file or a folder.
        variables: by name, arrays taken apart.
        starts: start values that the system sets, in their variables' types.
        described: FMPy's description of the FMU.
        shown: name → FMPy's description of the variable; no arrays.
    """

    component: FmuComponent
    path: Path
    variables: Mapping[str, Variable]
    starts: Mapping[str, Value]
    described: Any
    shown: Mapping[str, Any]

    @property
    def name(self) -> str:
        """The component's."""
        return self.component.name

    @property
    def stepping(self) -> Any:
        """What FMPy read about co-simulation."""
        return self.described.coSimulation


# -- components -------------------------------------------------------------------------------


def container_part(component: Component, starts: Mapping[str, Value], *, step: float) -> ContainerPart:
    """Return a component as a part of a container.

    Args:
        component: of the system.
        starts: start values given beside the component's own, by the FMU's names.
        step: communication step of the container [s].

    Raises:
        InputError: FMPy's container cannot hold it; the message names it and says why.
        FmuError: the FMU's description is damaged.
    """
    try:
        if not isinstance(component, FmuComponent):
            raise InputError(_BLOCKS[type(component)])
        part = _part(component, starts)
        _check_interface(part)
        _check_step(part, step)
    except InputError as error:
        raise InputError(f"component {component.name}: {error}") from None
    return part


def _part(component: FmuComponent, starts: Mapping[str, Value]) -> ContainerPart:
    path = locate(component.file).resolve()
    facts = fmu_facts(component.file, component.called)
    variables = facts.variables
    described = _described(component, path)
    return ContainerPart(
        component=component,
        path=path,
        variables=variables,
        starts=facts.starts({**component.set, **starts}),
        described=described,
        shown={v.name: v for v in described.modelVariables if not v.dimensions},
    )


def _described(component: FmuComponent, path: Path) -> Any:
    try:
        return read_model_description(str(path))
    except ValidationError as error:
        raise FmuError(
            f"component {component.name}: FMPy, which makes the container, does not accept the FMU's description: "
            f"{error.problems[0]}"
        ) from None


def _check_interface(part: ContainerPart) -> None:
    if part.described.fmiMajorVersion not in (2, 3):
        raise InputError("an FMU of FMI 1.0; a container holds FMI 2.0 and 3.0")
    if part.stepping is None:
        raise InputError("its FMU offers model exchange only; a container steps co-simulation FMUs")


def _check_step(part: ContainerPart, step: float) -> None:
    own = part.component.step
    if own is not None and not math.isclose(own, step, rel_tol=_CLOSE):
        raise InputError(f"its communication step is {own:g} s, and the container has one for all, {step:g} s")
    fixed = part.stepping.fixedInternalStepSize
    if fixed is not None and not _is_multiple(step, float(fixed)):
        raise InputError(f"its FMU steps with {float(fixed):g} s inside, and {step:g} s is not a multiple of it")


def _is_multiple(step: float, of: float) -> bool:
    count = round(step / of) if of > 0.0 else 0
    return count >= 1 and math.isclose(count * of, step, rel_tol=_CLOSE)


# -- connections ------------------------------------------------------------------------------


def container_wires(parts: Sequence[ContainerPart], resolved: Resolved) -> tuple[list[Wire], list[str]]:
    """Return the connections in the order in which a container hands values over, and notes.

    A value goes on at once through outputs that depend on inputs without delay if the connections stand in that order.

    Raises:
        InputError: FMPy's container cannot express a connection, or there is an algebraic loop.
    """
    for wire in resolved.wires:
        _check_wire(parts, wire)
    result = plan(resolved.wires, parts=len(parts))
    notes = [_loop([resolved.wires[i] for i in group.members]) for group in result.continuous if group.loop]
    order = [i for group in result.events for i in group.members]
    return [resolved.wires[i] for i in order], notes


def _check_wire(parts: Sequence[ContainerPart], wire: Wire) -> None:
    try:
        if wire.closes_at > -math.inf:
            raise InputError(f"closes at t = {wire.closes_at:g} s; connections in a container are always closed")
        if (wire.gain, wire.offset) != (1.0, 0.0):
            change = f"× {wire.gain:.6g}" + (f" + {wire.offset:.6g}" if wire.offset else "")
            raise InputError(
                f"the gain or unit conversion ({change}) cannot be in a container, which passes values on unchanged"
            )
        source = word(parts[wire.from_component], wire.source)
        target = word(parts[wire.to_component], wire.destination)
        if source != target:
            raise InputError(
                f"{article(wire.source.type)} drives {article(wire.destination.type)}, and a container does not convert"
            )
    except InputError as error:
        raise InputError(f"connection {wire.label}: {error}") from None


def word(part: ContainerPart, variable: Variable) -> str:
    """Return FMPy's word for the type of a variable.

    Raises:
        InputError: a container cannot pass it on.
    """
    if variable.name not in part.shown:
        raise InputError(f"'{variable.name}' is an element of an array, which a container cannot pass on alone")
    if variable.type in FLOAT_TYPES - {"Float32"}:
        return "Float64"
    if variable.type in ("Integer", "Int32") or (
        variable.type == "Enumeration" and part.described.fmiMajorVersion == 2
    ):
        return "Int32"
    if variable.type == "Boolean":
        return "Boolean"
    raise InputError(f"'{variable.name}' is {article(variable.type)}, which a container cannot pass on")


def _loop(members: Sequence[Wire]) -> str:
    """Return the note about what may be an algebraic loop.

    Raises:
        InputError: it is one for sure.
    """
    names = ", ".join(c.label for c in members)
    if all(c.source.dependencies is not None for c in members):
        raise InputError(
            f"algebraic loop {names}: a container evaluates it once per step instead of solving it; break it by a part "
            "without direct feed-through"
        )
    return (
        f"{names}: the FMUs do not declare what their outputs depend on; if this is an algebraic loop, the container "
        "evaluates it once per step instead of solving it"
    )

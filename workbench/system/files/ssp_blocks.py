"""Components that are not FMUs, as files inside an .ssp package: what a .toml file would say, as JSON."""

from __future__ import annotations

import json
from typing import Any

from workbench.errors import InputError
from workbench.fmi.variable import Variable
from workbench.system.block_table.registry import block_table
from workbench.system.description import BlockComponent, Component, GainComponent, LinearComponent, SumComponent

__all__ = ["BLOCK_TYPE", "block_bytes", "block_variables"]

# Type of such a component in the SSD.
BLOCK_TYPE = "application/x-fmi-workbench-block"


def block_bytes(component: Component) -> bytes:
    """Return the file of a component; `toml_components.read_component` understands its content.

    Raises:
        InputError: no file can hold it.
    """
    return json.dumps(_table(component), indent=1, sort_keys=True).encode()


def _table(component: Component) -> dict[str, Any]:
    if isinstance(component, GainComponent):
        return {"gain": component.gain, "units": dict(component.units)}
    if isinstance(component, SumComponent):
        return {"sum": list(component.signs), **({} if component.unit is None else {"unit": component.unit})}
    if isinstance(component, BlockComponent):
        return {**block_table(component.block), **({"units": dict(component.units)} if component.units else {})}
    if not isinstance(component, LinearComponent):
        raise InputError(f"component {component.name} is a Python function or an FMU, which no such file can hold")
    return {
        **{key: getattr(component, key).tolist() for key in ("A", "B", "C", "D", "x0")},
        "dt": component.dt,
        "inputs": list(component.input_names),
        "outputs": list(component.output_names),
        "states": list(component.state_names),
        "units": dict(component.units),
    }


def block_variables(component: Component) -> tuple[Variable, ...]:
    """Return inputs and outputs of a component that is not an FMU."""
    if isinstance(component, LinearComponent):
        inputs, outputs = component.input_names, component.output_names
    elif isinstance(component, BlockComponent):
        inputs, outputs = component.block.inputs, ("y",)
    elif isinstance(component, SumComponent):
        inputs, outputs = tuple(f"u{k + 1}" for k in range(len(component.signs))), ("y",)
    else:
        inputs, outputs = ("u",), ("y",)
    return tuple(
        Variable(name=name, causality=causality)
        for causality, names in (("input", inputs), ("output", outputs))
        for name in names
    )

"""Parameters of blocks and gains by their full names, as if they were variables: limiter.rising, gain.gain."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from workbench.core.records.option import options_of
from workbench.core.records.parsing import from_toml
from workbench.errors import InputError, close_names
from workbench.fmi.variable import Value, Variable
from workbench.system.components import OpenComponent, Opened, block_part
from workbench.system.connection_checks import resolve
from workbench.system.description import BlockComponent, Component, FmuComponent, GainComponent, SystemDescription

__all__ = ["component_parameters", "reparametrised", "with_parameters", "with_values"]


def component_parameters(system: SystemDescription) -> tuple[Variable, ...]:
    """Return the numbers among the parameters of blocks and gains, by full name, as parameters of the system.

    Args:
        system: as it is written down.
    """
    return tuple(
        Variable(f"{component.name}.{name}", causality="parameter", variability="fixed", start=value, unit=unit or None)
        for component in system.components
        for name, (value, unit) in _parameters(component).items()
        if isinstance(value, float)
    )


def _parameters(component: Component) -> dict[str, tuple[Any, str]]:
    """Return name → value and unit."""
    if isinstance(component, GainComponent):
        return {"gain": (component.gain, "")}
    if not isinstance(component, BlockComponent):
        return {}
    block = component.block
    own = _variables(component)  # the y of a table is its output
    return {d.name: (getattr(block, d.name), d.option.unit) for d in options_of(type(block)) if d.name not in own}


def with_parameters(
    system: SystemDescription, values: Mapping[str, Value]
) -> tuple[SystemDescription, dict[str, Value]]:
    """Return a system whose blocks and gains have other parameters, and those values that are not of such.

    Args:
        system: as it is written down.
        values: full name → value; a text is read as in a system file.

    Raises:
        InputError: a value that the parameter cannot have; the message has the full name.
    """
    known = {f"{component.name}.{name}" for component in system.components for name in _parameters(component)}
    own = {name: value for name, value in values.items() if name in known}
    for name in values.keys() - own.keys():
        _check_close(system, name)
    if not own:
        return system, dict(values)
    components = tuple(_changed(component, own) for component in system.components)
    return replace(system, components=components), {n: v for n, v in values.items() if n not in own}


def with_values(system: SystemDescription, values: Mapping[str, Value]) -> SystemDescription:
    """Return a system whose blocks, gains and FMUs have other parameters.

    Args:
        system: as it is written down.
        values: full name → value.

    Raises:
        InputError: see `with_parameters`.
    """
    system, rest = with_parameters(system, values)

    def own(begin: str) -> dict[str, Value]:
        return {name.removeprefix(begin): value for name, value in rest.items() if name.startswith(begin)}

    components = tuple(
        replace(part, set={**part.set, **own(f"{part.name}.")}) if isinstance(part, FmuComponent) else part
        for part in system.components
    )
    return replace(system, components=components)


def _check_close(system: SystemDescription, name: str) -> None:
    """Refuse a name that is nearly that of a parameter, and not a variable of its component."""
    for component in system.components:
        local = name.removeprefix(f"{component.name}.")
        near = close_names(local, list(_parameters(component))) if local != name else []
        if near and local not in _variables(component):
            raise InputError(f"component {component.name}: '{local}' is not a parameter; did you mean {near[0]}?")


def _variables(component: Component) -> tuple[str, ...]:
    """Return inputs, outputs and states of a block or a gain."""
    block = component.block if isinstance(component, BlockComponent) else None
    return ("u", "y") if block is None else (*block.inputs, "y", *block.states, *block.remembers)


def reparametrised(opened: Opened, values: Mapping[str, Value]) -> tuple[Opened, dict[str, Value]]:
    """Return an opened system whose blocks and gains have other parameters, its FMUs the same, and the other values.

    Args:
        opened: it is returned itself where no value is of a block or a gain.
        values: see `with_parameters`.

    Raises:
        InputError: see `with_parameters`.
    """
    system, rest = with_parameters(opened.description, values)
    if system is opened.description:
        return opened, rest
    parts = tuple(_part(part, component) for part, component in zip(opened.parts, system.components, strict=True))
    return Opened(system, parts, resolve(system, [p.description.variables for p in parts])), rest


def _part(part: OpenComponent, component: Component) -> OpenComponent:
    return part if isinstance(component, FmuComponent) or component is part.component else block_part(component)


def _changed(component: Component, values: Mapping[str, Value]) -> Component:
    given = {
        name: _value(values[full]) for name in _parameters(component) if (full := f"{component.name}.{name}") in values
    }
    if not given:
        return component
    if isinstance(component, BlockComponent):
        return replace(component, parameters={**component.parameters, **given})
    if not isinstance(component, GainComponent) or not isinstance(given["gain"], int | float):
        raise InputError(f"{component.name}.gain: '{given['gain']}' is not a number")
    return replace(component, gain=float(given["gain"]))


def _value(value: Value) -> object:
    if not isinstance(value, str):
        return value
    try:
        return from_toml(f"value = {value}")["value"]
    except ValueError:
        return value

"""What a system says about itself: the variables of its components by full name, and its own inputs and outputs."""

from __future__ import annotations

from collections.abc import Sequence

from workbench.fmi.description import Capabilities, DefaultExperiment, ModelDescription
from workbench.fmi.variable import Variable
from workbench.system.components import OpenComponent
from workbench.system.composite import Ports
from workbench.system.description import Port, Resolved, SystemDescription
from workbench.system.feed_through import SystemDependencies, states_of

__all__ = ["joint_description", "joint_ports"]

_OWN = ("input", "output")  # causalities that only the system's own inputs and outputs keep


def joint_description(
    description: SystemDescription, parts: Sequence[OpenComponent], resolved: Resolved
) -> ModelDescription:
    """Return the system's description."""
    reach = SystemDependencies(parts, resolved)
    own = _own_variables(parts, resolved, reach)
    names = {v.name for v in own}
    numbered = [v._replace(value_reference=i, element=0) for i, v in enumerate(own)]
    inner = (
        _inner(p.name, v, _declared(reach, k, v))
        for k, p in enumerate(parts)
        for v in p.description.variables
        if f"{p.name}.{v.name}" not in names
    )
    numbered += [v._replace(value_reference=i, element=0) for i, v in enumerate(inner, start=len(own))]
    return ModelDescription(
        fmi_version="2.0",
        major=2,
        model_name=description.name,
        token="",
        generation_tool=None,
        description=None,
        interfaces={"me": _capabilities(parts)},
        platforms=(),
        experiment=_experiment(description, parts),
        variables=tuple(numbered),
        states=tuple(_inner(p.name, v) for p in parts for v in states_of(p)),
        derivatives=_derivatives(parts, reach),
        state_count=sum(p.description.state_count for p in parts),
        indicator_count=sum(p.description.indicator_count for p in parts),
        shapes={},
        log_categories=(),
        notes=(),
        has_history=any(p.description.has_history for p in parts),
        enumerations={f"{p.name}.{t}": items for p in parts for t, items in p.description.enumerations.items()},
    )


def joint_ports(parts: Sequence[OpenComponent], resolved: Resolved) -> Ports:
    """Return for each variable of the system the parts' variables that it stands for."""
    ports: dict[str, tuple[tuple[int, Variable], ...]] = {
        f"{part.name}.{v.name}": ((i, v),)
        for i, part in enumerate(parts)
        for v in (*part.description.derivatives, *part.description.states, *part.description.variables)
    }
    ports.update({name: tuple((p.component, p.variable) for p in result) for name, result in resolved.inputs.items()})
    ports.update({name: ((port.component, port.variable),) for name, port in resolved.outputs.items()})
    return ports


def _own_variables(parts: Sequence[OpenComponent], resolved: Resolved, reach: SystemDependencies) -> list[Variable]:
    inputs = [_own(parts, _strictest(ports), name) for name, ports in resolved.inputs.items()]
    outputs = [
        _own(parts, port, name)._replace(causality="output", dependencies=reach.of(port.component, port.variable))
        for name, port in resolved.outputs.items()
    ]
    return [*inputs, *outputs]


def _own(parts: Sequence[OpenComponent], port: Port, name: str) -> Variable:
    declared = _type_in(parts[port.component].name, port.variable)
    return port.variable._replace(name=name, declared_type=declared)


def _type_in(component: str, variable: Variable) -> str | None:
    """Return the name in the system of a variable's type: components may have several of one name."""
    return None if variable.declared_type is None else f"{component}.{variable.declared_type}"


def _strictest(ports: Sequence[Port]) -> Port:
    """Return the input that decides when a value may change: one that may do so at events only, if there is one."""
    return next((p for p in ports if not p.variable.is_continuous_input), ports[0])


def _inner(component: str, variable: Variable, depends: tuple[str, ...] | None = None) -> Variable:
    of = variable.derivative_of
    return variable._replace(
        name=f"{component}.{variable.name}",
        causality="local" if variable.causality in _OWN else variable.causality,
        derivative_of=None if of is None else f"{component}.{of}",
        dependencies=depends,
        alias_of=None,
        declared_type=_type_in(component, variable),
    )


def _declared(reach: SystemDependencies, component: int, variable: Variable) -> tuple[str, ...] | None:
    """Return what a variable depends on, where components declare that of variables of its kind."""
    says = variable.causality in _OWN or variable.derivative_of is not None
    return reach.of(component, variable) if says else None


def _derivatives(parts: Sequence[OpenComponent], reach: SystemDependencies) -> tuple[Variable, ...]:
    if any(len(p.description.derivatives) != p.description.state_count for p in parts):
        return ()
    return tuple(_inner(p.name, v, reach.of(k, v)) for k, p in enumerate(parts) for v in p.description.derivatives)


def _capabilities(parts: Sequence[OpenComponent]) -> Capabilities:
    claims = [p.description.interfaces[p.interface] for p in parts]
    return Capabilities(
        identifier="",
        state=all(c.state for c in claims),
        directional_derivatives=all(c.directional_derivatives for c in claims),
        completed_step=any(c.completed_step for c in claims),
        once_per_process=any(c.once_per_process for c in claims),
        needs_tool=any(c.needs_tool for c in claims),
    )


def _experiment(description: SystemDescription, parts: Sequence[OpenComponent]) -> DefaultExperiment:
    """Return what the file suggests; where it is silent, the longest and finest of the components' experiments."""
    given, inner = description.default_experiment, [p.description.experiment for p in parts]
    stops = [e.stop_time for e in inner if e.stop_time is not None]
    steps = [e.step for e in inner if e.step is not None]
    return DefaultExperiment(
        start_time=given.start_time,
        stop_time=given.stop_time if given.stop_time is not None else max(stops, default=None),
        tolerance=given.tolerance,
        step=given.step if given.step is not None else min(steps, default=None),
    )

"""A system opened at one of its components, and its linear model between inputs and outputs so made."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from workbench.errors import InputError, suggest
from workbench.model.base import Model
from workbench.model.described_model import DescribedModel
from workbench.point.lin.request import lin_result
from workbench.point.lin.result import LinResult
from workbench.system.description import Component, LinearComponent, SystemDescription
from workbench.system.model import SystemModel
from workbench.system.recipe import SystemRecipe

__all__ = ["Ports", "find_ports", "free_name", "linear_between", "recipe_of", "system_of", "without_block"]


_INTO = "opened"  # the second input of what stands in for a block


@dataclass(frozen=True)
class Ports:
    """Where the loop is cut.

    Attributes:
        component: name of the block's component.
        input: its input in the loop, without the component's name.
        output: its output in the loop.
    """

    component: str
    input: str
    output: str

    @property
    def v(self) -> str:
        """Full name of the block's input in the system."""
        return f"{self.component}.{self.input}"

    @property
    def w(self) -> str:
        """Full name of the block's output in the system."""
        return f"{self.component}.{self.output}"


def system_of(model: Model, what: str) -> SystemDescription:
    """Return the description of a system.

    Args:
        model: a system of model exchange parts.
        what: needs it; for the message.

    Raises:
        InputError: no such system.
    """
    if isinstance(model, SystemModel):
        return model.system
    if isinstance(getattr(model, "system", None), SystemDescription):
        raise InputError(
            f"{model.name} has co-simulation parts, but {what} the equations of all parts; {model.way_out()}"
        )
    raise InputError(f"{model.name}: this is not a system; {what} a system file or workbench.connect")


def recipe_of(model: DescribedModel) -> SystemRecipe:
    """Return how a system is made again.

    Raises:
        InputError: no system.
    """
    if not isinstance(model.recipe, SystemRecipe):
        raise InputError(f"{model.name}: this is not a system")
    return model.recipe


def find_ports(model: Model, component: str, *, needs: str = "limit cycles need") -> Ports:
    """Return the input and the output by which a component of a system is connected.

    Args:
        model: a system.
        component: name of the block's component.
        needs: what needs the system, for the message.

    Raises:
        InputError: no system, unknown component, or not exactly one input and one output connected.
    """
    system = system_of(model, needs)
    names = [c.name for c in system.components]
    if component not in names:
        raise InputError(f"{model.name}: there is no component '{component}'; {suggest(component, names)}")
    head = f"{component}."
    inputs = {c.destination.removeprefix(head) for c in system.connections if c.destination.startswith(head)}
    outputs = {c.source.removeprefix(head) for c in system.connections if c.source.startswith(head)}
    for what, result in (("input", inputs), ("output", outputs)):
        if len(result) != 1:
            listed = f" ({', '.join(sorted(result))})" if result else ""
            raise InputError(
                f"{model.name}: component {component} has {len(result)} connected {what}s{listed}, not one"
            )
    return Ports(component, inputs.pop(), outputs.pop())


def free_name(wanted: str, components: Iterable[Component]) -> str:
    """Return a name that no component has.

    Args:
        wanted: taken if it is free, else with a number.
        components: of the system.
    """
    taken = {c.name for c in components}
    return next(n for n in (wanted, *(f"{wanted}{k}" for k in range(2, len(taken) + 3))) if n not in taken)


def without_block(
    model: DescribedModel, system: SystemDescription, ports: Ports, opened: str, outputs: Mapping[str, str]
) -> SystemDescription:
    """Return a system with its block replaced by one whose output is a new input of the system, and new outputs.

    Args:
        model: as it was opened; it knows the units.
        system: of the model, or that changed elsewhere.
        ports: of the block.
        opened: name of the new input.
        outputs: of the system in place of its own, with the variables that they show.
    """
    units = {v.name: v.unit for v in model.description.variables}
    declared = {ports.input: units.get(ports.v), ports.output: units.get(ports.w), _INTO: units.get(ports.w)}
    stand_in = LinearComponent(
        name=ports.component,
        A=np.zeros((0, 0)),
        B=np.zeros((0, 2)),
        C=np.zeros((1, 0)),
        D=np.array([[0.0, 1.0]]),
        dt=0.0,
        input_names=(ports.input, _INTO),
        output_names=(ports.output,),
        state_names=(),
        x0=np.zeros(0),
        units={name: unit for name, unit in declared.items() if unit},
    )
    head = f"{ports.component}."
    others = {n: tuple(e for e in ends if not e.startswith(head)) for n, ends in system.inputs.items()}
    return replace(
        system,
        components=tuple(stand_in if c.name == ports.component else c for c in system.components),
        inputs={**{n: ends for n, ends in others.items() if ends}, opened: (head + _INTO,)},
        outputs=dict(outputs),
    )


def linear_between(
    model: DescribedModel,
    inputs: Mapping[str, float | None],
    outputs: Sequence[str],
    *,
    x: Mapping[str, float],
    u: Mapping[str, float],
    time: float,
    method: str = "auto",
    in_process: bool = False,
) -> LinResult:
    """Return the linear model between inputs and outputs of a changed system.

    Args:
        model: the changed system; it stays open.
        inputs: those of the linear model, with their values; None: that of the operating point.
        outputs: of the linear model.
        x: operating point: values of states and discrete states; what the system has not is left out.
        u: values of inputs, likewise.
        time: session time [s].
        method: of `lin`.
        in_process: of `lin`.

    Raises:
        InputError, FmuError, SimulationError: see `lin`.
    """
    variables = {v.name for v in (*model.states, *model.description.variables)}
    given = {**{v.name: u[v.name] for v in model.inputs if v.name in u}, **inputs}
    return lin_result(
        model,
        x0={n: value for n, value in x.items() if n in variables},
        u0={n: value for n, value in given.items() if value is not None},
        inputs=list(inputs),
        outputs=list(outputs),
        time=time,
        method=method,
        in_process=in_process,
    )

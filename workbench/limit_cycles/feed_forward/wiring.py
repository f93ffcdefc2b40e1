"""The system with its block taken out, and with feedback, filter and actuator put in."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from workbench.core.values.linear import LinearPart
from workbench.core.values.operating_point import OperatingPoint
from workbench.errors import InputError, suggest
from workbench.fmi.variable import Variable
from workbench.limit_cycles.feedback.actuator import ends_of
from workbench.loops.opened_system import Ports, recipe_of, system_of, without_block
from workbench.model.described_model import DescribedModel
from workbench.system.description import (
    Component,
    Connection,
    FmuComponent,
    GainComponent,
    LinearComponent,
    SumComponent,
    SystemDescription,
)

__all__ = ["SECOND", "Loops", "closed", "opened", "reopen", "variable_of"]

OPENED, COMMAND, SECOND = "opened", "commanded", "commanded_second"
_NEEDS = "feed-forward needs"


@dataclass(frozen=True, kw_only=True)
class Loops:
    """What is connected to what.

    Attributes:
        ports: of the block.
        target: full name of the control input.
        source: full name of the variable that is fed back; None: no feedback.
        gain: of the feedback.
        actuator: file of a model with one input and one output in front of the target; None: none.
        closes_at: time at which feedback and filter are connected [s].
        second: full name of a control input that shares the filter's output; None: none.
        weights: shares of the target and of the second input.
    """

    ports: Ports
    target: str
    source: str | None = None
    gain: float = 0.0
    actuator: str | None = None
    closes_at: float | None = None
    second: str | None = None
    weights: tuple[float, float] = (1.0, 0.0)


def variable_of(model: DescribedModel, name: str, what: str) -> Variable:
    """Return a variable of a component by its full name.

    Args:
        model: the system.
        name: "component.variable".
        what: it is for, in messages.

    Raises:
        InputError: unknown name.
    """
    known = {v.name: v for v in model.description.variables}
    if name not in known or "." not in name:
        dotted = [n for n in known if "." in n]
        raise InputError(f"{model.name}: {what} '{name}' is not a variable of a component; {suggest(name, dotted)}")
    return known[name]


def opened(model: DescribedModel, loops: Loops) -> SystemDescription:
    """Return the system whose block shows a new input instead of its own output, with the target free.

    Args:
        model: the system.
        loops: block, target and fed-back variable.

    Raises:
        InputError: the target is driven already.
    """
    system = _all_freed(model, loops)
    outputs = {"seen": loops.ports.v, **({"fed_back": loops.source} if loops.source else {})}
    result = without_block(model, system, loops.ports, OPENED, outputs)
    second = {SECOND: (loops.second,)} if loops.second is not None else {}
    return replace(result, inputs={**result.inputs, COMMAND: (loops.target,), **second})


def closed(model: DescribedModel, loops: Loops, part: LinearPart | None) -> SystemDescription:
    """Return the system with the feedback and a filter of the block's output, both into the target.

    The components put in are `feedback`, `feedforward`, `command` (their sum) and `actuator`; where a second input
    shares the filter, `share` in front of it.

    Args:
        model: the system.
        loops: what is connected to what.
        part: the filter; None: feedback alone.

    Raises:
        InputError: the target is driven already, a name is taken, the actuator has not one input and one output.
    """
    system = _all_freed(model, loops)
    units = {v.name: v.unit for v in model.description.variables}
    unit, ends = units.get(loops.target), _Connections(loops.closes_at)
    made: list[Component] = []
    if loops.source is not None:
        named = _units(u=units.get(loops.source), y=unit)
        made.append(GainComponent(name="feedback", gain=loops.gain, units=named))
        ends.join(loops.source, "feedback.u")
    if part is not None:
        made.append(_filter(part, _units(u=units.get(loops.ports.w), y=unit)))
        ends.join(loops.ports.w, "feedforward.u", late=True)
    summands = [f"{c.name}.y" for c in made]
    share = loops.weights[0]
    signs = tuple(share if name == "feedforward.y" else 1.0 for name in summands) or (1.0,)
    command = SumComponent(name="command", signs=signs, unit=unit)
    for k, name in enumerate(summands):
        ends.join(name, f"command.u{k + 1}")
    made.append(command)
    _drive(loops, made, ends)
    if loops.second is not None and part is not None:
        named = _units(u=unit, y=units.get(loops.second))
        made.append(GainComponent(name="share", gain=loops.weights[1], units=named))
        ends.join("feedforward.y", "share.u")
        ends.join("share.y", loops.second, late=True)
    _check_free(system, made)
    return replace(system, components=(*system.components, *made), connections=(*system.connections, *ends.all))


def reopen(model: DescribedModel, system: SystemDescription) -> DescribedModel:
    """Open a changed system as the model was opened; the caller closes it.

    Args:
        model: as it is.
        system: as it shall be.
    """
    recipe = recipe_of(model)
    at = None if recipe.at is None else _kept(recipe.at, recipe.still_in(system), system.inputs)
    return replace(recipe.changed(system), at=at).open()


def _kept(point: OperatingPoint, components: Collection[str], inputs: Collection[str]) -> OperatingPoint:
    """Return what of an operating point a changed system has, at time 0, where its runs begin."""
    x, discrete = (
        {name: value for name, value in values.items() if name.partition(".")[0] in components}
        for values in (point.x, point.discrete)
    )
    return OperatingPoint(x=x, u={n: u for n, u in point.u.items() if n in inputs}, discrete=discrete)


class _Connections:
    """Connections to be made; those that carry the control close late."""

    def __init__(self, closes_at: float | None) -> None:
        self.closes_at = closes_at
        self.all: list[Connection] = []

    def join(self, source: str, destination: str, *, late: bool = False) -> None:
        """Connect two variables."""
        when = self.closes_at if late else None
        self.all.append(Connection(source=source, destination=destination, closes_at=when))


def _drive(loops: Loops, made: list[Component], ends: _Connections) -> None:
    """Connect the command to the target, through the actuator if there is one."""
    if loops.actuator is None:
        ends.join("command.y", loops.target, late=True)
        return
    into, out, _ = ends_of(loops.actuator)
    made.append(FmuComponent(name="actuator", file=loops.actuator))
    ends.join("command.y", f"actuator.{into}", late=True)
    ends.join(f"actuator.{out}", loops.target)


def _filter(part: LinearPart, units: Mapping[str, str]) -> LinearComponent:
    n = len(part.A)
    return LinearComponent(
        name="feedforward", A=part.A, B=part.B, C=part.C, D=part.D, dt=0.0,
        input_names=("u",), output_names=("y",), state_names=tuple(f"x{k + 1}" for k in range(n)), x0=np.zeros(n),
        units=units,
    )  # fmt: skip


def _units(**units: str | None) -> dict[str, str]:
    return {name: unit for name, unit in units.items() if unit}


def _all_freed(model: DescribedModel, loops: Loops) -> SystemDescription:
    """Return the system with the target, and the second input where there is one, driven by nothing."""
    system = _freed(system_of(model, _NEEDS), loops.target)
    return system if loops.second is None else _freed(system, loops.second)


def _freed(system: SystemDescription, target: str) -> SystemDescription:
    """Return the system with the target driven by nothing."""
    source = next((c.source for c in system.connections if c.destination == target), None)
    if source is not None:
        raise InputError(f"{system.name}: {target} is driven by {source}; feed-forward needs a target that is free")
    inputs = {name: left for name, ends in system.inputs.items() if (left := _without(ends, target))}
    return replace(system, inputs=inputs)


def _without(ends: Sequence[str], head: str) -> tuple[str, ...]:
    return tuple(e for e in ends if not e.startswith(head))


def _check_free(system: SystemDescription, made: Sequence[Component]) -> None:
    taken = {c.name for c in system.components} & {c.name for c in made}
    if taken:
        raise InputError(f"{system.name}: the name '{taken.pop()}' is needed for a part of the control, but is taken")

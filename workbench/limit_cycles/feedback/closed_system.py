"""Where a feedback or a filter takes and acts, the system described with it, and its linear model."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from workbench.core.records.names_in_text import check_names
from workbench.core.values.linear import LinearPart
from workbench.core.values.operating_point import OperatingPoint
from workbench.errors import InputError, article, suggest
from workbench.fmi.variable import FLOAT_TYPES, Variable
from workbench.limit_cycles.feedback.actuator import Actuator
from workbench.loops.opened_system import Ports, free_name, linear_between, without_block
from workbench.model.base import Model
from workbench.model.described_model import DescribedModel
from workbench.model.load import FmuModel
from workbench.point.lin.result import LinResult
from workbench.system.components import open_parts
from workbench.system.connection_units import declared_unit
from workbench.system.description import (
    Component,
    Connection,
    FmuComponent,
    GainComponent,
    LinearComponent,
    SumComponent,
    SystemDescription,
)
from workbench.system.openable import OpenableSystem
from workbench.system.recipe import SystemRecipe

__all__ = ["SEEN", "ControlLaw", "FeedbackPath", "find_place"]

SEEN = "feedback.seen"  # output of the opened system
_INJECTED, _RETURNED = "feedback.block_output", "feedback.block_input"
_DRIVE = "feedback.drive"  # its input; of a second target with a 2 behind
_PARTS = ("feedback", "feedforward", "command", "share")
_PLANT = "model"  # the component's name where the model is one FMU


@dataclass(frozen=True, eq=False, kw_only=True)
class ControlLaw:
    """What is to be inserted.

    Attributes:
        gain: g of the feedback.
        y0: of the source at the operating point; what is fed back is the deviation from it.
        filter: its output is added to the feedback; None: there is none.
        filtered: full name of the variable that the filter takes.
        shares: of the filter's output that go to the target and to the second one.
        actuator: in front of the target; None: none.
        closes_at: [s]; None: closed always.
    """

    gain: float
    y0: float = 0.0
    filter: LinearPart | None = None
    filtered: str = ""
    shares: tuple[float, float] = (1.0, 0.0)
    actuator: Actuator | None = None
    closes_at: float | None = None


@dataclass(frozen=True, eq=False)
class FeedbackPath:
    """A system, a variable that is fed back, and an input that it acts on.

    Attributes:
        model: the system, or one FMU; it stays open.
        recipe: of the system; one FMU becomes a system of one component.
        source: full name of the variable in the system.
        target: full name of the input in the system.
        source_unit, target_unit: None where none is declared.
        shown: what the user calls source and target.
        u0: of the target where nothing else drives it.
        second: from the same variable to a second input, which shares a filter; None: there is none.
    """

    model: DescribedModel
    recipe: SystemRecipe
    source: str
    target: str
    source_unit: str | None
    target_unit: str | None
    shown: tuple[str, str]
    u0: float = 0.0
    second: FeedbackPath | None = None

    def inner(self, name: str) -> str:
        """Return the full name in the system of a variable that the user names.

        Args:
            name: as in the model.

        Raises:
            InputError: unknown; near names are in the message.
        """
        variables = self.model.description.variables
        if not any(v.name == name for v in variables):
            near = [v.name for v in variables if v.causality != "parameter" and "[" not in v.name]
            raise InputError(f"{self.model.name}: variable '{name}' is unknown; {suggest(name, near)}")
        return self.full(name)

    def full(self, name: str) -> str:
        """Return the full name in the system of a variable of the model.

        Args:
            name: in the model.
        """
        return name if isinstance(self.model.recipe, SystemRecipe) else f"{_PLANT}.{name}"

    def outer(self, name: str) -> str:
        """Return the name in the model of a variable of the system.

        Args:
            name: full name in the system.
        """
        return name if isinstance(self.model.recipe, SystemRecipe) else name.removeprefix(f"{_PLANT}.")

    def inputs(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return values by the names that inputs of the model have in the systems with a control.

        A system's input may have the name of the target, which is then driven by a sum.

        Args:
            values: by input of the model.
        """
        named = {self._beside(n): v for n, v in values.items()}
        return named if self.second is None else self.second.inputs(named)

    def _beside(self, name: str) -> str:
        return f"{name}.other" if name == self.target else name

    def start_values(self, values: Mapping[str, float]) -> dict[str, float]:
        """Return states and inputs of the model by the names that they have in the systems with a control.

        Args:
            values: by the model's names.
        """
        inputs = {v.name for v in self.model.inputs}
        return {
            **{self.full(n): v for n, v in values.items()},
            **self.inputs({n: v for n, v in values.items() if n in inputs}),
        }

    def opened(self, system: SystemDescription, at: OperatingPoint | None = None) -> DescribedModel:
        """Open a system with a control; the caller closes it before `model`.

        Args:
            system: from `driven` or `closed`.
            at: where its sessions start, by the model's names; None: at its own start.
        """
        recipe = replace(self.recipe, bias=self.inputs(self.recipe.bias)).changed(system)
        point = at and OperatingPoint(x=at.x, u=self.inputs(at.u), discrete=at.discrete)
        return replace(recipe, at=point).open()

    def driven(self, system: SystemDescription, drive: str, actuator: Actuator | None = None) -> SystemDescription:
        """Return a system with the target also driven by a new input, and the source shown as `SEEN`.

        Args:
            system: without a control.
            drive: name of that input.
            actuator: between that input and the target.
        """
        name = free_name(drive.replace(".", "_"), system.components)
        base = replace(
            system,
            components=(*system.components, GainComponent(name=name)),
            inputs={**system.inputs, drive: (f"{name}.u",)},
            outputs={**system.outputs, SEEN: self.source},
        )
        return self._acting(base, f"{name}.y", actuator)

    def closed(self, law: ControlLaw) -> tuple[SystemDescription, str]:
        """Return the system with a control in it, and the full name of what it hands to the target.

        The components put in are `feedback`, `feedforward`, their sum `command`, the actuator, and `share` in front of
        a second target, each with a number behind it where its name is taken.

        Args:
            law: the control.
        """
        base = self.recipe.system
        gain, filter_, both, share = (free_name(n, base.components) for n in _PARTS)
        handed = f"{gain}.y"
        made: list[Component] = [GainComponent(name=gain, gain=law.gain)]
        ways = [_wire(self.source, f"{gain}.u", offset=-law.y0, closes_at=law.closes_at)]
        if law.filter is not None:
            made += [_component(filter_, law.filter), SumComponent(name=both, signs=(1.0, law.shares[0]))]
            ways.append(_wire(law.filtered, f"{filter_}.u", closes_at=law.closes_at))
            ways += [_wire(handed, f"{both}.u1"), _wire(f"{filter_}.y", f"{both}.u2")]
            handed = f"{both}.y"
        base = replace(base, components=(*base.components, *made), connections=(*base.connections, *ways))
        if law.filter is not None and self.second is not None:
            base = replace(base, components=(*base.components, GainComponent(name=share, gain=law.shares[1])))
            base = replace(base, connections=(*base.connections, _wire(f"{filter_}.y", f"{share}.u")))
            base = self.second._acting(base, f"{share}.y", None)  # noqa: SLF001 - of its own kind
        result = self._acting(base, handed, law.actuator)
        if law.actuator is not None:
            handed = f"{free_name(law.actuator.component.name, base.components)}.{law.actuator.output}"
        return result, handed

    def _acting(self, base: SystemDescription, source: str, actuator: Actuator | None) -> SystemDescription:
        """Return the system with the target driven by a source, through an actuator if there is one."""
        if actuator is None:
            return self._joined(base, source, 1.0)
        part = replace(actuator.component, name=free_name(actuator.component.name, base.components))
        into = _wire(source, f"{part.name}.{actuator.input}", gain=1.0 / actuator.scale)
        base = replace(base, components=(*base.components, part), connections=(*base.connections, into))
        return self._joined(base, f"{part.name}.{actuator.output}", actuator.scale)

    def _joined(self, base: SystemDescription, source: str, scale: float) -> SystemDescription:
        """Return the system with the target driven by a source, added to what drives it already."""
        before = next((c for c in base.connections if c.destination == self.target), None)
        forced = next((n for n, ends in base.inputs.items() if self.target in ends), None)
        if before is None and forced is None:
            return replace(
                base, connections=(*base.connections, _wire(source, self.target, gain=scale, offset=self.u0))
            )
        name = free_name("feedback_sum", base.components)
        ways = [c for c in base.connections if c is not before]
        inputs = dict(base.inputs)
        if before is not None:
            ways.append(replace(before, destination=f"{name}.u1"))
        elif forced is not None:
            ends = tuple(f"{name}.u1" if e == self.target else e for e in inputs.pop(forced))
            inputs[self._beside(forced)] = ends
        ways += [
            _wire(source, f"{name}.u2", gain=scale),
            Connection(source=f"{name}.y", destination=self.target),
        ]
        both = SumComponent(name=name, unit=self.target_unit)
        return replace(base, components=(*base.components, both), connections=tuple(ways), inputs=inputs)

    # -- linear models -----------------------------------------------------------------------------

    def linear(
        self, point: OperatingPoint, *, time: float, actuator: Actuator | None = None, method: str = "auto"
    ) -> LinResult:
        """Linearise from the target to the source, `SEEN`.

        Args:
            point: by the model's names; what it leaves out is as it starts.
            time: session time [s].
            actuator: before the target.
            method: of `lin`.

        Raises:
            InputError: `lin` refuses.
            FmuError, SimulationError: a part cannot be opened or evaluated.
        """
        driven = self.driven(self.recipe.system, _DRIVE, actuator)
        return self._linearised(driven, {_DRIVE: 0.0}, (SEEN,), point, time, method)

    def two_ports(
        self, ports: Ports, point: OperatingPoint, *, time: float, actuator: Actuator | None = None
    ) -> LinResult:
        """Linearise from a block's output, the target and the second target to the block's input and the source.

        Args:
            ports: of the block, which is taken out.
            point: by the model's names; what it leaves out is as it starts.
            time: session time [s].
            actuator: before the target.

        Raises:
            InputError, FmuError, SimulationError: see `linear`.
        """
        with self.model.open_at(time=time, values={**point.x, **point.u}) as session:
            inputs = {_INJECTED: session.values([ports.w])[ports.w], _DRIVE: 0.0}
        opened = without_block(self.model, self.recipe.system, ports, _INJECTED, {_RETURNED: ports.v})
        opened = self.driven(opened, _DRIVE, actuator)
        if self.second is not None:
            opened, inputs = self.second.driven(opened, f"{_DRIVE}2"), {**inputs, f"{_DRIVE}2": 0.0}
        return self._linearised(opened, inputs, (_RETURNED, SEEN), point, time)

    def _linearised(  # noqa: PLR0917 - what is opened, and where
        self,
        system: SystemDescription,
        inputs: Mapping[str, float],
        outputs: tuple[str, ...],
        point: OperatingPoint,
        time: float,
        method: str = "auto",
    ) -> LinResult:
        x = {self.full(n): v for n, v in {**point.x, **point.discrete}.items()}
        with self.opened(system) as opened:
            return linear_between(opened, inputs, outputs, x=x, u=self.inputs(point.u), time=time, method=method)


def _wire(
    source: str, destination: str, *, gain: float = 1.0, offset: float = 0.0, closes_at: float | None = None
) -> Connection:
    return Connection(
        source=source, destination=destination, gain=gain, offset=offset, convert=False, closes_at=closes_at
    )


def _component(name: str, part: LinearPart) -> LinearComponent:
    n = len(part.A)
    return LinearComponent(
        name=name, A=part.A, B=part.B, C=part.C, D=part.D, dt=0.0, input_names=("u",), output_names=("y",),
        state_names=tuple(f"x{k + 1}" for k in range(n)), x0=np.zeros(n),
    )  # fmt: skip


def find_place(model: Model, source: str, target: str, second: str | None = None) -> FeedbackPath:
    """Return where a control leaves and enters a model.

    Args:
        model: a system or one FMU.
        source: an output, "component.variable" or a name of the system's outputs; of one FMU its plain name.
        target: an input of a component or of the system, likewise.
        second: another such input; None: there is none.

    Raises:
        InputError: unknown names, an input as source, an output as target, no real numbers.
    """
    if not isinstance(model, DescribedModel):
        raise InputError(f"{model.name}: feedback needs a system or an FMU as wb.load or wb.connect give them")
    recipe = _as_system(model)
    table = _variables(recipe)
    taken, acted = (_found(model, table, recipe.system, n, r) for n, r in ((source, "source"), (target, "target")))
    with model.open_session() as session:
        u0 = session.values([target])[target]
    other = None if second is None else find_place(model, source, second)
    units = [table[n].unit or None for n in (taken, acted)]
    return FeedbackPath(model, recipe, taken, acted, units[0], units[1], (source, target), u0, other)


def _variables(recipe: SystemRecipe) -> dict[str, Variable]:
    """Return all variables of the components by full name, with the causality that they have in their component."""
    with ExitStack() as undo:
        parts = open_parts(recipe.system.components, undo, recipe.parts, interface=recipe.interface)
        return {
            f"{p.name}.{v.name}": v._replace(unit=declared_unit(p.component, v))
            for p in parts
            for v in p.description.variables
        }


def _found(
    model: DescribedModel, table: Mapping[str, Variable], system: SystemDescription, name: str, role: str
) -> str:
    """Return the full name of a component's output (as source) or input (as target) that the user names."""
    wanted = "output" if role == "source" else "input"
    single = not isinstance(model.recipe, SystemRecipe)
    own = {n: (v,) for n, v in system.outputs.items()} if role == "source" else dict(system.inputs)
    if single:
        own = {n.removeprefix(f"{_PLANT}."): (n,) for n in table}
    full = own.get(name, (name,))
    if len(full) != 1:
        raise InputError(
            f"{model.name}: {name} drives several inputs ({', '.join(full)}); name one of them, or let a gain of 1 "
            "drive them and name its input"
        )
    result = table.get(full[0])
    if result is not None and result.type not in FLOAT_TYPES:
        raise InputError(f"{role}: '{name}' of {model.name} is {article(result.type)}, not a real number")
    if result is None or result.causality != wanted:
        usable = [n for n, v in table.items() if v.causality == wanted and v.type in FLOAT_TYPES]
        known = [n.removeprefix(f"{_PLANT}.") for n in usable] if single else [*own, *usable]
        shown = result is not None and result.causality in {"input", "output", "parameter"}
        others = {} if result is None else {name: result.causality if shown else "local variable"}
        check_names([name], known, kinds=(wanted,), what=role, model=model.name, others=others)
    return full[0]


def _as_system(model: DescribedModel) -> SystemRecipe:
    """Return a model's recipe as that of a system."""
    recipe = model.recipe
    if isinstance(recipe, SystemRecipe):
        return recipe
    if not isinstance(model, FmuModel):
        raise InputError(f"{model.name}: this kind of model cannot be put into a feedback loop")
    recipe = model.recipe
    component = FmuComponent(
        name=_PLANT,
        file=recipe.file or recipe.source,
        interface=model.interface,
        set=recipe.start_values,
        step=recipe.step,
        solver=recipe.solver,
        called=recipe.source if recipe.file else "",
    )
    inputs = {v.name: (f"{_PLANT}.{v.name}",) for v in model.inputs if v.is_number}
    system = SystemDescription(name=model.name, components=(component,), inputs=inputs)
    part = replace(model.recipe, start_values=recipe.start_values, bias={}, at=None)
    return OpenableSystem(
        source=recipe.source,
        system=system,
        solver=recipe.solver,
        tolerance=recipe.tolerance,
        step=recipe.step,
        bias=recipe.bias,
        parts={_PLANT: part},
    )

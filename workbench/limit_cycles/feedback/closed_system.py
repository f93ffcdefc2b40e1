"""Where a feedback is taken and where it acts, and the system described with it."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass, replace
from typing import Any

from workbench.core.records.names_in_text import check_names
from workbench.errors import InputError, article, suggest
from workbench.fmi.variable import FLOAT_TYPES, Variable
from workbench.limit_cycles.feedback.actuator import Actuator
from workbench.loops.opened_system import free_name
from workbench.model.base import Model
from workbench.model.described_model import DescribedModel
from workbench.model.load import FmuModel
from workbench.system.components import open_parts
from workbench.system.connection_units import declared_unit
from workbench.system.description import Connection, FmuComponent, GainComponent, SumComponent, SystemDescription
from workbench.system.openable import OpenableSystem
from workbench.system.recipe import SystemRecipe

__all__ = ["DRIVE", "SEEN", "FeedbackPath", "FeedbackSpec", "find_place"]

DRIVE = "feedback.drive"  # input of the opened system
SEEN = "feedback.seen"  # its output
_OTHER = "feedback.other"  # input that drives the target besides
LAW = "feedback"  # the component that holds the gain, where its name is free
_PLANT = "model"  # the component's name where the model is one FMU


@dataclass(frozen=True, eq=False)
class FeedbackSpec:
    """A feedback that is to be inserted.

    Attributes:
        gain: g.
        y0: of the source at the operating point; what is fed back is the deviation from it.
        actuator: between gain and target; None: none.
        closes_at: [s]; None: closed always.
    """

    gain: float
    y0: float = 0.0
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
    """

    model: DescribedModel
    recipe: SystemRecipe
    source: str
    target: str
    source_unit: str | None
    target_unit: str | None
    shown: tuple[str, str]
    u0: float = 0.0

    @property
    def system(self) -> SystemDescription:
        """As it is written down, without the feedback."""
        return self.recipe.system

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
        if isinstance(self.model.recipe, SystemRecipe):
            return name
        return f"{_PLANT}.{name}"

    def outer(self, name: str) -> str:
        """Return the name in the model of a variable of the system.

        Args:
            name: full name in the system.
        """
        return name if isinstance(self.model.recipe, SystemRecipe) else name.removeprefix(f"{_PLANT}.")

    def inputs(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return values by the names that inputs of the model have in the systems with feedback.

        A system's input may have the name of the target, which is then driven by a sum.

        Args:
            values: by input of the model.
        """
        return {self._input(n): v for n, v in values.items()}

    def start_values(self, values: Mapping[str, float]) -> dict[str, float]:
        """Return states and inputs of the model by the names that they have in the systems with feedback.

        Args:
            values: by the model's names.
        """
        inputs = {v.name for v in self.model.inputs}
        return {
            **{self.full(n): v for n, v in values.items()},
            **self.inputs({n: v for n, v in values.items() if n in inputs}),
        }

    def _input(self, name: str) -> str:
        return _OTHER if name == self.target else name

    def opened(self, system: SystemDescription | None = None) -> DescribedModel:
        """Open the system; the caller closes it before `model`.

        Args:
            system: a changed one; None: as it is.
        """
        return replace(self.recipe, bias=self.inputs(self.recipe.bias)).changed(system or self.system).open()

    def driven(self, system: SystemDescription | None = None, *, actuator: Actuator | None = None) -> SystemDescription:
        """Return the system with the target also driven by an input `DRIVE`, and the source shown as `SEEN`.

        Args:
            system: in place of the one that is written down.
            actuator: between that input and the target.
        """
        base = system or self.system
        name = free_name("feedback_drive", base.components)
        base = replace(
            base,
            components=(*base.components, GainComponent(name=name)),
            inputs={**base.inputs, DRIVE: (f"{name}.u",)},
            outputs={**base.outputs, SEEN: self.source},
        )
        return self._acting(base, f"{name}.y", actuator)

    def closed(self, wish: FeedbackSpec) -> SystemDescription:
        """Return the system with the feedback in it.

        Args:
            wish: the feedback.
        """
        base = self.system
        name = free_name(LAW, base.components)
        law = GainComponent(name=name, gain=wish.gain)
        lead = Connection(
            source=self.source, destination=f"{name}.u", offset=-wish.y0, convert=False, closes_at=wish.closes_at
        )
        base = replace(base, components=(*base.components, law), connections=(*base.connections, lead))
        return self._acting(base, f"{name}.y", wish.actuator)

    def command(self, wish: FeedbackSpec) -> tuple[str, str, float]:
        """Return the names of what the gain commands and of what is handed to the target, and the scale of the latter.

        Args:
            wish: the feedback.
        """
        command = f"{free_name(LAW, self.system.components)}.y"
        if wish.actuator is None:
            return command, command, 1.0
        name = free_name(wish.actuator.component.name, self.system.components)
        return command, f"{name}.{wish.actuator.output}", wish.actuator.scale

    def _acting(self, base: SystemDescription, source: str, actuator: Actuator | None) -> SystemDescription:
        """Return the system with the target driven by a source, through an actuator if there is one."""
        if actuator is None:
            return self._joined(base, source, 1.0)
        part = replace(actuator.component, name=free_name(actuator.component.name, self.system.components))
        into = Connection(
            source=source, destination=f"{part.name}.{actuator.input}", gain=1.0 / actuator.scale, convert=False
        )
        base = replace(base, components=(*base.components, part), connections=(*base.connections, into))
        return self._joined(base, f"{part.name}.{actuator.output}", actuator.scale)

    def _joined(self, base: SystemDescription, source: str, scale: float) -> SystemDescription:
        """Return the system with the target driven by a source, added to what drives it already."""
        wire = Connection(source=source, destination=self.target, gain=scale, convert=False)
        before = next((c for c in base.connections if c.destination == self.target), None)
        forced = next((n for n, ends in base.inputs.items() if self.target in ends), None)
        if before is None and forced is None:
            return replace(base, connections=(*base.connections, replace(wire, offset=self.u0)))
        name = free_name("feedback_sum", base.components)
        both = SumComponent(name=name, unit=self.target_unit)
        ways: list[Connection] = [c for c in base.connections if c is not before]
        inputs = dict(base.inputs)
        if before is not None:
            ways.append(replace(before, destination=f"{name}.u1"))
        elif forced is not None:
            ends = tuple(f"{name}.u1" if e == self.target else e for e in inputs.pop(forced))
            inputs[self._input(forced)] = ends
        ways += [
            replace(wire, destination=f"{name}.u2"),
            Connection(source=f"{name}.y", destination=self.target),
        ]
        return replace(base, components=(*base.components, both), connections=tuple(ways), inputs=inputs)


def find_place(model: Model, source: str, target: str) -> FeedbackPath:
    """Return where a feedback leaves and enters a model.

    Args:
        model: a system or one FMU.
        source: an output, "component.variable" or a name of the system's outputs; of one FMU its plain name.
        target: an input of a component or of the system, likewise.

    Raises:
        InputError: unknown names, an input as source, an output as target, no real numbers.
    """
    if not isinstance(model, DescribedModel):
        raise InputError(f"{model.name}: feedback needs a system or an FMU as wb.load or wb.connect give them")
    recipe = _as_system(model)
    single = not isinstance(model.recipe, SystemRecipe)
    table = _variables(recipe)
    taken = _found(model, table, recipe.system, source, role="source", single=single)
    acted = _found(model, table, recipe.system, target, role="target", single=single)
    units = tuple(table[n].unit or None for n in (taken, acted))
    return FeedbackPath(model, recipe, taken, acted, units[0], units[1], (source, target), _undriven(model, target))


def _variables(recipe: SystemRecipe) -> dict[str, Variable]:
    """Return all variables of the components by full name, with the causality that they have in their component."""
    with ExitStack() as undo:
        parts = open_parts(recipe.system.components, undo, recipe.parts, interface=recipe.interface)
        result = {f"{p.name}.{v.name}": (p, v) for p in parts for v in p.description.variables}
        return {n: v._replace(unit=declared_unit(p.component, v)) for n, (p, v) in result.items()}


def _undriven(model: DescribedModel, target: str) -> float:
    with model.open_session() as session:
        return session.values([target])[target]


def _found(
    model: Model,
    table: Mapping[str, Variable],
    system: SystemDescription,
    name: str,
    *,
    role: str,
    single: bool,
) -> str:
    """Return the full name of a component's output (as source) or input (as target) that the user names."""
    wanted = "output" if role == "source" else "input"
    own = {n: (v,) for n, v in system.outputs.items()} if role == "source" else dict(system.inputs)
    if single:
        own = {v.name.removeprefix(f"{_PLANT}."): (n,) for n, v in _named(table).items()}
    full = own.get(name, (name,))
    if len(full) != 1:
        raise InputError(
            f"{model.name}: {name} drives several inputs ({', '.join(full)}); name one of them, or let a gain of 1 "
            "drive them and name its input"
        )
    usable = [n for n, v in table.items() if v.causality == wanted and v.type in FLOAT_TYPES]
    known = [n.removeprefix(f"{_PLANT}.") for n in usable] if single else [*own, *usable]
    if full[0] in table and table[full[0]].type not in FLOAT_TYPES:
        raise InputError(f"{role}: '{name}' of {model.name} is {article(table[full[0]].type)}, not a real number")
    if full[0] not in usable:
        others = {name: _kind(table[full[0]])} if full[0] in table else {}
        check_names([name], known, kinds=(wanted,), what=role, model=model.name, others=others)
    return full[0]


def _named(table: Mapping[str, Variable]) -> dict[str, Variable]:
    return {n: v._replace(name=n) for n, v in table.items()}


def _kind(variable: Variable) -> str:
    return variable.causality if variable.causality in ("input", "output", "parameter") else "local variable"


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

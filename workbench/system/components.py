"""The components of a system, opened: what each says about itself, and how to make an instance of it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace

from workbench.core.values.calendar import Sampler, exact
from workbench.errors import FmuError, InputError
from workbench.fmi.description import ModelDescription
from workbench.fmi.instance import Instance
from workbench.fmi.structure import STRUCTURAL
from workbench.fmi.variable import Value, Variable
from workbench.model.base import DeclaredRates
from workbench.model.described_model import DescribedModel
from workbench.model.load import FmuRecipe, load_fmu, silent_clocks
from workbench.model.loading import Loading
from workbench.model.starts import check_starts
from workbench.system.blocks import BlockInstance, NativeComponent, block_description
from workbench.system.description import (
    BlockComponent,
    Component,
    FmuComponent,
    FunctionComponent,
    LinearComponent,
    Resolved,
    SystemDescription,
)
from workbench.system.elements import ElementInstance, element_description

__all__ = [
    "OpenComponent",
    "Opened",
    "block_part",
    "circle_notes",
    "declared_rates",
    "open_parts",
    "starts_of",
    "system_starts",
]


@dataclass(frozen=True, eq=False)
class OpenComponent:
    """One component, opened.

    Attributes:
        component: as it is written down.
        description: its variables; start values and units as the system sets them.
        interface: "me" or "cs".
        starts: start values that the system sets, by the component's names.
        notes: remarks for the user.
        model: the FMU; None for blocks.
        make: returns a new instance.
    """

    component: Component
    description: ModelDescription
    interface: str
    starts: Mapping[str, Value]
    notes: tuple[str, ...]
    model: DescribedModel | None
    make: Callable[[], Instance]

    @property
    def name(self) -> str:
        """The component's."""
        return self.component.name

    @property
    def recipe(self) -> FmuRecipe | None:
        """How to load the FMU again; None for blocks."""
        recipe = self.model.recipe if self.model is not None else None
        return recipe if isinstance(recipe, FmuRecipe) else None

    def instance(self) -> Instance:
        """Return a new instance that calls itself by the component's name."""
        made = self.make()
        made.description = dataclasses.replace(made.description, model_name=self._title())
        return made

    def _title(self) -> str:
        if self.model is None or self.model.name == self.name:
            return self.name
        return f"{self.name} ({self.model.name})"


@dataclass(frozen=True, eq=False)
class Opened:
    """A system whose components are open and whose connections are checked.

    Attributes:
        description: as it is written down.
        parts: its components, in that order.
        resolved: its connections, in terms of the components' variables.
    """

    description: SystemDescription
    parts: tuple[OpenComponent, ...]
    resolved: Resolved

    @property
    def interface(self) -> str:
        """The interface that all components have: "me", "cs", or "mixed"."""
        kinds = {p.interface for p in self.parts}
        return kinds.pop() if len(kinds) == 1 else "mixed"

    def close(self) -> None:
        """Close the components' models."""
        for part in self.parts:
            if part.model is not None:
                part.model.close()


def declared_rates(parts: Sequence[OpenComponent]) -> DeclaredRates:
    """Return when components say that they sample; FMUs are those that may do so besides.

    Args:
        parts: the components.
    """
    own = (Sampler(exact(dt), name=p.name) for p in parts if (dt := _sampled_every(p.component)) > 0.0)
    inner = [(part.name, part.model.declared_rates()) for part in parts if part.model is not None]
    return DeclaredRates(
        samplers=tuple(own),
        clocks=tuple(replace(c, name=f"{name}: {c.name}") for name, result in inner for c in result.clocks),
        others=tuple(model for _, result in inner for model in result.others),
    )


def circle_notes(parts: Sequence[OpenComponent], in_circle: Sequence[bool]) -> list[str]:
    """Return a note for each part in an algebraic circle that may sample, and cannot do so again.

    Args:
        parts: the components.
        in_circle: which of them are in a circle, see `Wiring`.
    """
    return [
        f"{part.name}: it is in an algebraic circle, and {why}: where it samples with others of the circle, it does so "
        "once, with what they show before they have answered; delay one of its connections"
        for part, inside in zip(parts, in_circle, strict=True)
        if inside and (why := _why_once(part))
    ]


def _why_once(part: OpenComponent) -> str:
    """Return why what a part samples at an event stays; empty: it does not, or it does not sample."""
    claims, described = part.description.interfaces[part.interface], part.description
    iterates = part.interface == "me" or claims.event_mode
    held = any(v.variability == "discrete" and v.causality != "input" for v in described.variables)
    if part.model is None or not iterates or not (held or described.clocks):
        return ""
    return "its clocks tick once at an instant" if described.clocks else "" if claims.state else "cannot save its state"


def _sampled_every(component: Component) -> float:
    """Return the sample period that a component or block has [s]; 0: none, it is continuous or an FMU."""
    if isinstance(component, BlockComponent):
        matrices = component.block.matrices()
        return 0.0 if matrices is None else matrices.dt
    return component.dt if isinstance(component, LinearComponent) else 0.0


def open_parts(
    components: Sequence[Component],
    undo: ExitStack,
    recipes: Mapping[str, FmuRecipe] | None = None,
    *,
    interface: str = "auto",
) -> tuple[OpenComponent, ...]:
    """Open every component.

    Args:
        components: what to open.
        undo: gets what closes the FMUs again.
        recipes: component → how to open its FMU, in place of its file; for worker processes.
        interface: of FMUs whose component leaves it open.

    Raises:
        InputError: a component's file, interface or start value is wrong; the message names the component.
        FmuError: an FMU cannot be used.
    """
    known = dict(recipes or {})
    unpacked: dict[str, FmuRecipe] = {}
    return tuple(_open(component, undo, known, unpacked, interface) for component in components)


def _open(
    component: Component,
    undo: ExitStack,
    known: Mapping[str, FmuRecipe],
    unpacked: dict[str, FmuRecipe],
    interface: str,
) -> OpenComponent:
    if not isinstance(component, FmuComponent):
        return block_part(component)
    if component.interface == "auto":
        component = dataclasses.replace(component, interface=interface)
    recipe = known.get(component.name) or _again(component, unpacked.get(component.file))
    try:
        part = _fmu(component, recipe)
    except (InputError, FmuError) as error:
        raise type(error)(f"component {component.name}: {error}") from None
    if part.model is not None:
        undo.callback(part.model.close)
    if part.recipe is not None:
        # One loaded binary for all its instances: less memory, and twice as quick where there are many.
        unpacked.setdefault(component.file, part.recipe)
    return part


def _again(component: FmuComponent, first: FmuRecipe | None) -> FmuRecipe | None:
    """Return how to open an FMU that another component has unpacked already, and owns."""
    if first is None:
        return None
    return dataclasses.replace(
        first, interface=component.interface, step=component.step, start_values=dict(component.set)
    )


def _fmu(component: FmuComponent, recipe: FmuRecipe | None) -> OpenComponent:
    if recipe is not None:
        model: DescribedModel = recipe.open()
    else:
        # The solver and the communication step are the system's affair, or the master's.
        loading = Loading(component.interface, start_values=component.set, step=component.step)
        model = load_fmu(component.file, loading, component.called)
    starts = dict(model.start_values)
    described = _told(model.description, starts, component.units)
    doubted = ("the dependencies that it declares are not believed",) if component.dependencies == "all" else ()
    return OpenComponent(
        component=component,
        description=_undeclared(described) if doubted else described,
        interface=model.interface,
        starts=starts,
        notes=(*model.description.notes, *silent_clocks(model.description, model.interface), *doubted),
        model=model,
        make=model.new_instance,
    )


def _told(description: ModelDescription, starts: Mapping[str, Value], units: Mapping[str, str]) -> ModelDescription:
    """Return the description with start values and units that the system declares."""

    def told(variable: Variable) -> Variable:
        start, unit = starts.get(variable.name, variable.start), variable.unit or units.get(variable.name)
        if start == variable.start and unit == variable.unit:
            return variable
        return variable._replace(start=start, unit=unit)

    if not starts and not units:
        return description
    return dataclasses.replace(description, variables=tuple(told(v) for v in description.variables))


def _undeclared(description: ModelDescription) -> ModelDescription:
    """Return the description without what it says of dependencies: each output and derivative may depend on all."""
    variables, derivatives = (
        tuple(v._replace(dependencies=None) for v in of) for of in (description.variables, description.derivatives)
    )
    return dataclasses.replace(description, variables=variables, derivatives=derivatives)


def block_part(component: NativeComponent) -> OpenComponent:
    """Return a component that is not an FMU, opened.

    Args:
        component: any such.
    """
    description, make = _native(component)
    note = "a Python function, called at every evaluation: slow, and in this process only"
    return OpenComponent(
        component=component,
        description=description,
        interface="me",
        starts={},
        notes=(note,) if isinstance(component, FunctionComponent) else (),
        model=None,
        make=make,
    )


def _native(component: NativeComponent) -> tuple[ModelDescription, Callable[[], Instance]]:
    """Return what a component that is not an FMU says about itself, and how an instance of it is made."""
    if isinstance(component, BlockComponent) and component.block.number:
        said = element_description(component)
        return said, lambda: ElementInstance(component, said)
    description = block_description(component)
    return description, lambda: BlockInstance(component, description)


def system_starts(values: Mapping[str, Value], described: ModelDescription) -> dict[str, Value]:
    """Return start values that a whole system is given, in their variables' types.

    Args:
        values: full name → value.
        described: the system's description.

    Raises:
        InputError: see `check_starts`; a structural parameter, which a component is opened with.
    """
    variables = {v.name: v for v in described.variables}
    result = check_starts(values, variables, described.enumerations, described.units, what="start_values")
    sizes = {v.name for v in described.variables if v.causality == STRUCTURAL}
    for name in result.keys() & sizes:
        raise InputError(f"{name}: a structural parameter is set with its component: set = {{…}} in the system file")
    return result


def starts_of(parts: Sequence[OpenComponent]) -> dict[str, Value]:
    """Return the start values that the system sets, by full name."""
    return {f"{p.name}.{name}": value for p in parts for name, value in p.starts.items()}

"""A system as a model: all model exchange components together are one ordinary differential equation."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from types import MethodType
from typing import TYPE_CHECKING

from workbench.core.closed_loop import ClosedLoop
from workbench.errors import InputError
from workbench.fmi.instance import Instance
from workbench.fmi.variable import Value
from workbench.fmi.wiring import Connection, Wiring
from workbench.model.described import DescribedModel
from workbench.model.load import check_biases, check_starts, choose_solver, experiment_notes, start_of
from workbench.model.recipe import DEFAULT_TOLERANCE
from workbench.session.fmu import Setup
from workbench.system.composite import CompositeInstance
from workbench.system.description import Resolved, SystemDescription
from workbench.system.health import resolve
from workbench.system.joint import joint_description, joint_ports
from workbench.system.loops import closed_loops
from workbench.system.order import plan
from workbench.system.parts import Part, open_parts
from workbench.system.recipe import SystemRecipe

if TYPE_CHECKING:
    from workbench.analysis.loop.result import LoopResult

__all__ = ["SYSTEMS", "Opened", "SystemModel", "connections_of", "open_system", "starts_of"]


@dataclass(frozen=True, eq=False)
class Opened:
    """A system whose components are open and whose connections are checked.

    Attributes:
        description: as it is written down.
        parts: its components, in that order.
        resolved: its connections, in terms of the components' variables.
    """

    description: SystemDescription
    parts: tuple[Part, ...]
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


class SystemModel(DescribedModel):
    """Several components with connections, all of model exchange: one ODE, one solver, no delay anywhere.

    Args:
        opened: the components; the model owns them from now on.
        recipe: how to make it again.

    Attributes:
        system: the system as it is written down.
    """

    recipe: SystemRecipe

    def __init__(self, opened: Opened, recipe: SystemRecipe) -> None:
        self._opened = opened
        self.system = opened.description
        described = joint_description(opened.description, opened.parts, opened.resolved)
        self._ports = joint_ports(opened.parts, opened.resolved)
        self._plan = plan(connections_of(opened), parts=len(opened.parts))
        solver, note = choose_solver(recipe.solver, states=described.state_count)
        variables = {v.name: v for v in described.variables}
        setup = Setup(
            open_instance=self.new_instance,
            variables=variables,
            start_values={**starts_of(opened.parts), **check_starts(recipe.start_values, variables)},
            bias=check_biases(recipe.bias, variables),
            rtol=recipe.tolerance or described.experiment.tolerance or DEFAULT_TOLERANCE,
            tolerance=recipe.tolerance or described.experiment.tolerance,
            start_time=start_of(recipe, described),
            step=recipe.step,
            solver=solver,
        )
        super().__init__(
            described,
            source=recipe.source,
            interface="me",
            setup=setup,
            notes=(*_notes(opened, self._plan), *experiment_notes(recipe, described), *filter(None, [note])),
            recipe=recipe,
        )

    @property
    def loop(self) -> Callable[..., LoopResult]:
        """`system.loop("plant.y", …)` is `workbench.loop(system, "plant.y", …)`: margins of a loop."""
        # The way of `.plot()`: looked up when it is used, so that systems know no analysis and its options stand once.
        from workbench.analysis.loop.request import loop  # noqa: PLC0415

        return MethodType(loop, self)

    def new_instance(self) -> Instance:
        with ExitStack() as undo:
            made = [_closed_by(undo, part.instance()) for part in self._opened.parts]
            undo.pop_all()
        return CompositeInstance(made, self._plan.anew(), self.description, self._ports, source=self.source)

    def _without_state(self) -> str:
        names = [p.name for p in self._opened.parts if not p.description.interfaces[p.interface].state]
        return f"components do not claim to save their state: {', '.join(names)}"

    def closed_loops(self, signals: Sequence[str], *, until: float) -> tuple[ClosedLoop, ...]:
        return closed_loops(self._opened, signals, until=until)

    def close(self) -> None:
        super().close()
        self._opened.close()


def _closed_by(undo: ExitStack, instance: Instance) -> Instance:
    """Return the instance; it is closed if making those after it fails."""
    undo.callback(instance.close)
    return instance


def open_system(recipe: SystemRecipe) -> DescribedModel:
    """Return the model that a recipe describes.

    Raises:
        InputError, FmuError: see `connect`.
    """
    with ExitStack() as undo:
        parts = open_parts(recipe.system.components, undo, recipe.parts, interface=recipe.interface)
        resolved = resolve(recipe.system, [p.description.variables for p in parts])
        opened = Opened(recipe.system, parts, resolved)
        if recipe.interface not in ("auto", opened.interface):
            raise InputError(f"{recipe.source}: interface {recipe.interface} is wanted, but {_kinds(opened)}")
        if opened.interface == "me":
            _check_no_master(recipe)
        model = SYSTEMS[opened.interface](opened, recipe.with_parts(parts))
        undo.pop_all()
    return model


def _check_no_master(recipe: SystemRecipe) -> None:
    for name, given in (("order", recipe.order != "auto"), ("hold_inputs", recipe.hold_inputs)):
        if given:
            raise InputError(f"{recipe.source}: {name} is for systems with co-simulation components; this has none")


def _kinds(opened: Opened) -> str:
    return "its components have " + ", ".join(f"{p.name}: {p.interface}" for p in opened.parts)


def _master(opened: Opened, recipe: SystemRecipe) -> DescribedModel:
    from workbench.system.master.model import MasterModel  # noqa: PLC0415 - it needs `Opened`

    return MasterModel(opened, recipe)


# Interfaces of the components → the model that drives them.
SYSTEMS: Mapping[str, Callable[[Opened, SystemRecipe], DescribedModel]] = {
    "me": SystemModel,
    "cs": _master,
    "mixed": _master,
}


def connections_of(opened: Opened) -> list[Connection]:
    """Return the connections between the components."""
    return [
        Connection(
            source=w.source,
            destination=w.destination,
            from_component=w.from_component,
            to_component=w.to_component,
            gain=w.factor,
            offset=w.offset,
            closes_at=-float("inf") if w.closes_at is None else w.closes_at,
            label=f"{opened.parts[w.from_component].name}.{w.source.name} → "
            f"{opened.parts[w.to_component].name}.{w.destination.name}",
        )
        for w in opened.resolved.wires
    ]


def starts_of(parts: Sequence[Part]) -> dict[str, Value]:
    """Return the start values that the system sets, by full name."""
    return {f"{p.name}.{name}": value for p in parts for name, value in p.starts.items()}


def _notes(opened: Opened, wiring: Wiring) -> list[str]:
    notes = [*opened.description.notes, *opened.resolved.notes]
    notes += [f"{part.name}: {note}" for part in opened.parts for note in part.notes]
    for group in wiring.continuous:
        if group.loop:
            labels = ", ".join(wiring.connections[i].label for i in group.members)
            notes.append(f"algebraic loop, solved by Newton's method at every evaluation: {labels}")
    return notes

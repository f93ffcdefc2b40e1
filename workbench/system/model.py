"""A system as a model: all model exchange components together are one ordinary differential equation."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace

from workbench.core.values.closed_loop import ClosedLoop
from workbench.fmi.description import ModelDescription
from workbench.fmi.instance import Instance
from workbench.fmi.variable import Value
from workbench.fmi.wiring import Wiring
from workbench.model.base import DeclaredRates
from workbench.model.described_model import DescribedModel
from workbench.model.load import choose_solver, experiment_notes, start_of
from workbench.model.loading import DEFAULT_TOLERANCE
from workbench.model.starts import check_biases
from workbench.session.setup import Setup
from workbench.system.components import Opened, circle_notes, declared_rates, starts_of, system_starts
from workbench.system.composite import CompositeInstance
from workbench.system.joint_description import joint_description, joint_ports
from workbench.system.loops import closed_loops
from workbench.system.order import plan
from workbench.system.parameters import component_parameters, reparametrised
from workbench.system.recipe import SystemRecipe

__all__ = ["ConnectedModel", "SystemModel", "own_notes"]


class ConnectedModel(DescribedModel):
    """Several components with connections.

    Args:
        opened: the components; the model owns them from now on.
        recipe: how to make it again.
        described: what it says of itself.
        interface: "me" or "cs".
        solver: of the whole.
        step: communication step [s].
        notes: remarks for the user.

    Attributes:
        system: the system as it is written down.
    """

    recipe: SystemRecipe

    def __init__(
        self,
        opened: Opened,
        recipe: SystemRecipe,
        described: ModelDescription,
        *,
        interface: str,
        solver: str,
        step: float | None,
        notes: Sequence[str],
    ) -> None:
        self._opened, self.system = opened, opened.description
        self._ports = joint_ports(opened.parts, opened.resolved)
        setup = _setup(opened, recipe, described, solver=solver, step=step)
        super().__init__(
            described,
            source=recipe.source,
            interface=interface,
            setup=setup,
            notes=tuple(notes),
            recipe=replace(recipe, bias=setup.bias),
        )
        self.parameters = (*self.parameters, *component_parameters(self.system))

    @abstractmethod
    def _again(self, opened: Opened, recipe: SystemRecipe) -> ConnectedModel:
        """Return such a model of other components."""

    def with_values(self, values: Mapping[str, Value]) -> DescribedModel:
        opened, rest = reparametrised(self._opened, values)
        if opened is self._opened:
            return super().with_values(values)
        starts = {**self.recipe.start_values, **rest}
        twin = self._again(opened, replace(self.recipe, system=opened.description, start_values=starts))
        twin._sessions = self._sessions  # noqa: SLF001 - it is closed with this one
        twin._kept_state = self._kept_state  # noqa: SLF001 - its own
        return twin

    def _instances(self) -> list[Instance]:
        """Return a new instance of each component; if one cannot be made, those before it are closed."""
        with ExitStack() as undo:
            made: list[Instance] = []
            for part in self._opened.parts:
                made.append(part.instance())
                undo.callback(made[-1].close)
            undo.pop_all()
        return made

    def _own_rates(self) -> DeclaredRates:
        return declared_rates(self._opened.parts)

    def closed_loops(self, signals: Sequence[str], *, until: float) -> tuple[ClosedLoop, ...]:
        return closed_loops(self._opened, signals, until=until)

    def close(self) -> None:
        super().close()
        self._opened.close()


def _setup(
    opened: Opened, recipe: SystemRecipe, described: ModelDescription, *, solver: str, step: float | None
) -> Setup:
    variables = {v.name: v for v in described.variables}
    tolerance = recipe.tolerance or described.experiment.tolerance
    return Setup(
        variables=variables,
        start_values={**starts_of(opened.parts), **system_starts(recipe.start_values, described)},
        bias=check_biases(recipe.bias, variables, described.units),
        rtol=tolerance or DEFAULT_TOLERANCE,
        tolerance=tolerance,
        start_time=start_of(recipe, described),
        step=step,
        hold_inputs=recipe.hold_inputs,
        solver=solver,
    )


def own_notes(opened: Opened) -> list[str]:
    """Return the notes on a system's file, its connections and its components."""
    notes = [*opened.description.notes, *opened.resolved.notes]
    return notes + [f"{part.name}: {note}" for part in opened.parts for note in part.notes]


class SystemModel(ConnectedModel):
    """Several components with connections, all of model exchange: one ODE, one solver, no delay anywhere.

    Args:
        opened: the components; the model owns them from now on.
        recipe: how to make it again.
    """

    def __init__(self, opened: Opened, recipe: SystemRecipe) -> None:
        described = joint_description(opened.description, opened.parts, opened.resolved)
        self._plan = plan(opened.resolved.wires, parts=len(opened.parts))
        solver, note = choose_solver(recipe.solver, described)
        notes = [*_notes(opened, self._plan), *experiment_notes(recipe, described), *filter(None, [note])]
        super().__init__(opened, recipe, described, interface="me", solver=solver, step=recipe.step, notes=notes)

    def _again(self, opened: Opened, recipe: SystemRecipe) -> SystemModel:
        return SystemModel(opened, recipe)

    def new_instance(self) -> Instance:
        made = self._instances()
        return CompositeInstance(made, self._plan.anew(), self.description, self._ports, source=self.source)

    def _without_state(self) -> str:
        names = [p.name for p in self._opened.parts if not p.description.interfaces[p.interface].state]
        return f"components do not claim to save their state: {', '.join(names)}"


def _notes(opened: Opened, wiring: Wiring) -> list[str]:
    notes = own_notes(opened)
    notes += circle_notes(opened.parts, wiring.in_circle)
    for group in wiring.continuous:
        if group.loop:
            labels = ", ".join(wiring.connections[i].label for i in group.members)
            notes.append(f"algebraic loop, solved by Newton's method at every evaluation: {labels}")
    return notes

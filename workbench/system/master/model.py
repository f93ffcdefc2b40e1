"""A system with co-simulation components as a model."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection

from workbench.errors import InputError, suggest
from workbench.fmi.description import Capabilities, ModelDescription
from workbench.fmi.instance import Instance
from workbench.fmi.ticking import time_based
from workbench.model.described_model import DescribedModel
from workbench.model.load import choose_solver, experiment_notes
from workbench.session.fmu import FmuSession
from workbench.session.setup import Setup
from workbench.system.components import Opened, circle_notes
from workbench.system.joint_description import joint_description
from workbench.system.master.crossover import opened_loop
from workbench.system.master.instance import MasterInstance, MasterPlan
from workbench.system.master.ordering import ORDERS, choose_order
from workbench.system.master.sampled import find_ticks
from workbench.system.master.session import MasterSession
from workbench.system.master.units import Units, find_units
from workbench.system.model import ConnectedModel, own_notes
from workbench.system.order import plan
from workbench.system.recipe import SystemRecipe

__all__ = ["MasterModel"]

_EXTRAPOLATED = {  # order → in words, before "linear"
    0: "held where their source is stepped later, else ",
    1: "",
    2: "extrapolated by order 2 where their source is stepped later, ",
}
_LOOSER = 100.0  # tolerance of one communication step in terms of the integration's


class MasterModel(ConnectedModel):
    """Several components with connections, some of them of co-simulation: stepped by a master.

    Args:
        opened: the components; the model owns them from now on.
        recipe: how to make it again.

    Attributes:
        order: "gauss-seidel" or "jacobi".
    """

    def __init__(self, opened: Opened, recipe: SystemRecipe) -> None:
        _check(recipe)
        _refuse_clocks(opened)
        described = _described(opened)
        self._units = find_units(opened.parts, opened.resolved.wires, opened.resolved)
        self.order, _ = choose_order(recipe.system.master.order, self._units)
        self._solvers, solver_notes = _solvers(self._units, recipe.solver)
        self._decided: MasterPlan | None = None
        self._probing = False
        self._late: set[int] = set()
        step = recipe.step or opened.description.default_experiment.step
        notes = [
            *own_notes(opened),
            *circle_notes(opened.parts, plan(opened.resolved.wires, parts=len(opened.parts)).in_circle),
            _master_note(self.order, self._units, recipe),
            _step_note(step, described, held=recipe.hold_inputs),
            *experiment_notes(recipe, described),
            *solver_notes,
        ]
        super().__init__(opened, recipe, described, interface="cs", solver="fmu", step=step, notes=notes)

    def _again(self, opened: Opened, recipe: SystemRecipe) -> MasterModel:
        return MasterModel(opened, recipe)

    @property
    def decided(self) -> MasterPlan:
        """How the master goes about it. The first time, sampled components are asked for their instants."""
        if self._decided is None:
            sampled = find_ticks(self._opened.parts, self._units)
            held = frozenset(k for k, result in sampled.items() if result.held)
            self._decided = MasterPlan(
                units=self._units,
                names=tuple(p.name for p in self._opened.parts),
                stages=choose_order(self.recipe.system.master.order, self._units, held)[1],
                held=held,
                sampled=sampled,
                hold_inputs=self.recipe.hold_inputs,
                extrapolation=self.recipe.system.master.extrapolation,
                solver=self._solvers,
                rtol=self._setup.rtol,
            )
        return self._decided

    def new_instance(self) -> Instance:
        decided, made = self.decided, self._instances()
        instance = MasterInstance(made, decided, self.description, self._ports, source=self.source)
        instance.late = self._late
        return instance

    def slopes_act(self) -> bool:
        return True  # of the system; those of its components are their own affair

    def _open(self, setup: Setup) -> FmuSession:
        wanted = self.recipe.system.master.step_tolerance
        if self._probing:
            return MasterSession(setup)
        rehearses = self.recipe.system.master.extrapolation > 1
        if setup.step is not None:
            return MasterSession(setup, rehearses=rehearses)
        why = self.why_fixed_step()
        if why and wanted is not None:
            raise InputError(f"{self.source}: step_tolerance: the step cannot be controlled: {why}; give step instead")
        if why:
            return MasterSession(setup, rehearses=rehearses)
        return MasterSession(setup, tolerance=wanted or _LOOSER * setup.rtol)

    def why_fixed_step(self) -> str:
        """Return why the communication step is not controlled; empty if it is, as long as no `step` is given."""
        if self._setup.step is not None:
            return f"a step of {self._setup.step:g} s is given"
        if self._setup.hold_inputs:
            return "inputs are held: their error falls too slowly with the step to be controlled"
        constant = [p.name for p in self._opened.parts if not p.description.interfaces[p.interface].variable_step]
        if constant:
            return f"a constant step is needed by {', '.join(constant)}"
        return self.why_replay()

    def controls_step(self) -> bool:
        return not self.why_fixed_step()

    def why_replay(self) -> str:
        claims = ((p.name, p.description.interfaces[p.interface].state) for p in self._opened.parts)
        without = [name for name, claimed in claims if not claimed]
        if without:
            return f"components do not claim to save their state: {', '.join(without)}"
        before, self._probing = self._probing, True
        try:
            return super().why_replay()
        finally:
            self._probing = before

    def remarks(self, given: Collection[str] = ()) -> tuple[str, ...]:
        notes = (*super().remarks(given), *self._shown_late())
        if self.recipe.system.master.extrapolation < 2 or not (why := self.why_replay()):
            return notes
        return (*notes, f"extrapolation: the first step cannot be repeated and knows no slope: {why}")

    def _shown_late(self) -> list[str]:
        """Say where samples that coincide are not one event: what has no event mode shows its own after the step."""
        names, connections = [p.name for p in self._opened.parts], self._units.connections
        late = [connections[i] for i in sorted(self._late)]
        return [
            f"{c.label}: {names[c.from_component]} shows what it samples only after its step, and "
            f"{names[c.to_component]} samples at the same instant: it sees the sample before; give "
            f"{names[c.from_component]} interface me, or export it with event mode (FMI 3.0)"
            for c in late
        ]

    def shows_input(self, output: str) -> bool:
        """Whether an output of the system shows what a component sees, which depends on the step by nature.

        Args:
            output: its name.
        """
        return self._ports[output][0][1].causality == "input"

    def all_me(self, without: int) -> DescribedModel | None:
        """Return the same system with model exchange components only and one connection opened; None if it has none.

        Args:
            without: number of the connection; its ends become the input and the output `loop`.
        """
        return opened_loop(self._opened, self.recipe, without)


def _refuse_clocks(opened: Opened) -> None:
    """Refuse clocks whose ticks lie between the communication points of a component that wants a constant step."""
    claims = {p.name: p.description.interfaces[p.interface] for p in opened.parts}
    constant = [name for name, claim in claims.items() if not claim.variable_step]
    for part in opened.parts:
        driven = part.interface == "cs" and claims[part.name].event_mode
        clocks = time_based(part.description.clocks) if driven else {}
        if clocks and constant:
            able = [
                p.name for p in opened.parts if p.name in (part.name, constant[0]) if "me" in p.description.interfaces
            ]
            remedy = (
                f'give interface "me" to {" or ".join(able)}'
                if able
                else "neither offers model exchange; leave one out"
            )
            raise InputError(
                f"component {part.name}: clock {next(iter(clocks))} ticks at its own instants, but {constant[0]} wants "
                f"a constant communication step; {remedy}"
            )


def _described(opened: Opened) -> ModelDescription:
    """Return the system's description: that of a co-simulation FMU."""
    described = joint_description(opened.description, opened.parts, opened.resolved)
    claims = [p.description.interfaces[p.interface] for p in opened.parts]
    joint = Capabilities(
        identifier="",
        state=all(c.state for c in claims),
        variable_step=all(c.variable_step for c in claims),
        interpolates_inputs=True,
        event_mode=True,
        completed_step=False,
        once_per_process=any(c.once_per_process for c in claims),
        needs_tool=any(c.needs_tool for c in claims),
    )
    components = {p.name: "me" in p.description.interfaces for p in opened.parts if p.interface == "cs"}
    return dataclasses.replace(described, interfaces={"cs": joint}, components=components)


def _solvers(units: Units, wanted: str) -> tuple[dict[int, str], list[str]]:
    """Return the solver of each group of model exchange components, and notes."""
    result, notes = dict[int, str](), list[str]()
    for k, unit in enumerate(units.units):
        if unit.group is not None:
            described = unit.group.description
            states = described.state_count
            # What is wanted for the whole system does not concern groups without states.
            result[k], note = choose_solver(wanted if states else "auto", described)
            notes += [f"{unit.name}: {note}"] if states and note else []
    return result, notes


# -- notes --------------------------------------------------------------------------------------


def _check(recipe: SystemRecipe) -> None:
    """Refuse options that do not go together."""
    options = recipe.system.master
    if options.order not in (known_orders := ("auto", *ORDERS)):
        raise InputError(f"{recipe.source}: order '{options.order}' is unknown; {suggest(options.order, known_orders)}")
    if options.extrapolation not in _EXTRAPOLATED:
        known = ", ".join(map(str, _EXTRAPOLATED))
        raise InputError(f"{recipe.source}: extrapolation {options.extrapolation} is unknown; known: {known}")
    if options.extrapolation != 1 and recipe.hold_inputs:
        raise InputError(f"{recipe.source}: hold_inputs holds all inputs; extrapolation is for inputs that go on")
    if options.step_tolerance is not None and recipe.step is not None:
        raise InputError(f"{recipe.source}: step fixes the communication step, step_tolerance controls it; give one")
    if options.step_tolerance is not None and not 0.0 < options.step_tolerance < 1.0:
        raise InputError(f"{recipe.source}: step_tolerance is {options.step_tolerance:g}, not between 0 and 1")


def _master_note(order: str, units: Units, recipe: SystemRecipe) -> str:
    goes_on = _EXTRAPOLATED[recipe.system.master.extrapolation]
    held = (
        "held between communication points, which is a delay"
        if recipe.hold_inputs
        else f"{goes_on}linear, or at their middle value, between communication points"
    )
    groups = [u.name for u in units.units if u.group is not None and len(u.members) > 1]
    one = f"; one equation with one solver: {', '.join(groups)}" if groups else ""
    return f"master: {order}; connected values are {held} (`wb.delays` shows what that costs){one}"


def _step_note(step: float | None, described: ModelDescription, *, held: bool) -> str:
    if step is not None:
        return f"communication step: {step:g} s, and the instants of sampled components"
    begin = described.experiment.step
    fixed = "derived from the signals and points" if begin is None else f"{begin:g} s, the shortest default of an FMU"
    if held:
        return f"communication step: {fixed}; `step` sets it"
    return (
        "communication step: controlled by step doubling where the state of all components can be saved (probed), "
        f"else {fixed}; `step` sets it"
    )

"""A system with co-simulation components as a model."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from contextlib import ExitStack

from workbench.errors import SimulationError
from workbench.fmi.description import Capabilities, Description
from workbench.fmi.instance import Instance
from workbench.fmi.wiring import Connection
from workbench.model.described import DescribedModel
from workbench.model.load import check_biases, check_starts, choose_driver
from workbench.model.recipe import DEFAULT_TOLERANCE
from workbench.session.fmu import FmuSession, Setup
from workbench.session.solvers import choose_solver
from workbench.system.joint import joint_description, joint_ports
from workbench.system.master.instance import MasterInstance, MasterPlan
from workbench.system.master.ordering import choose_order
from workbench.system.master.sampled import find_ticks
from workbench.system.master.session import MasterSession
from workbench.system.master.units import Units, find_units
from workbench.system.model import Opened, connections_of, starts_of
from workbench.system.parts import Part
from workbench.system.recipe import SystemRecipe

__all__ = ["MasterModel"]


class MasterModel(DescribedModel):
    """Several components with connections, some of them of co-simulation: stepped by a master.

    Args:
        opened: the components; the model owns them from now on.
        recipe: how to make it again.

    Attributes:
        system: the system as it is written down.
        order: "gauss-seidel" or "jacobi".
        decided: how the master goes about it.
    """

    recipe: SystemRecipe

    def __init__(self, opened: Opened, recipe: SystemRecipe) -> None:
        self._opened = opened
        self.system = opened.description
        described = _described(opened)
        self._ports = joint_ports(opened.parts, opened.resolved)
        variables = {v.name: v for v in described.variables}
        driver, remark = choose_driver(recipe.driver)
        self.order, self.decided, notes = _decide(opened, recipe, driver)
        setup = Setup(
            open_instance=self.new_instance,
            variables=variables,
            start_values={**starts_of(opened.parts), **check_starts(recipe.start_values, variables)},
            bias=check_biases(recipe.bias, variables),
            rtol=recipe.tolerance or described.experiment.tolerance or DEFAULT_TOLERANCE,
            tolerance=recipe.tolerance or described.experiment.tolerance,
            step=recipe.step,
            hold_inputs=recipe.hold_inputs,
            solver="fmu",
        )
        super().__init__(
            described,
            source=recipe.source,
            interface="cs",
            setup=setup,
            driver=driver,
            notes=(*_own_notes(opened), *notes, *filter(None, [remark])),
            recipe=recipe,
        )

    def new_instance(self) -> Instance:
        with ExitStack() as undo:
            made: list[Instance] = []
            for part in self._opened.parts:
                made.append(part.instance())
                undo.callback(made[-1].close)
            undo.pop_all()
        return MasterInstance(made, self.decided, self.description, self._ports, source=self.source)

    def _open(self, setup: Setup) -> FmuSession:
        return MasterSession(setup)

    def close(self) -> None:
        super().close()
        self._opened.close()


def _described(opened: Opened) -> Description:
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
    return dataclasses.replace(described, interfaces={"cs": joint})


def _decide(opened: Opened, recipe: SystemRecipe, driver: str) -> tuple[str, MasterPlan, list[str]]:
    """Return the method, what is decided once, and notes about it."""
    parts = opened.parts
    units = find_units(parts, connections_of(opened), opened.resolved)
    sampled, notes = find_ticks(parts, units)
    held = frozenset(k for k, found in sampled.items() if found.held)
    order, stages = choose_order(recipe.order, units, held)
    solver = {}
    for k, unit in enumerate(units.units):
        if unit.group is not None:
            solver[k], note = choose_solver(recipe.solver, states=unit.group.description.state_count)
            notes += [f"{unit.name}: {note}"] if unit.group.description.state_count else []
    decided = MasterPlan(
        units=units,
        names=tuple(p.name for p in parts),
        stages=stages,
        held=held,
        ticks={k: found.ticks for k, found in sampled.items()},
        hold_inputs=recipe.hold_inputs,
        solver=solver,
        rtol=recipe.tolerance or DEFAULT_TOLERANCE,
        driver=driver,
    )
    return order, decided, [_order_note(order, decided), *notes]


def _order_note(order: str, decided: MasterPlan) -> str:
    names = [" | ".join(decided.units.units[k].name for k in stage) for stage in decided.stages]
    return f"master: {order}, {' → '.join(names)}"


def _own_notes(opened: Opened) -> list[str]:
    notes = [*opened.description.notes, *opened.resolved.notes]
    return notes + [f"{part.name}: {note}" for part in opened.parts for note in part.notes]

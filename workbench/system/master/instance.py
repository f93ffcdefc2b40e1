"""A system with co-simulation components under the façade of one co-simulation FMU, which the kernel steps."""

# ruff: noqa: ANN401 - saved states have no type
from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.core.values.calendar import Sampler, is_due
from workbench.errors import SimulationError
from workbench.fmi.description import ModelDescription
from workbench.fmi.instance import MAX_EVENT_ITERATIONS, EventInfo, Instance
from workbench.fmi.library import Library
from workbench.fmi.variable import Variable
from workbench.system.composite import CompositeInstance, Ports, next_event
from workbench.system.master.group_instance import GroupInstance
from workbench.system.master.group_unit import CompiledGroupSession, GroupSession, GroupUnit
from workbench.system.master.ordering import Order
from workbench.system.master.sampled import Sampled
from workbench.system.master.units import Units
from workbench.system.order import plan

__all__ = ["MasterInstance", "MasterPlan"]


_LEAST = 1e-3  # of values whose nominal value is not declared


@dataclass(frozen=True, eq=False)
class MasterPlan:
    """What is decided once for all instances of a system.

    Attributes:
        units: what is stepped.
        names: of the components.
        stages: in which order; the units of one stage do not see what the others of it reach.
        held: units that are sampled: their outputs stand still between their instants.
        sampled: units that are sampled, with their instants.
        hold_inputs: inputs stand still over a step.
        extrapolation: order by which values go on whose source has not been stepped yet: 0, 1 or 2.
        solver: group's unit → name of its solver.
        rtol: relative tolerance of the groups' integration.
    """

    units: Units
    names: tuple[str, ...]
    stages: Order
    held: frozenset[int]
    sampled: Mapping[int, Sampled]
    hold_inputs: bool
    extrapolation: int
    solver: Mapping[int, str]
    rtol: float


@dataclass(frozen=True, eq=False)
class _MasterState:
    """A saved state of the whole system."""

    parts: Any
    groups: tuple[Any, ...]
    slopes: Floats
    spans: Floats
    next_events: dict[int, float]
    time: float


class MasterInstance(CompositeInstance):
    """All components; their steps are made by the kernel (master.c).

    Between communication points each unit goes on by itself. At a communication point all connected values are
    passed on, in the order of the components' feed-through (algebraic loops are solved), and components with
    event mode iterate together.

    Args:
        parts: new instances; this one owns them from now on.
        decided: see `MasterPlan`.
        description: of the system.
        ports: name of a variable of the system → the parts that have it.
        source: what the user named.

    Attributes:
        decided: see `MasterPlan`.
        groups: unit → model exchange components that are one equation.
        slopes: how the connected values changed in the last step and in that before, shape (2, connections) [1/s].
        spans: lengths of these steps, 0 where there was none, shape (2,) [s].
        ticks: unit → its instants, where they are known beforehand.
        late: connections that have shown a sample to others only after these had sampled, at the same instant; the
            model's, which all its instances add to.
        next_events: component → its next time event, of those of co-simulation with event mode [s].
    """

    def __init__(
        self,
        parts: Sequence[Instance],
        decided: MasterPlan,
        description: ModelDescription,
        ports: Ports,
        *,
        source: str,
    ) -> None:
        connections = decided.units.connections
        super().__init__(parts, plan(connections, parts=len(parts)), description, ports, source=source)
        self.decided = decided
        self.slopes, self.spans = np.zeros((2, len(connections))), np.zeros(2)
        self.ticks: Mapping[int, tuple[Sampler, ...]] = {}
        self.late: set[int] = set()
        self.next_events: dict[int, float] = {}
        self.groups = {k: self._group(k) for k, unit in enumerate(decided.units.units) if unit.group is not None}

    def _setup(self, description: ModelDescription, library: Library, *, interface: str) -> None:
        super()._setup(description, library, interface="cs")

    def _group(self, number: int, kind: type[GroupSession] = CompiledGroupSession) -> GroupUnit:
        unit, decided = self.decided.units.units[number], self.decided
        if unit.group is None:
            raise SimulationError(f"{unit.name} is stepped by itself")
        instance = GroupInstance([self.parts[i] for i in unit.members], unit.group)
        solver = decided.solver[number]
        return GroupUnit(unit.name, instance, unit.members, solver=solver, rtol=decided.rtol, kind=kind)

    def close(self) -> None:
        for group in self.groups.values():
            group.close()
        super().close()

    # -- initialisation ---------------------------------------------------------------------

    def enter_initialisation(self, start_time: float, tolerance: float | None) -> None:
        super().enter_initialisation(start_time, tolerance)
        self.ticks = {k: result.begun(start_time) for k, result in self.decided.sampled.items()}
        for group in self.groups.values():
            group.instance.enter_initialisation(start_time, tolerance)

    def exit_initialisation(self) -> None:
        super().exit_initialisation()
        for group in self.groups.values():
            group.instance.exit_initialisation()

    # -- events at communication points -----------------------------------------------------

    def _with_events(self) -> list[int]:
        """Return the components that take part in an event iteration."""
        return [i for i, p in enumerate(self.parts) if p.event_mode]

    def enter_event_mode(self) -> None:
        for group in self.groups.values():
            if self.time < group.due() and is_due(group.due(), self.time):  # rounding alone makes it due later
                group.instance.set_time(group.due())
            group.instance.enter_event_mode()
        for number in self._with_events():
            if self.parts[number].interface == "cs":
                self.parts[number].enter_event_mode()
        self._wiring.switch(self.time)
        self._events = True
        self.touch()

    def _rounds(self) -> EventInfo:
        taking = [n for n in self._wiring.order if self.parts[n].event_mode]
        changed = False
        for _ in range(MAX_EVENT_ITERATIONS):
            self.refresh()
            before = self._wiring.values.copy()
            answers = {number: self._update(number) for number in taking}
            self.touch()
            self.refresh()
            moved = not np.array_equal(before, self._wiring.values)
            last = {number: info for number, (_, info) in answers.items()}
            changed |= any(i.states_changed for i in last.values())
            end = any(i.terminate for i in last.values())
            if end or not (moved or any(again for again, _ in answers.values())):
                return self._settled(last, changed=changed, terminate=end)
        raise SimulationError(
            f"{self.description.model_name}: event iteration does not settle after {MAX_EVENT_ITERATIONS} rounds",
            time=self.time,
        )

    def _settled(self, last: Mapping[int, EventInfo], *, changed: bool, terminate: bool) -> EventInfo:
        self.next_events = {n: i.next_time for n, i in last.items() if self.parts[n].interface == "cs"}
        for number, group in self.groups.items():
            members = self.decided.units.units[number].members
            wiring = group.instance.wiring
            group.instance.settled = EventInfo(
                terminate=False,
                states_changed=True,
                nominals_changed=False,
                next_time=next_event((last[n].next_time for n in members), wiring, self.time),
            )
        return EventInfo(terminate, changed, nominals_changed=False, next_time=math.inf)  # the kernel finds it

    def enter_step_mode(self) -> None:
        for number in self._with_events():
            if self.parts[number].interface == "cs":
                self.parts[number].enter_step_mode()
        for group in self.groups.values():
            group.settle(self.time)
        self._events = False

    def watched(self) -> list[Variable]:
        """Return the outputs by which the step is controlled; what a component sees depends on it by nature."""
        shown = [v for v in self.description.variables if v.causality == "output" and v.is_number]
        return [v for v in shown if self.ports(v)[0][1].causality != "input"]

    def least(self) -> Floats:
        """Return from which magnitude on connected values, then what is watched, count in relative terms."""
        sources = [self._wiring.connections[i].destination for i in sorted(self.decided.units.outer())]
        return np.array([v.nominal or _LEAST for v in (*sources, *self.watched())])

    def place_states(self, values: Mapping[str, float]) -> bool:
        placed = [group.instance.place_states(values) for group in self.groups.values()]
        return any(placed)

    # -- steps ------------------------------------------------------------------------------

    def stands(self, time: float, next_events: Mapping[int, float]) -> None:
        """Note that the kernel has advanced all components to `time` [s]."""
        self.time = time
        self.next_events = dict(next_events)
        self._stale = False  # what is read now are left limits
        for group in self.groups.values():
            group.stands(time)

    # -- saved states -----------------------------------------------------------------------

    def get_state(self) -> Any:
        return _MasterState(
            parts=super().get_state(),
            groups=tuple(g.snapshot() for g in self.groups.values()),
            slopes=self.slopes.copy(),
            spans=self.spans.copy(),
            next_events=dict(self.next_events),
            time=self.time,
        )

    def set_state(self, state: Any) -> None:
        super().set_state(state.parts)
        for group, saved in zip(self.groups.values(), state.groups, strict=True):
            group.restore(saved)
        self.time = state.time
        self.slopes[:], self.spans[:] = state.slopes, state.spans
        self.next_events = dict(state.next_events)
        self._stale = False

    def free_state(self, state: Any) -> None:
        super().free_state(state.parts)

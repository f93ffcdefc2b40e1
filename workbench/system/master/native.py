"""What the kernel's master works on: units, their inputs and outputs, as its structures."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workbench.core.values.arrays import Floats
from workbench.core.values.calendar import Sampler
from workbench.fmi.access import VariableAccess
from workbench.fmi.c_array import c_array
from workbench.fmi.instants import Instants
from workbench.fmi.variable import Variable
from workbench.kernel.native_access import join_access, native_access, value_type
from workbench.kernel.native_forcing import NativeForcing
from workbench.kernel.native_record import NativeRecord
from workbench.kernel.native_system import NativeSystem
from workbench.kernel.structs import Access as NativeAccess
from workbench.kernel.structs import Control, Master, UnitStruct
from workbench.session.forcing import Forcing
from workbench.signals.kinds import Table
from workbench.system.master.group_unit import GroupUnit
from workbench.system.master.instance import MasterInstance
from workbench.system.master.units import moves

__all__ = ["NativeMaster"]


_LINE = Table((0.0, 1.0), (0.0, 1.0))  # its numbers are the kernel's


@dataclass(frozen=True)
class _Inlet:
    """An input of a unit that is connected or forced.

    Attributes:
        component, variable: what is written.
        source: number of the connection, or that of all connections + place of the forced input.
    """

    component: int
    variable: Variable
    source: int


class NativeMaster:
    """The kernel's view of a master; its arrays are made anew when other inputs are forced.

    Args:
        master: the instance; its arrays are shared with the kernel.
        system: its components.
        tolerance: of one step, which is controlled then; None: the step is fixed.

    Attributes:
        structure: what the kernel works on.
        control: of the step; None: there is none.
    """

    control: Control | None = None

    def __init__(self, master: MasterInstance, system: NativeSystem, *, tolerance: float | None = None) -> None:
        decided = master.decided
        self._instance, self._system = master, system
        self._kept: list[Any] = []
        self._forced: tuple[str, ...] | None = None
        connections = decided.units.connections
        n = len(connections)
        crosses = set(decided.units.outer())
        held = [i in crosses and decided.units.ends(i)[0] in decided.held for i in range(n)]
        ends = np.cumsum([len(stage) for stage in decided.stages])
        self._late = np.zeros(n, dtype=np.int32)
        nobody = NativeRecord(system, [])
        nobody.structure.keep = 0
        self._fixed = [nobody, master]
        self.structure = Master(
            n_units=len(decided.units.units),
            order=self._fixed_array([k for stage in decided.stages for k in stage], np.uintp),
            stages=self._fixed_array(ends.tolist(), np.uintp),
            n_stages=len(ends),
            from_held=self._fixed_array(held, np.int32),
            late=self._late.ctypes.data,
            moves=self._fixed_array([moves(c.source) for c in connections], np.int32),
            known=self._fixed_array([0] * n, np.int32),
            start=self._fixed_array([0.0] * n, np.float64),
            reached=self._fixed_array([0.0] * n, np.float64),
            slopes=master.slopes.ctypes.data,
            spans=master.spans.ctypes.data,
            nobody=nobody.address,
            hold_inputs=decided.hold_inputs,
            extrapolation=decided.extrapolation,
        )
        self.address = ctypes.addressof(self.structure)
        if tolerance is not None:
            self._control(tolerance)

    def _control(self, tolerance: float) -> None:
        """Let the step be controlled by connected values and outputs."""
        master, system = self._instance, self._system
        wires, outputs = sorted(master.decided.units.outer()), master.watched()
        self._least = master.least()
        self._scale = self._least.copy()
        access = NativeRecord(system, [(result, part) for part, result in (master.ports(v)[0] for v in outputs)])
        self.control = Control(
            tolerance=tolerance,
            step=math.nan,
            wires=self._fixed_array(wires, np.uintp),
            n_wires=len(wires),
            outputs=access.structure.access,
            n_outputs=len(outputs),
            scale=self._scale.ctypes.data,
            coarse=self._fixed_array([0.0] * len(self._least), np.float64),
            fine=self._fixed_array([0.0] * len(self._least), np.float64),
            states=self._fixed_array([0] * len(system.instances), np.uintp),
        )
        self._fixed.append(access)
        self.structure.control = ctypes.addressof(self.control)

    def memory(self) -> tuple[float, Floats] | None:
        """Return what is known about the step."""
        return None if self.control is None else (float(self.control.step), self._scale.copy())

    def resume(self, memory: object) -> None:
        """Go on with what `memory` returned."""
        if self.control is not None and isinstance(memory, tuple):
            self.control.step, self._scale[:] = memory

    def __del__(self) -> None:
        if self.control is not None:
            self._system.library.kernel_record_free(ctypes.addressof(self.control) + Control.trial.offset)

    def _fixed_array(self, values: Sequence[float], dtype: type[Any]) -> int:
        array = np.array(values, dtype=dtype)
        self._fixed.append(array)
        return int(array.ctypes.data)

    def _array(self, values: Sequence[float], dtype: type[Any] = np.float64) -> int:
        """Keep an array until other inputs are forced; return where it begins."""
        array: NDArray[Any] = np.array(values, dtype=dtype)
        self._kept.append(array)
        return int(array.ctypes.data)

    # -- before and after a run -----------------------------------------------------------------

    def ready(self, cs: int, forcing: Forcing, *, event_due: bool) -> None:
        """Make all ready for a run from where the instance stands.

        Args:
            cs: address of the kernel's session.
            forcing: the signals in force.
            event_due: the event iteration at the end of the last step is to be made.
        """
        master, system = self._instance, self._system
        master.refresh()
        if self._forced != forcing.names:
            self._force(cs, forcing)
        self.structure.event_due = event_due
        for number, component in enumerate(system.components):
            component.due = master.next_events.get(number, -math.inf)
        for unit, group in zip(self._units, self._groups, strict=True):
            if group is not None:
                group.apply()
                unit.stale = True

    def take_over(self, time: float) -> None:
        """Tell the instance where the run ended [s]."""
        master, components = self._instance, self._system.components
        master.stands(time, {number: float(components[number].due) for number in master.next_events})
        master.late.update(np.flatnonzero(self._late).tolist())

    def takes(self, number: int) -> str:
        """Return how a unit takes its inputs over a step: "start" or "middle" value, or "slope"."""
        unit = self._units[number]
        if unit.component < 0:
            return "slope"
        if unit.as_start:
            return "start"
        component = self._system.components[unit.component]
        return "slope" if component.interpolates and component.slopes_work else "middle"

    # -- units ----------------------------------------------------------------------------------

    def _force(self, cs: int, forcing: Forcing) -> None:
        """Make the units for the inputs that are forced from now on."""
        self._kept = []
        n = len(forcing.names)
        for name in ("ramps", "bows", "ramped"):
            setattr(self.structure, name, self._array([0.0] * n))
        inlets = self._forced_inlets(forcing)
        count = len(self._instance.decided.units.units)
        pairs = [self._unit(k, [*self._connected(k), *inlets.get(k, ())]) for k in range(count)]
        array = (UnitStruct * count)(*(unit for unit, _ in pairs))
        self._kept.append(array)
        self.structure.units = ctypes.addressof(array)
        self._units, self._groups = list(array), [group for _, group in pairs]
        self._forced = forcing.names
        if self.control is not None:
            self.control.saved = self._array([0.0] * self._system.library.kernel_control_doubles(cs))

    def _connected(self, number: int) -> list[_Inlet]:
        connections = self._instance.decided.units.connections
        incoming = self._instance.decided.units.units[number].incoming
        return [_Inlet(connections[i].to_component, connections[i].destination, i) for i in incoming]

    def _forced_inlets(self, forcing: Forcing) -> Mapping[int, list[_Inlet]]:
        """Return for each unit its forced inputs that may move; where inputs are held there are none."""
        decided = self._instance.decided
        result: dict[int, list[_Inlet]] = {}
        if decided.hold_inputs:
            return result
        for place, (variable, _, _) in enumerate(forcing.inputs()):
            for component, inner in self._instance.ports(variable) if variable.is_continuous_input else ():
                inlet = _Inlet(component, inner, len(decided.units.connections) + place)
                result.setdefault(decided.units.of[component], []).append(inlet)
        return result

    def _unit(self, number: int, inlets: Sequence[_Inlet]) -> tuple[UnitStruct, NativeForcing | None]:
        decided, n = self._instance.decided, len(inlets)
        about = decided.units.units[number]
        connections = [decided.units.connections[i] for i in about.outgoing]
        samplers = self._instance.ticks.get(number, ())
        ports = [(i.component, i.variable) for i in inlets]
        moving = [i.variable.is_continuous_input for i in inlets]
        unit = UnitStruct(
            component=-1 if about.group else about.members[0],
            held=number in decided.held,
            as_start=decided.hold_inputs or number in decided.held,
            sources=self._array([i.source for i in inlets], np.uintp),
            types=self._array([self._type(*port) for port in ports], np.int32),
            moving=self._array(moving, np.int32),
            ends=self._array([math.nan] * n),
            **{name: self._array([0.0] * n) for name in ("starts", "bows", "values", "rates")},
            orders=self._array([1] * n, np.int32),
            n=n,
            inlet=self._access(ports, range(n)),
            fast=self._access(ports, [i for i in range(n) if moving[i]]),
            outgoing=self._array(about.outgoing, np.uintp),
            raw=self._array([0.0] * len(connections)),
            n_outgoing=len(connections),
            outlet=self._access([(c.from_component, c.source) for c in connections], range(len(connections))),
            instants=self._instants(samplers),
            n_instants=len(samplers),
            members=self._array(about.members, np.uintp),
            n_members=len(about.members),
        )
        return unit, self._group(unit, self._instance.groups[number], ports) if about.group else None

    def _group(self, unit: UnitStruct, group: GroupUnit, ports: Sequence[tuple[int, Variable]]) -> NativeForcing:
        """Let the group's own session be forced by its inputs."""
        system, number = group.compiled.loop.system, {c: k for k, c in enumerate(group.members)}
        inputs = [(variable, _LINE, 0.0, ((number[c], variable),)) for c, variable in ports]
        forcing = NativeForcing(system, inputs, longest_step=math.inf)
        self._kept.append(forcing)
        n = len(ports)
        times, tables = self._array([0.0, 0.0]), self._array([0.0] * 2 * n)
        for i, signal in enumerate(forcing.signals):
            signal.times, signal.values, signal.n = times, tables + 16 * i, 2
        unit.me = ctypes.addressof(group.compiled.native)
        unit.signals, unit.times, unit.tables = ctypes.addressof(forcing.signals), times, tables
        return forcing

    def _instants(self, samplers: Sequence[Sampler]) -> int:
        array = c_array(Instants, [Instants.of(s) for s in samplers])
        self._kept.append(array)
        return ctypes.addressof(array)

    def _type(self, component: int, variable: Variable) -> int:
        return value_type(self._system.instances[component].TYPES[variable.type])

    def _access(self, ports: Sequence[tuple[int, Variable]], chosen: Sequence[int]) -> NativeAccess:
        """Return access to some of these variables, in columns that are their places."""
        parts = []
        for component in dict.fromkeys(ports[i][0] for i in chosen):
            own = [i for i in chosen if ports[i][0] == component]
            access: VariableAccess = self._system.instances[component].access([ports[i][1] for i in own])
            parts.append(native_access(access, columns=own, component=component))
        if not parts:
            return NativeAccess()
        native, kept = join_access(parts)
        self._kept.append(kept)
        return native

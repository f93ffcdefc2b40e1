"""A list of FMU instances as the kernel's structures; a single FMU is a list of one."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.fmi.c_array import c_array
from workbench.fmi.instance import Instance
from workbench.fmi.variable import Variable
from workbench.fmi.wiring import Wiring
from workbench.kernel.library import kernel
from workbench.kernel.native_signals import Trouble
from workbench.kernel.native_wiring import native_wiring
from workbench.kernel.structs import FUNCTIONS, Component, System

__all__ = ["NativeSystem"]

_NAMES: Mapping[int, Mapping[str, str]] = {
    1: {
        "completed_step": "fmi1CompletedIntegratorStep",
        "update_discrete_states": "fmi1EventUpdate",
        "do_step": "fmi1DoStep",
    },
    2: {
        "completed_step": "fmi2CompletedIntegratorStep",
        "enter_event_mode": "fmi2EnterEventMode",
        "enter_continuous_mode": "fmi2EnterContinuousTimeMode",
        "update_discrete_states": "fmi2NewDiscreteStates",
        "do_step": "fmi2DoStep",
        "set_slopes": "fmi2SetRealInputDerivatives",
        "get_directional": "fmi2GetDirectionalDerivative",
    },
    3: {
        "completed_step": "fmi3CompletedIntegratorStep",
        "enter_event_mode": "fmi3EnterEventMode",
        "enter_continuous_mode": "fmi3EnterContinuousTimeMode",
        "enter_step_mode": "fmi3EnterStepMode",
        "update_discrete_states": "fmi3UpdateDiscreteStates",
        "do_step": "fmi3DoStep",
        "get_directional": "fmi3GetDirectionalDerivative",
        "set_clock": "fmi3SetClock",
        "get_interval": "fmi3GetIntervalDecimal",
        "get_clock": "fmi3GetClock",
    },
}


class NativeSystem:
    """The components and their connections, in the order in which they are evaluated.

    Args:
        instances: the FMUs; they must stay open as long as this is used.
        wiring: their connections, on whose arrays the kernel works; None: there are none.

    Attributes:
        instances: the FMUs.
        structure: what the kernel works on.
        trouble: holds what callbacks into Python raised.
    """

    def __init__(self, instances: Sequence[Instance], wiring: Wiring | None = None) -> None:
        self.library = kernel()
        self.instances = tuple(instances)
        self.trouble = Trouble()
        self._holds = False
        self._kept: list[Any] = []
        circles = [False] * len(instances) if wiring is None else wiring.in_circle
        self.components = c_array(
            Component, [self._component(i, in_circle=c) for i, c in zip(instances, circles, strict=True)]
        )
        self.structure = System(
            components=ctypes.addressof(self.components),
            n_components=len(instances),
        )
        if wiring is not None and wiring.connections:
            kept = native_wiring(self.structure, self.instances, wiring)
            self._kept.append(kept)
        self.address = ctypes.addressof(self.structure)
        self.library.kernel_system_open(self.address)

    def _component(self, instance: Instance, *, in_circle: bool) -> Component:
        names = {**instance.CALLS, **_NAMES[instance.version]}
        texts = [names.get(f, f) for f in FUNCTIONS]
        functions = c_array(ctypes.c_void_p, [instance.library.address(t) for t in texts])
        words = c_array(ctypes.c_char_p, [t.encode() for t in texts])
        self._kept += [functions, words]
        capabilities = instance.capabilities
        return Component(
            handle=instance.component,
            functions=ctypes.addressof(functions),
            names=ctypes.addressof(words),
            nx=instance.nx,
            nz=instance.nz,
            version=instance.version,
            event_mode=instance.event_mode,
            completed_step=capabilities.completed_step,
            interpolates=capabilities.interpolates_inputs,
            slopes_work=True,
            centres=capabilities.variable_step,
            time=instance.time,
            due=-math.inf,
            clock=instance.clock,
            clocks=instance.clocks_address,
            intermediate=None if instance.intermediate is None else ctypes.addressof(instance.intermediate),
            in_circle=in_circle and capabilities.state and instance.clocks_address is None,
            saved=ctypes.addressof(instance.saved),
            longest=instance.longest_address,
        )

    def without_slopes(self) -> None:
        """Give no slopes of inputs, also to FMUs that take them."""
        for component in self.components:
            component.slopes_work = False

    def hold_inputs(self) -> None:
        """Let inputs stand over a step as they are at its start, also where FMUs take slopes."""
        for component in self.components:
            component.slopes_work = component.centres = False
        self._holds = True

    def answer(self, forced: Iterable[tuple[int, Variable]]) -> None:
        """Say which FMUs may ask for their inputs between communication points: those that take all of them there.

        Args:
            forced: continuous inputs, each with the number of its component.
        """
        inputs = list(forced)
        for number, instance in enumerate(self.instances):
            if instance.intermediate is not None:
                takes = instance.description.intermediate
                mine = [v for owner, v in inputs if owner == number]
                instance.intermediate.answers = not self._holds and all(v.value_reference in takes for v in mine)

    @property
    def event_due(self) -> bool:
        """Whether an event of co-simulation at the end of the last step waits for the inputs there."""
        return any(bool(component.event_due) for component in self.components)

    @event_due.setter
    def event_due(self, due: bool) -> None:
        for component in self.components:
            component.event_due = due

    def sync_times(self) -> None:
        """Tell the façade how far the kernel brought each FMU."""
        for instance, component in zip(self.instances, self.components, strict=True):
            instance.time = component.time

    def set_times(self, time: float) -> None:
        """Tell the kernel at which time the FMUs stand [s]."""
        for component in self.components:
            component.time = time

    def time_steps(self, time: float, step: float, count: int, patience: float) -> Floats:
        """Return how long each communication step of a single FMU takes, without Python between them, shape (k,) [s].

        Args:
            time: where it stands [s].
            step: [s].
            count: of steps; one that fails, ends early or asks to end is not among them, and is the last.
            patience: after which no further one begins [s].
        """
        seconds = np.empty(count)
        address = ctypes.addressof(self.structure)
        made = self.library.kernel_time_steps(address, time, step, count, patience, seconds.ctypes.data)
        return seconds[:made]

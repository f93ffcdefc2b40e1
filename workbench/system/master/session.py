"""A session on a system with co-simulation components."""

from __future__ import annotations

import ctypes

import numpy as np

from workbench.errors import InputError
from workbench.kernel.structs import Cs
from workbench.session.compiled import CompiledCsSession
from workbench.session.fmu import Setup
from workbench.session.loop import InnerLoop
from workbench.system.master.instance import MasterInstance
from workbench.system.master.native import NativeMaster
from workbench.system.master.rehearsal import RehearsingSession

__all__ = ["MasterSession"]

_SHORTEST = 1e-4  # of the first step: shorter ones are taken as they are


class MasterSession(RehearsingSession, CompiledCsSession):
    """Steps the whole system from one communication point to the next, in compiled code.

    Communication points are those of `CsSession`, and the instants at which something is known to happen in a
    component: samples, time events, connections that close; components with a constant step know only their grid.

    Args:
        setup: see `Setup`.
        tolerance: of one step, which is controlled then; None: the step is fixed.
        rehearses: see `RehearsingSession`.
    """

    def __init__(self, setup: Setup, *, tolerance: float | None = None, rehearses: bool = False) -> None:
        self._tolerance = tolerance
        super().__init__(setup, rehearses=rehearses)

    @property
    def master(self) -> MasterInstance:
        """The system's instance."""
        instance = self.instance
        if not isinstance(instance, MasterInstance):
            raise InputError("this session is not one of a system with co-simulation components")
        return instance

    def takes(self, number: int) -> str:
        """Return how a unit takes its inputs over a step: "start" or "middle" value, or "slope"."""
        return self._bridge.takes(number)

    def _started(self, due: float) -> None:
        super()._started(due)
        self._bridge = NativeMaster(self.master, self.loop.system, tolerance=self._tolerance)
        self._native.master = self._bridge.address

    def _make_loop(self) -> InnerLoop:
        super()._make_loop()
        master = self.master
        self._loop = InnerLoop(
            master, self.setup.solver, names=master.decided.names, unit=lambda number: master.groups[number].failed()
        )
        return self._loop

    def _ready(self, until: float) -> Cs:
        native = super()._ready(until)
        self._bridge.ready(ctypes.addressof(native), self.forcing, event_due=self._event_due)
        control = self._bridge.control
        if control is not None and until > self.time:
            if np.isnan(control.step):
                control.step = native.longest
            control.least, control.longest = _SHORTEST * native.longest, 0.0
        return native

    def _take_over(self) -> None:
        super()._take_over()
        self._event_due = bool(self._bridge.structure.event_due)
        self._bridge.take_over(self.time)
        control = self._bridge.control
        if control is not None and control.longest > 0.0:
            self.communication_step = control.longest

    # -- snapshots ----------------------------------------------------------------------------

    def _memory(self) -> object:  # type: ignore[override]  # more than that of its base
        return super()._memory(), self._bridge.memory()

    def _resume(self, memory: object) -> None:
        if not isinstance(memory, tuple) or len(memory) != 2:
            raise InputError("this snapshot belongs to another kind of session")
        super()._resume(memory[0])
        self._bridge.resume(memory[1])

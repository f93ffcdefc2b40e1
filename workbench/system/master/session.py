"""A session on a system with co-simulation components."""

from __future__ import annotations

import ctypes
from abc import abstractmethod
from collections.abc import Mapping, Sequence

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.errors import InputError, SimulationError
from workbench.fmi.variable import Variable
from workbench.kernel.structs import Cs
from workbench.session.compiled import CompiledCsSession
from workbench.session.cs import CsSession
from workbench.session.loop import InnerLoop
from workbench.session.setup import Setup
from workbench.signals.kinds import Signal
from workbench.system.master.instance import MasterInstance
from workbench.system.master.native import NativeMaster

__all__ = ["MasterSession", "RehearsingSession"]

_SHORTEST = 1e-4  # of the first step: shorter ones are taken as they are
# A slope is settled when one more rehearsal changes it by less than this part; each of them carries slopes one
# feed-through further, so there are seldom more than three.
_SETTLED, _MOST = 0.01, 10


class RehearsingSession(CsSession):
    """A session on a master whose connected values go on along parabolas.

    Before the first step nothing is known of how connected values move, and a value that stands still over one step
    leaves an error of h² for good, where all others leave h³. So that step is made, the components go back to where
    they stood, and it is made again, with the slopes that it has shown; until these no longer change. That is a
    waveform iteration on the first step. Not where the states of components cannot be saved.

    Args:
        setup: see `Setup`.
        rehearses: whether the first step is made again.

    Source: E. Hairer, S. Nørsett, G. Wanner, Solving Ordinary Differential Equations I, 2nd ed., III.1 (the starting
    values of multistep methods, by iteration).
    """

    def __init__(self, setup: Setup, *, rehearses: bool = False) -> None:
        self._rehearses = rehearses
        super().__init__(setup)

    @property
    @abstractmethod
    def master(self) -> MasterInstance:
        """The system's instance."""

    def _set_out(
        self, until: float, signals: Mapping[str, Signal], record: Sequence[str], points: Floats | None
    ) -> tuple[Floats, list[Variable], bool]:
        result = super()._set_out(until, signals, record, points)
        unknown = self._rehearses and not self.master.spans.any() and until > self.time
        if unknown and self.setup.state_works():
            self._rehearse(until, new=result[2])
        return result

    def _rehearse(self, until: float, *, new: bool) -> None:
        """Find the slopes of the first step towards `until` [s]."""
        saved, master, calls = self.snapshot(), self.master, list(self._calls)
        end = min(until, self.time + self._choose_step(until))
        for _ in range(_MOST):
            before = master.slopes[0].copy()
            try:
                self._advance(end, np.array([end]), [], new=new)
            except SimulationError:  # the step itself will tell, with what was recorded before
                if not self.instance.healthy:
                    raise
                self.restore(saved)
                break
            slopes = master.slopes[0].copy()
            self.restore(saved)
            master.slopes[0] = slopes
            if np.all(np.abs(slopes - before) <= _SETTLED * np.maximum(np.abs(slopes), np.abs(before))):
                break
        self._calls = calls  # a replay comes here by itself
        self.instance.free_state(self._states.pop())


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

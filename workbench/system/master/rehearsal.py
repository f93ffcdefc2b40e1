"""The first step of a master, made again with the slopes that it showed."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.errors import SimulationError
from workbench.fmi.variable import Variable
from workbench.session.cs import CsSession
from workbench.session.fmu import Setup
from workbench.signals.kinds import Signal
from workbench.system.master.instance import MasterInstance

__all__ = ["RehearsingSession"]

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
        found = super()._set_out(until, signals, record, points)
        unknown = self._rehearses and not self.master.spans.any() and until > self.time
        if unknown and self.setup.state_works():
            self._rehearse(until, new=found[2])
        return found

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

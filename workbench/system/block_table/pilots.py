"""Pilots in a closed loop: a gain, a lead–lag and a delay, in the forms in which they were published."""

from __future__ import annotations

import numpy as np

from workbench.core.records.option import option
from workbench.errors import InputError
from workbench.system.block_table.base import BlockStateSpace
from workbench.system.block_table.linear import PADE, PAST, DelayBlock, realised

__all__ = ["CrossoverPilot", "NealSmithPilot"]

_PILOTS = "pilots"


class NealSmithPilot(DelayBlock):
    """Pilot of Neal and Smith: gain, lead, lag, and a delay of 0.3 s.

    With it the pitch attitude is closed; the lead that the pilot has to give for a wanted bandwidth, and the resonance
    of the closed loop, rate the aircraft. A pilot who is a gain and nothing else is `gain`.

    Source: T. P. Neal, R. E. Smith, A flying qualities criterion for the design of fighter flight-control systems,
    J. Aircraft 8 (1971) 10.
    """

    kind = "neal_smith_pilot"
    group = _PILOTS
    equations = "y = gain · (lead s + 1) / (lag s + 1) · e^(−delay s) u"
    gain: float = option("Gain at low frequencies.", default=1.0)
    lead: float = option("Time constant of the lead.", default=0.0, unit="s", least=0.0)
    lag: float = option("Time constant of the lag.", default=0.0, unit="s", least=0.0)
    delay: float = option("Delay of the pilot.", default=0.3, unit="s", positive=True)
    past: float | None = option(PAST, default=None)
    pade: int = option(PADE, default=4, least=1, below=21)

    @property
    def lags(self) -> tuple[float, ...]:
        """Time constants of the denominator [s]."""
        return (self.lag,)

    @property
    def times(self) -> tuple[float, float]:
        return self.delay, self.delay

    def filter(self) -> BlockStateSpace:
        below = np.array([1.0])
        for lag in self.lags:
            below = np.polymul(below, [lag, 1.0] if lag > 0.0 else [1.0])
        if self.lead > 0.0 and len(below) == 1:
            raise InputError(f"lead = {self.lead:g} s needs a lag above 0: a lead alone cannot be simulated")
        return realised([self.gain * self.lead, self.gain], below.tolist())


class CrossoverPilot(NealSmithPilot):
    """Pilot of McRuer: gain, lead and lag by which he adapts to the aircraft, the lag of his arm, and a delay.

    He adapts so that pilot and aircraft together are about wc · e^(−te s)/s around the crossover frequency wc (the
    crossover model), with te = delay + neuromuscular. For an aircraft like 1/s that takes the gain alone, for one like
    1/s² a lead, for one like a gain a lag.

    Source: D. T. McRuer, H. R. Jex, A review of quasi-linear pilot models, IEEE Trans. Human Factors in Electronics
    HFE-8 (1967) 3.
    """

    kind = "crossover_pilot"
    equations = "y = gain · (lead s + 1) / ((lag s + 1) (neuromuscular s + 1)) · e^(−delay s) u"
    neuromuscular: float = option("Time constant of the arm's lag.", default=0.1, unit="s", least=0.0)
    delay: float = option("Reaction time.", default=0.1, unit="s", positive=True)

    @property
    def lags(self) -> tuple[float, ...]:
        return self.lag, self.neuromuscular

"""The period maps of a forced model over frequency, amplitude or a parameter."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.errors import InputError, SimulationError
from workbench.model import Model
from workbench.model.varied import with_parameters
from workbench.response.periodic.fourier import fundamental
from workbench.response.periodic.period_map import FEW_STATES, NUDGE, Lap, PeriodMap
from workbench.response.periodic.place import Family
from workbench.response.periodic.timed import changes_with_time
from workbench.session.compiled import CompiledMeSession

__all__ = ["ForcedPeriodMaps", "near"]


@dataclass
class ForcedPeriodMaps(Family):
    """Period maps of a forced model.

    Attributes:
        model: stays open.
        input, output: names.
        vary: "frequency", "amplitude", or a parameter.
        low, high: bounds of what is varied.
        frequency, amplitude: of the forcing; what is varied has no effect.
        centre: about which the forcing moves.
        order: how many periods of the forcing the motion takes.
        count: number of periods run.
        stopped: asked before each period; true ends it by KeyboardInterrupt.
    """

    model: Model
    input: str
    output: str
    vary: str
    low: float
    high: float
    frequency: float
    amplitude: float
    centre: float = 0.0
    order: int = 1
    count: int = 0
    stopped: Callable[[], bool] = lambda: False
    _open: ExitStack = field(default_factory=ExitStack, repr=False)
    _map: PeriodMap | None = None
    _value: float | None = None

    coarse: ClassVar[int] = 12
    fine: ClassVar[int] = 100

    def close(self) -> None:
        """Close what is open. Any number of times."""
        self._open.close()
        self._map = None

    def again(
        self,
        *,
        order: int | None = None,
        amplitude: float | None = None,
        low: float | None = None,
        high: float | None = None,
    ) -> ForcedPeriodMaps:
        """Return the same family with another order, amplitude or band; None: the same."""
        return replace(
            self,
            order=self.order if order is None else order,
            amplitude=self.amplitude if amplitude is None else amplitude,
            low=self.low if low is None else low,
            high=self.high if high is None else high,
            count=0, _open=ExitStack(), _map=None, _value=None,
        )  # fmt: skip

    @property
    def is_logarithmic(self) -> bool:
        """Whether equal steps of the parameter are equal ratios of what is varied."""
        return self.vary in {"frequency", "amplitude"}

    def value(self, p: float) -> float:
        """Return what is varied at a parameter."""
        if self.is_logarithmic:
            return float(self.low * (self.high / self.low) ** p)
        return self.low + (self.high - self.low) * p

    def parameter(self, value: float) -> float:
        """Return the parameter at which what is varied has a value."""
        if self.is_logarithmic:
            return math.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)

    def forcing(self, p: float) -> tuple[float, float]:
        """Return frequency [Hz] and amplitude of the forcing at a parameter."""
        value = self.value(p)
        frequency = value if self.vary == "frequency" else self.frequency
        return frequency, value if self.vary == "amplitude" else self.amplitude

    def start(self, p: float) -> Floats:
        """Return the states where the model starts, shape (n,)."""
        self.close()
        return self._at(p).session.stand()

    def run(self, x: Floats | None, p: float, *, intervals: int = 0) -> Lap:
        """Run one period from x, or from where the last one has ended.

        Raises:
            SimulationError: the model cannot be run there; what comes next begins in a new session.
        """
        if self.stopped():
            raise KeyboardInterrupt
        frequency, amplitude = self.forcing(p)
        self.count += self.order
        try:
            return self._at(p).lap(frequency, amplitude, x, intervals=intervals)
        except (SimulationError, InputError) as error:
            self.close()
            raise SimulationError(str(error)) from error

    def refuse_timed(self, lap: Lap, p: float) -> None:
        """Refuse a model whose period map is another one in each period.

        Args:
            lap: the last one that was run.
            p: its parameter.

        Raises:
            InputError: the model changes with time itself.
        """
        moved, size = np.maximum(lap.unit, np.abs(lap.x1 - lap.x0)), abs(fundamental(lap.period.harmonics))
        if changes_with_time(self._at(p).session, self.output, moved, size, 1.0 / self.forcing(p)[0]):
            raise InputError(
                f"branches: {self.model.name} changes with time itself (a ripple, a gust, a ramp), so that no response "
                "repeats; use nfr, which tells that apart, or set it to zero (`start_values`)"
            )

    def lap(self, x: Floats, p: float, *, exact: bool = False) -> tuple[Lap, Floats]:
        """Run one period from x; return it with its derivative, and ∂x1/∂p; see `Family`."""
        lap = self.run(x, p, intervals=self.fine if exact else self.intervals)
        if self.by_differences:
            frequency, amplitude = self.forcing(p)
            self.count += self.order * len(x)
            try:
                lap = self._at(p).by_differences(lap, frequency, amplitude)
            except (SimulationError, InputError) as error:
                self.close()
                raise SimulationError(str(error)) from error
        if self.vary == "frequency" and lap.tangent is not None and not self.by_differences:
            longer = -self.order / self.value(p) * math.log(self.high / self.low)
            return lap, lap.tangent.stretch * longer
        moved = self.run(x, p + NUDGE)
        return lap, (moved.x1 - lap.x1) / NUDGE

    def _at(self, p: float) -> PeriodMap:
        value = None if self.is_logarithmic else self.value(p)
        if self._map is None or value != self._value:
            self._open.close()
            model = self.model if value is None else with_parameters(self.model, {self.vary: value})
            session = self._open.enter_context(model.open_session())
            if not isinstance(session, CompiledMeSession):
                way = model.way_out()
                raise InputError(f"branches: the states of co-simulation cannot be set while it runs; {way}")
            self._map = PeriodMap(session, self.output, self.input, self.centre, order=self.order)
            self._value = value
        return self._map

    @property
    def may_differ(self) -> bool:
        """Whether the model has few enough states for differences of whole periods."""
        return len(self.model.states) <= FEW_STATES and not self.by_differences


def near(a: Floats, b: Floats, unit: Floats) -> float:
    """Return how far two states are apart, in units of the motion."""
    return float(np.max(np.abs(a - b) / unit, initial=0.0))

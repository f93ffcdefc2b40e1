"""When an experiment samples: the model's own sampling, and on which side of it inputs change."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from workbench.analysis.rates import TOGETHER, basic_period, rates_of, time_events
from workbench.core.operating_point import OperatingPoint
from workbench.errors import InputError
from workbench.model import DescribedModel, Model

__all__ = ["Sampling", "sampling_of"]

LEAD = 1e-6  # of an interval: how long before a sample of the model the input changes
_MULTIPLE = 1e-6  # likewise, of the interval and the model's period


@dataclass(frozen=True)
class Sampling:
    """The grid of an experiment.

    Attributes:
        dt: sampling interval [s].
        period: of a sampled model [s]; None: continuous, or not known.
        first: first sample of the model after its start [s]; None likewise.
        lead: time by which inputs change before a sample of the model, and outputs are read after it [s].
        late: outputs are read at the end of the interval: a sampled co-simulation that takes no short steps.
        notes: what was chosen and what does not fit.
    """

    dt: float
    period: float | None = None
    first: float | None = None
    lead: float = 0.0
    late: bool = False
    notes: tuple[str, ...] = ()

    def begin(self, earliest: float) -> float:
        """Return the first sample at or after a time that falls on the model's own [s]."""
        if self.period is None or self.first is None:
            return earliest
        return self.first + self.period * max(0, int(np.ceil((earliest - self.first) / self.period - _MULTIPLE)))


def sampling_of(model: Model, at: OperatingPoint | None, dt: float | None) -> Sampling:
    """Return the grid for a model.

    Args:
        model: what will run.
        at: where it starts; None: at its start values.
        dt: sampling interval [s]; None: the model's own period.

    Raises:
        InputError: no interval, neither given nor the model's own.
    """
    ticks = time_events(model, at)
    rates = rates_of(ticks, at)
    period = float(f"{basic_period(rates, TOGETHER):.12g}") if rates else None
    if dt is None and period is None:
        raise InputError(f"{model.name}: has no sampling period of its own; give the sampling interval (--step, dt)")
    interval = dt or period or 0.0
    if period is None:
        return Sampling(interval)
    steady = model.interface == "cs" and not _steps_vary(model)
    return Sampling(
        dt=interval,
        period=period,
        first=float(ticks[0]) if len(ticks) else (at.time if at else model.start_time) + period,
        lead=0.0 if steady else LEAD * min(interval, period),
        late=steady,
        notes=_remarks(interval, period, rates, chosen=dt is None),
    )


def _remarks(dt: float, period: float, rates: Sequence[float], *, chosen: bool) -> tuple[str, ...]:
    several = f", in which its samples every {', '.join(f'{r:.6g}' for r in rates)} s repeat" if len(rates) > 1 else ""
    if chosen:
        return (f"sampled every {period:.6g} s, the model's own period{several}",)
    ratio = dt / period
    if ratio < 1.0 - _MULTIPLE or abs(ratio - round(ratio)) > _MULTIPLE * ratio:
        what = f"the sampling interval {dt:.6g} s is not a multiple of the model's own period {period:.6g} s{several}"
        return (f"{what}: its samples fall at changing times within the interval; use a multiple",)
    return ()


def _steps_vary(model: Model) -> bool:
    return not isinstance(model, DescribedModel) or model.description.interfaces["cs"].variable_step

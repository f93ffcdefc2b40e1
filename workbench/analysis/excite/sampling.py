"""When an experiment samples: the model's own sampling, and on which side of it inputs change."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from workbench.analysis.lin.rates import basic_period, sample_periods
from workbench.core.operating_point import OperatingPoint
from workbench.errors import InputError, WorkbenchError
from workbench.model import DescribedModel, Model
from workbench.session.base import Floats

__all__ = ["Sampling", "sample_rates", "sampling_of"]

LEAD = 1e-6  # of an interval: so long before a sample of the model the input changes
_LOOK = 64  # events of the model that tell its rates
_TOGETHER = 1e-6  # relative tolerance in which rates have a common multiple
_MULTIPLE = 1e-6  # likewise, of the interval and the model's period


@dataclass(frozen=True)
class Sampling:
    """The grid of an experiment.

    Attributes:
        dt: sampling interval [s].
        period: of a sampled model [s]; None: continuous, or not known.
        first: first sample of the model after its start [s]; None likewise.
        lead: inputs change so long before a sample of the model, and outputs are read so long after it [s].
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
        InputError: no interval, neither given nor the model's own, or it is not positive.
    """
    if dt is not None and not (np.isfinite(dt) and dt > 0.0):
        raise InputError(f"step: the sampling interval must be positive, not {dt:g} s")
    ticks = _ticks(model, at)
    rates = _rates(ticks, at)
    period = float(f"{basic_period(rates, _TOGETHER):.12g}") if rates else None
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


def sample_rates(model: Model) -> tuple[float, ...]:
    """Return the sample periods of a model where it starts [s], rising; none: it is continuous, or shows none."""
    return _rates(_ticks(model, None), None)


def _remarks(dt: float, period: float, rates: Sequence[float], *, chosen: bool) -> tuple[str, ...]:
    several = f", in which its samples every {', '.join(f'{r:.6g}' for r in rates)} s repeat" if len(rates) > 1 else ""
    if chosen:
        return (f"sampled every {period:.6g} s, the model's own period{several}",)
    ratio = dt / period
    if ratio < 1.0 - _MULTIPLE or abs(ratio - round(ratio)) > _MULTIPLE * ratio:
        what = f"the sampling interval {dt:.6g} s is no multiple of the model's own period {period:.6g} s{several}"
        return (f"{what}: its samples come at changing times within the interval; take a multiple",)
    return ()


def _rates(ticks: Floats, at: OperatingPoint | None) -> tuple[float, ...]:
    """Return the model's sample periods [s]; none: it is continuous, or does not show any."""
    try:
        found = sample_periods(ticks)
        basic_period(found, _TOGETHER)
    except InputError:  # too few events, or none that repeat
        return (at.period,) if at is not None and at.period is not None else ()
    return found


def _ticks(model: Model, at: OperatingPoint | None) -> Floats:
    """Return the first time events of the model's equations; none where they cannot be seen."""
    try:
        if model.interface == "me":
            return _ticks_of(model, at)
        equations = _equations(model)
        if equations is None:
            return np.zeros(0)
        with equations:
            return _ticks_of(equations, at)
    except WorkbenchError:
        return np.zeros(0)


def _ticks_of(model: Model, at: OperatingPoint | None) -> Floats:
    with model.open_point(time=at.time if at else None, values={} if at is None else at.values) as point:
        return point.ticks(_LOOK, np.inf)


def _equations(model: Model) -> Model | None:
    """Return the model exchange side of a co-simulation FMU, where there is one that may be opened besides."""
    if not isinstance(model, DescribedModel) or "me" not in model.description.interfaces:
        return None
    if model.description.interfaces["me"].once_per_process:
        return None
    return replace(model.recipe, interface="me", solver="auto", step=None).open()


def _steps_vary(model: Model) -> bool:
    return not isinstance(model, DescribedModel) or model.description.interfaces["cs"].variable_step

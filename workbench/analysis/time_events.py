"""At which rates a model samples, as its time events show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from workbench.analysis.rates import basic_period, sample_periods
from workbench.core.operating_point import OperatingPoint
from workbench.errors import InputError, WorkbenchError
from workbench.model import DescribedModel, Model
from workbench.session.base import Floats

__all__ = ["TOGETHER", "rates_of", "sample_rates", "time_events"]

TOGETHER = 1e-6  # relative tolerance in which rates have a common multiple
_LOOK = 64  # events of the model that tell its rates


def sample_rates(model: Model) -> tuple[float, ...]:
    """Return the sample periods of a model where it starts [s], rising; none: it is continuous, or shows none."""
    return rates_of(time_events(model, None), None)


def rates_of(ticks: Floats, at: OperatingPoint | None) -> tuple[float, ...]:
    """Return the model's sample periods [s]; none: it is continuous, or does not show any."""
    try:
        found = sample_periods(ticks)
        basic_period(found, TOGETHER)
    except InputError:  # too few events, or none that repeat
        return (at.period,) if at is not None and at.period is not None else ()
    return found


def time_events(model: Model, at: OperatingPoint | None) -> Floats:
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

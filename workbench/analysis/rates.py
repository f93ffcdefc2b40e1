"""Sample rates out of event times, and the basic time period they have in common."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction

import numpy as np

from workbench.core.operating_point import OperatingPoint
from workbench.errors import InputError, WorkbenchError
from workbench.model import DescribedModel, Model
from workbench.session.base import Floats

__all__ = ["TOGETHER", "NoRatesError", "basic_period", "rates_of", "sample_periods", "sample_rates", "time_events"]

_LARGEST_FACTOR = 10_000  # of a period in the basic period
_AGREE = 1e-6  # of the smallest distance: how exactly events keep their rate


class NoRatesError(InputError):
    """Time events that follow no constant rates, or too few to tell."""


def sample_periods(times: Floats) -> tuple[float, ...]:
    """Take event times apart into periodic sequences and return their periods, rising.

    The first event left over and the nearest later one that both belong to a sequence without gaps
    begin a sequence; its events that no other sequence needs are taken out, and so on.

    Args:
        times: shape (n,) [s], rising, all events of a stretch of time.

    Raises:
        NoRatesError: fewer than three events, or they follow no constant rates.
    """
    if len(times) < 3:
        raise NoRatesError("too few time events to find the sample periods; give periods")
    tolerance = _AGREE * float(np.diff(times).min())
    left, found = times, list[float]()
    while len(left):
        period = _period(left, times, tolerance)
        found.append(period)
        grid = left[0] + period * np.arange(round((times[-1] - left[0]) / period) + 1)
        left = np.array([t for t in left if np.abs(grid - t).min() > tolerance])
    return tuple(sorted(found))


def _period(left: Floats, times: Floats, tolerance: float) -> float:
    """Return the period of the sequence that the first of `left` begins."""
    for candidate in left[1:] if len(left) > 1 else ():
        period = float(candidate - left[0])
        points = (times[-1] - left[0] + tolerance) / period
        if not points < len(times):  # each belongs to an event, and events may go on to the end of all numbers
            continue
        count = math.floor(points)
        grid = left[0] + period * np.arange(count + 1)
        if count >= 2 and all(np.abs(times - t).min() <= tolerance for t in grid):
            return float(grid_fit(times, grid))
    raise NoRatesError("the time events have no constant rates; give periods, or use method difference or response")


def grid_fit(times: Floats, grid: Floats) -> float:
    """Return the mean distance of the events nearest to a grid [s]."""
    last = times[np.abs(times - grid[-1]).argmin()]
    return float((last - grid[0]) / (len(grid) - 1))


def basic_period(periods: Sequence[float], btptol: float) -> float:
    """Return the least common multiple of sample periods [s].

    The ratio of each period to the shortest is replaced by the simplest fraction within `btptol`, so that
    all samples of one basic period fall together with a relative error of at most that.

    Args:
        periods: [s].
        btptol: relative tolerance.

    Raises:
        InputError: a period or the tolerance is not positive, or there is no common multiple of reasonable size.

    Source: the source report, chapter 3.1.3.
    """
    if not periods or not all(p > 0.0 and math.isfinite(p) for p in periods):
        raise InputError("periods must be positive")
    if not 0.0 < btptol < 1.0:
        raise InputError(f"btptol must be between 0 and 1, not {btptol:g}")
    shortest = min(periods)
    ratios = [_simplest(p / shortest, btptol) for p in periods]
    multiple = Fraction(1)
    for ratio in ratios:
        top = math.lcm(multiple.numerator * ratio.denominator, ratio.numerator * multiple.denominator)
        multiple = Fraction(top, multiple.denominator * ratio.denominator)
    if multiple > _LARGEST_FACTOR:
        listed = ", ".join(f"{p:.6g}" for p in periods)
        raise InputError(f"sample periods {listed} s have no common multiple within btptol {btptol:g}; enlarge it")
    # The period fits best where most samples are: the mean over all of period · whole number of samples.
    fits = [p * round(float(multiple) / float(r)) for p, r in zip(periods, ratios, strict=True)]
    return float(np.mean(fits))


def _simplest(ratio: float, tolerance: float) -> Fraction:
    """Return the fraction with the smallest denominator within a relative tolerance."""
    for denominator in range(1, _LARGEST_FACTOR):
        candidate = Fraction(round(ratio * denominator), denominator)
        if abs(float(candidate) - ratio) <= tolerance * ratio:
            return candidate
    raise InputError(f"the ratio {ratio:.9g} of two sample periods is not a fraction of small numbers; give periods")


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

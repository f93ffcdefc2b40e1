"""The sample rates of a model, and the basic time period they have in common: one answer for all analyses.

Rates come from what is declared (`Model.declared_rates`: the periods of a system's components and blocks, clocks), and
where a part declares none, an FMU, from the times of its events. Of two rates of which one is a multiple of the other
these show the faster one only; so the map that the model makes of itself is compared at successive periods
(`repetition.py`): the basic period is the smallest one after which it repeats.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction

import numpy as np

from workbench.core.records.forms import several
from workbench.core.values.arrays import Floats
from workbench.core.values.calendar import LONGEST, TOGETHER, PeriodsError, check_periods, exact, simplest_between
from workbench.core.values.operating_point import OperatingPoint
from workbench.errors import FmuError, InputError, SimulationError, WorkbenchError
from workbench.model import DescribedModel, Model
from workbench.model.repetition import repetition

__all__ = ["NoRatesError", "Rates", "basic_period", "rates_of", "sample_periods", "sampled"]

_AGREE = 1e-6  # of the smallest distance: how exactly events keep their rate
_LOOKS = (100, 400, 2000)  # events that are looked at, until each belongs to a rate
_SINGLE = 2  # events that may belong to no rate; three make one, or do not

_NO_RATES = "the time events have no constant rates; give periods where they are known (lin: or method difference)"


class NoRatesError(InputError):
    """Time events that follow no constant rates."""


@dataclass(frozen=True, eq=False)
class Rates:
    """When a model samples.

    Attributes:
        periods: sample periods [s], rising; empty: it is continuous, or does not show any.
        period: the basic period, after which all of them repeat together [s]; 0: there is none.
        begin: from here on everything ticks in each of its periods [s].
        phase: what counts from where a session begins does so from here [s]; 0: nothing does.
        ticks: times of the first events, shape (k,) [s].
        notes: what is behind them, where that is not plain.
        complete: whether these are all; else it samples in a way that the notes tell.
    """

    periods: tuple[float, ...] = ()
    period: float = 0.0
    begin: float = -math.inf
    phase: float = 0.0
    ticks: Floats = field(default_factory=lambda: np.zeros(0))
    notes: tuple[str, ...] = ()
    complete: bool = True

    def start(self, time: float) -> float:
        """Return the first multiple of the basic period from which one can go on period by period [s].

        Where the model ticks then, in its own rounding. Multiples are counted from `phase`, so that a session that
        begins there has each sampler where a session that begins at `phase` has it.

        Args:
            time: not before this [s].
        """
        begin = max(time, self.begin)
        periods = float(np.ceil((begin - self.phase) / self.period - _AGREE))
        start = self.phase + periods * self.period + 0.0  # no −0
        near = self.ticks[np.abs(self.ticks - start) < _AGREE * self.period]
        return float(near[0]) if len(near) and start > time else start


def rates_of(
    model: Model,
    *,
    time: float | None = None,
    values: Mapping[str, float] | None = None,
    btptol: float = TOGETHER,
) -> Rates:
    """Return when a model samples.

    Args:
        model: it stays open; of co-simulation the equations are asked, where it has them.
        time: where it stands [s]; None: where its sessions begin.
        values: states, discrete states and inputs there.
        btptol: relative tolerance in which they have a common multiple.

    Raises:
        NoRatesError: there are events, but they follow no constant rates.
        PeriodsError: events show rates that contradict the periods given for the model.
        InputError: the rates have no common multiple of reasonable size.
        FmuError, SimulationError: the model cannot be opened or run there.
    """
    start = model.start_time if time is None else time
    if model.interface != "me":
        equations = _equations(model)
        if equations is None:
            return _of_parts(model, start, btptol)
        with equations:
            return rates_of(equations, time=time, values=values, btptol=btptol)
    known = _declared(model, start)
    shown, single = _shown(model, known, start, values)
    if not (known or shown):
        return Rates(notes=_of_single(single))
    ticks = _ticks(model, start, values, _LOOKS[0])
    _check_given(model, ticks)
    result = _found([*known, *shown], start, ticks, btptol)
    result = replace(result, phase=start) if model.declared_rates().clocks else result
    result = replace(result, begin=max(result.begin, *single)) if single else result
    result = _confirmed(model, result, start, values) if shown else result
    result = replace(result, notes=(*result.notes, *_of_single(single)))
    if len(ticks) == _LOOKS[0] and ticks[-1] < result.start(start) + 2.0 * result.period:
        return replace(result, ticks=_ticks(model, start, values, _LOOKS[-1]))
    return result


def sampled(model: Model, at: OperatingPoint | None = None) -> Rates:
    """Return when a model samples, as far as that can be seen: what keeps it from being seen is in the notes.

    Args:
        model: it stays open.
        at: where it stands; its period counts where the model shows none.

    Raises:
        PeriodsError: see `rates_of`.
    """
    where = model.at if at is None else at
    try:
        result = rates_of(model) if where is None else rates_of(model, time=where.time, values=where.values)
    except PeriodsError:
        raise
    except WorkbenchError as error:
        result = Rates(notes=(str(error),), complete=not isinstance(error, InputError))
    if result.periods or where is None or where.period is None:
        return result
    return replace(result, periods=(where.period,), period=where.period, complete=True)


_Sequence = tuple[float, float]  # first instant, period [s]
_Apart = tuple[list[_Sequence], list[float]]  # sequences, and single events [s]


def _declared(model: Model, start: float) -> list[_Sequence]:
    """Return the declared samplers in a session that begins at `start`."""
    return [(s.instant(0), float(s.period)) for s in dict.fromkeys(model.declared_rates().begun(start))]


def _check_given(model: Model, ticks: Floats) -> None:
    """Refuse periods given for a model whose events show that it does not repeat after them."""
    given = model.recipe.periods if isinstance(model, DescribedModel) else None
    if given is None:
        return
    try:
        shown = sample_periods(ticks)
    except NoRatesError:  # why periods are given
        return
    check_periods(several(given), shown, model.name)


def _of_parts(model: Model, start: float, btptol: float) -> Rates:
    """Return when a co-simulation samples: what is declared, and what the equations of its parts show, each alone."""
    parts = [rates_of(part, btptol=btptol) for part in model.declared_rates().others if part is not model]
    every = [*_declared(model, start), *((start, p) for part in parts for p in part.periods)]
    result = _found(every, start, np.zeros(0), btptol)
    return replace(result, notes=tuple(note for part in parts for note in part.notes))


def _found(every: Sequence[_Sequence], start: float, ticks: Floats, btptol: float) -> Rates:
    periods = tuple(sorted({period for _, period in every}))
    if not periods:
        return Rates()
    begin = max(first - period for first, period in every)
    late = begin > start + _AGREE * max(periods)  # nothing ticks there yet: the first period that is whole begins later
    period = meant(basic_period(periods, btptol))
    return Rates(periods, period, max(f for f, _ in every) if late else -math.inf, ticks=ticks)


def _of_single(events: Sequence[float]) -> tuple[str, ...]:
    listed = ", ".join(f"{t:.6g}" for t in sorted(set(events)))
    return (f"time events that belong to no sample rate, at {listed} s: rates are those after them",) if events else ()


def _shown(model: Model, known: Sequence[_Sequence], start: float, values: Mapping[str, float] | None) -> _Apart:
    """Return what events show of a model's parts, of each by itself where it runs alone."""
    others = model.declared_rates().others
    try:
        apart = [_sequences(part, start, values if part is model else None) for part in others]
        return [s for result, _ in apart for s in result], [t for _, single in apart for t in single]
    except (FmuError, SimulationError):
        return _sequences(model, start, values, known)


def _sequences(
    model: Model, start: float, values: Mapping[str, float] | None, known: Sequence[_Sequence] = ()
) -> _Apart:
    """Return the samplers that a model's events belong to, besides those known, and the events of none."""
    result, single = list[_Sequence](), list[float]()
    for most in _LOOKS:
        ticks = _ticks(model, start, values, most)
        last = most == _LOOKS[-1] or len(ticks) < most
        try:
            result, single = sequences(ticks, known)
        except NoRatesError:
            if last:
                raise
            continue
        if last or not single:  # two events of a slow rate look like single ones
            break
    return result, single


def _confirmed(model: Model, result: Rates, start: float, values: Mapping[str, float] | None) -> Rates:
    """Return the rates with those that no event shows."""
    begin, period = result.start(start), result.period
    inside = int(np.count_nonzero((result.ticks > begin) & (result.ticks < begin + 1.5 * period)))
    try:
        seen = repetition(model, begin, period, values, events=inside)
    except WorkbenchError as error:
        return replace(result, notes=(f"whether the model repeats every {period:.6g} s could not be seen: {error}",))
    if seen.count is None:
        note = (
            f"small deviations do not repeat every {period:.6g} s, nor after any number of such periods that shows in "
            f"{seen.periods} of them: the model is not the same from period to period (a motion on the way, a limit, a "
            "slower rate); give periods where they are known"
        )
        return replace(result, notes=(note,))
    if seen.late:
        result = replace(result, begin=begin + period)
    if seen.count == 1:
        return result
    whole = meant(seen.count * period)
    note = f"events come every {period:.6g} s, but what they do repeats every {whole:.6g} s only"
    return replace(result, periods=(*result.periods, whole), period=whole, notes=(note,))


# -- events --------------------------------------------------------------------------------------------------------


def _ticks(model: Model, time: float, values: Mapping[str, float] | None, most: int) -> Floats:
    """Return the first time events of a model's equations, states held."""
    if model.interface != "me":
        equations = _equations(model)
        if equations is None:
            return np.zeros(0)
        with equations:
            return _ticks(equations, time, values, most)
    with model.open_point(time=time, values=values or {}) as point:
        result = point.ticks(most, np.inf)
    # Who adds up periods is off by half an ulp an event: two that are so near are one.
    apart = np.diff(result, prepend=-np.inf) > most * np.spacing(np.abs(result))
    events: Floats = result[apart]
    return events


def _equations(model: Model) -> Model | None:
    """Return the model exchange side of a co-simulation FMU, where there is one."""
    if not isinstance(model, DescribedModel) or "me" not in model.description.interfaces:
        return None
    return replace(model.recipe, interface="me", solver="auto", step=None).open()


def sample_periods(times: Floats) -> tuple[float, ...]:
    """Take event times apart into periodic sequences and return their periods, rising.

    Args:
        times: shape (n,) [s], rising, all events of a stretch of time.

    Raises:
        NoRatesError: they follow no constant rates, or there are too few of them.
    """
    result, single = sequences(times)
    if single:
        raise NoRatesError(_NO_RATES)
    return tuple(sorted(period for _, period in result))


def sequences(times: Floats, known: Sequence[_Sequence] = ()) -> _Apart:
    """Take event times apart into periodic sequences, first instants and periods [s], and one or two single events.

    The first event left over and the nearest later one that both belong to a sequence without gaps begin a sequence,
    to which events of others may belong as well; its events are taken out, and so on.

    Args:
        times: shape (n,) [s], rising, all events of a stretch of time.
        known: sequences whose events are taken out first; they are not returned.

    Raises:
        NoRatesError: they follow no constant rates.
    """
    left, result, single = times, list[_Sequence](), list[float]()
    tolerance = _AGREE * float(np.diff(times).min(initial=np.inf))
    for first, period in known:
        left = _without(left, first, period, min(tolerance, _AGREE * period))
    while len(left):
        begun = _period(left, times, tolerance)
        if begun is not None:
            result.append((float(left[0]), begun))
            left = _without(left, float(left[0]), begun, tolerance)
        elif len(single) < _SINGLE:
            single.append(float(left[0]))
            left = left[1:]
        else:
            raise NoRatesError(_NO_RATES)
    return result, single


def _without(left: Floats, first: float, period: float, tolerance: float) -> Floats:
    """Return the events that do not belong to a sequence."""
    counts = np.maximum(np.round((left - first) / period), 0.0)
    kept: Floats = left[np.abs(first + counts * period - left) > tolerance]
    return kept


def _period(left: Floats, times: Floats, tolerance: float) -> float | None:
    """Return the period of the sequence that the first of `left` begins; None: it begins none."""
    for candidate in times[times > left[0]]:
        period = float(candidate - left[0])
        points = (times[-1] - left[0] + tolerance) / period
        if not points < len(times):  # each belongs to an event, and events may go on to the end of all numbers
            continue
        count = math.floor(points)
        grid = left[0] + period * np.arange(count + 1)
        if count >= 2 and all(np.abs(times - t).min() <= tolerance for t in grid):
            return meant(float(grid_fit(times, grid)))
    return None


def meant(period: float) -> float:
    """Return the period that is meant by one that is off by what adding up so many of it makes [s]."""
    return float(exact(period, _LOOKS[-1]))


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
    if multiple > LONGEST:
        listed = ", ".join(f"{p:.12g}" for p in periods)
        raise InputError(
            f"sample periods {listed} s repeat together after {float(multiple):.3g} times the shortest only (within "
            f"btptol {btptol:g}), more than the {LONGEST} that can be run; round them, or enlarge btptol"
        )
    # The period fits best where most samples are: the mean over all of period · whole number of samples.
    fits = [p * round(float(multiple) / float(r)) for p, r in zip(periods, ratios, strict=True)]
    return float(np.mean(fits))


def _simplest(ratio: float, tolerance: float) -> Fraction:
    """Return the fraction with the smallest denominator within a relative tolerance."""
    reach = Fraction(tolerance) * Fraction(ratio)
    result = simplest_between(Fraction(ratio) - reach, Fraction(ratio) + reach)
    if result.denominator < LONGEST:
        return result
    raise InputError(
        f"the ratio {ratio:.9g} of two sample periods is no fraction of small numbers: they never repeat together; "
        "round them"
    )

"""How a quantity grows without bound: by a constant factor in equal times, or to infinity in finite time."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from workbench.core.records.record import RecordPart
from workbench.core.values.arrays import Floats
from workbench.errors import InputError, SimulationError
from workbench.model.base import Model
from workbench.model.names import declared_units
from workbench.session.base import Recorded, Session
from workbench.signals.kinds import Signal

__all__ = ["Divergence", "DivergenceError", "divergence", "explained"]

_BEGIN = 16.0  # times its early size: from there on growth is judged
_LEAST = 8  # doublings that a judgement needs
_LEAST_STEADY = 20  # doublings before steady growth counts as without bound: a factor of a million
_LAST = 16  # doublings that are told
_TREND = 6  # the last ones, whose trend tells where they end; else that of all that are told
_FALLING = -0.9  # correlation of the logarithms of doubling times with their number
_SHRINKS = 0.93  # doubling times that fall by this factor and more end in finite time: x ~ (t* − t)^−p, p < 9.5
_STOPPED = 2.5  # of the last doubling time; without a doubling for longer the growth had stopped
_STEADY = 1.1  # ratio of doubling times up to which growth is exponential


@dataclass(frozen=True, kw_only=True)
class Divergence(RecordPart):
    """How a simulation grew until it stopped.

    Attributes:
        variable: variable that grew most.
        unit: unit of the variable; None: none declared.
        kind: "finite escape", "exponential" or "growing".
        time: until which it was followed [s].
        size: largest magnitude of the variable until then.
        doubling_times: in which its magnitude doubled, the last ones, in their order [s].
        escape_time: where the doubling times, taken as a geometric series, end [s]; None: no finite escape.
        exponent: p of |x| ~ (escape_time − t)^−p; None: no finite escape.
    """

    variable: str
    unit: str | None = None
    kind: str
    time: float
    size: float
    doubling_times: tuple[float, ...]
    escape_time: float | None = None
    exponent: float | None = None

    @property
    def words(self) -> str:
        """One clause: what grew, how, and when."""
        last = f"{self.doubling_times[-1]:.3g} s"
        unit = f" {self.unit}" if self.unit and self.unit != "1" else ""
        reached = f"{self.size:.3g}{unit}"
        if self.kind == "finite escape":
            return (
                f"{self.variable} escapes to infinity in finite time, at t = {self._when} s: its doubling "
                f"time shrinks by {2.0 ** (-1.0 / (self.exponent or 1.0)):.2f} each time, to {last} at {reached}"
            )
        if self.kind == "exponential":
            return f"{self.variable} grows exponentially, doubling every {last}, to {reached}"
        return f"{self.variable} grows without bound, to {reached}; it doubled in {last} last"

    @property
    def _when(self) -> str:
        """The escape time with the digits that the last doubling time allows."""
        digits = -math.floor(math.log10(self.doubling_times[-1]))
        return f"{self.escape_time:.{min(max(digits, 1), 9)}f}"


class DivergenceError(SimulationError):
    """A simulation stopped because something in it grew without bound.

    Attributes:
        message: what grew and how, and what stopped the run; the time is appended.
        time: session time at which it stopped [s].
        divergence: how it grew.
        followed: what was recorded of it, ever more densely towards its end.
    """

    divergence: Divergence
    followed: Recorded

    @classmethod
    def of(cls, result: Divergence, cause: SimulationError, followed: Recorded) -> DivergenceError:
        """Return the error for a run that `cause` ended.

        Args:
            result: how it grew.
            followed: the record that shows it.
            cause: what the solver or the model said.
        """
        reason = str(cause).partition(" (at t = ")[0].partition(";")[0]  # advice on solvers does not help here
        when = "" if cause.time is None else f" (at t = {cause.time:.9g} s)"
        made = cls(f"{result.words}; the run stopped: {reason}{when}")
        made.time, made.divergence, made.followed = cause.time, result, followed
        return made


def divergence(time: Floats, values: Floats, *, variable: str = "x", unit: str | None = None) -> Divergence | None:
    """Judge how a magnitude grows; None: it does not, or not for long enough to tell.

    The running maximum of |x| is followed through its doublings from 16 times its early size on. In exponential
    growth they take equal times; where x ~ (t* − t)^−p they shrink by 2^(−1/p) each, and t* is where their geometric
    series ends (for dx/dt = x²: p = 1, every doubling takes half the time of the last). Doubling times that shrink
    more slowly are told as growing only: no finite time can be concluded from them. The record must be dense enough
    near its end; `workbench.simulate` makes such a record by itself when a run fails.

    Source: H. K. Khalil, Nonlinear Systems, 3rd ed., section 3.1 (finite escape time).

    Args:
        time: shape (n,), rising [s].
        values: shape (n,).
        variable: its name, for the answer.
        unit: unit of the variable.
    """
    passed = _doublings(np.asarray(time, dtype=np.float64), np.abs(np.asarray(values, dtype=np.float64)))
    if len(passed) < _LEAST + 1:
        return None
    gaps = np.diff(passed)
    if time[-1] - passed[-1] > _STOPPED * gaps[-1]:
        return None  # it grew once, but not up to the end
    kind, ratio = _judged(gaps)
    if kind is None or (kind != "finite escape" and len(passed) <= _LEAST_STEADY):
        return None
    size = float(np.max(np.abs(values[np.isfinite(values)])))
    finite = kind == "finite escape"
    return Divergence(
        variable=variable,
        unit=unit,
        kind=kind,
        time=float(time[-1]),
        size=size,
        doubling_times=tuple(gaps[-_LAST:].tolist()),
        escape_time=max(float(time[-1]), float(passed[-1] + gaps[-1] * ratio / (1.0 - ratio))) if finite else None,
        exponent=-math.log(2.0) / math.log(ratio) if finite else None,
    )


def _doublings(time: Floats, size: Floats) -> Floats:
    """Return the times at which the running maximum passes 2^k of its early size, rising steadily to the end."""
    usable = np.isfinite(size)
    time, size = time[usable], size[usable]
    if len(size) < 2 or not np.any(size > 0.0):
        return np.zeros(0)
    # A rise from exactly zero passes infinitely many doublings at once; they are not growth that was seen.
    seen = size[size > 0.0]
    early = max(float(np.max(size[: max(1, len(size) // 20)])), float(seen[0]))
    top = np.maximum.accumulate(size)
    begin = _BEGIN * early
    if not top[-1] > begin:
        return np.zeros(0)
    levels = begin * 2.0 ** np.arange(math.floor(math.log2(float(top[-1]) / begin)) + 1)
    after = np.searchsorted(top, levels, side="left")
    after = np.clip(after, 1, len(top) - 1)
    low, high = np.log2(np.maximum(top[after - 1], 1e-300)), np.log2(top[after])
    part = np.where(high > low, (np.log2(levels) - low) / np.where(high > low, high - low, 1.0), 1.0)
    passed = time[after - 1] + np.clip(part, 0.0, 1.0) * (time[after] - time[after - 1])
    return np.asarray(passed, dtype=np.float64)


def _judged(gaps: Floats) -> tuple[str | None, float]:
    """Return the kind of growth (None: it slows down), and by which factor each doubling time differs from the last."""
    ratio = 1.0
    for last in (gaps[-_TREND:], gaps[-_LAST:]):
        if np.any(last <= 0.0):
            return None, 1.0
        ratio, straight = _geometric(last)
        if ratio < _SHRINKS and straight:
            return "finite escape", ratio
    usual = gaps[gaps > 0.0]  # several doublings between two points take no time
    quarter = max(1, len(usual) // 4)
    change = float(np.median(usual[-quarter:]) / np.median(usual[:quarter]))
    if float(gaps[-1]) > _STOPPED * float(np.median(usual[-quarter:])):
        return None, ratio  # a rise that ends, after doublings that no point lies between
    if 1.0 / _STEADY < change < _STEADY:
        return "exponential", 1.0
    return ("growing" if change < 1.0 else None), ratio


def _geometric(gaps: Floats) -> tuple[float, bool]:
    """Return the factor from each doubling time to the next, and whether they follow it."""
    number, size = np.arange(len(gaps)), np.log(gaps)
    slope = float(np.polynomial.polynomial.polyfit(number, size, 1)[1])
    spread = float(np.std(size))
    return math.exp(slope), spread > 0.0 and float(np.corrcoef(number, size)[0, 1]) <= _FALLING


_EVENLY = 400  # points over the run
_PER_HALVING = 4  # points in each half of the time that is left
_HALVINGS = 46
_CHUNK = 4  # points of one advance: what fails costs the last ones only
_NEAREST = 64.0  # times the spacing of numbers at the time of failure
_FIRST = ("finite escape", "exponential", "growing")


def explained(
    model: Model, error: SimulationError, *, start: float, signals: Mapping[str, Signal], names: Sequence[str]
) -> SimulationError:
    """Return the error that says what grew without bound, or `error` itself where nothing did.

    Args:
        model: that failed; a new session of it is run up to the failure.
        error: how it failed.
        start: session time at which it began [s].
        signals: forced inputs, as in the run that failed.
        names: variables that were recorded; states are looked at besides.
    """
    if error.time is None or not error.time > start:
        return error
    states = [v.name for v in model.states if v.is_number]
    every = list(dict.fromkeys([*names, *states]))
    try:
        with model.open_session(start_time=start, signals=dict(signals)) as session:
            seen = _followed(session, _points(start, error.time, session), signals, every)
    except (SimulationError, InputError):
        return error
    if seen is None or len(seen.time) < _EVENLY // 2:
        return error
    units = declared_units(model, every)
    kinds = [divergence(seen.time, seen.values[n], variable=n, unit=units[n]) for n in every]
    result = [d for d in kinds if d is not None]
    worst = _worst([d for d in result if d.variable in names] or result)
    return error if worst is None else DivergenceError.of(worst, error, seen)


def _worst(result: Sequence[Divergence]) -> Divergence | None:
    """Return the growth that tells most: finite escape before exponential growth, then the variable named first."""
    return min(result, key=lambda d: _FIRST.index(d.kind), default=None)


def _points(start: float, end: float, session: Session) -> list[Floats]:
    """Return the points to record, in chunks, the last ones ever nearer to the end."""
    span = end - start
    evenly = start + span * np.arange(1, _EVENLY) / _EVENLY
    if session.communication_step is not None:
        return [evenly]
    left = span * 2.0 ** (-np.arange(_PER_HALVING * 3, _PER_HALVING * _HALVINGS) / _PER_HALVING)
    left = left[left > _NEAREST * np.spacing(abs(end))]
    every = np.unique(np.concatenate([evenly, end - left]))
    every = every[(every > start) & (every < end)]  # late in time a short run has room for few numbers
    near = every > end - span / _EVENLY
    last = np.array_split(every[near], max(1, int(near.sum()) // _CHUNK))
    return [points for points in (every[~near], *last) if len(points)]


def _followed(
    session: Session, chunks: Sequence[Floats], signals: Mapping[str, Signal], names: Sequence[str]
) -> Recorded | None:
    """Advance as far as it goes; return what was recorded; None: nothing."""
    records: list[Recorded] = []
    for chunk in chunks:
        try:
            records.append(session.advance(float(chunk[-1]), signals=signals, record=names, points=chunk))
        except SimulationError:
            break
    if not records:
        return None
    return Recorded(
        time=np.concatenate([r.time for r in records]),
        values={n: np.concatenate([r.values[n] for r in records]) for n in names},
        inputs={n: np.concatenate([r.inputs[n] for r in records]) for n in signals},
    )

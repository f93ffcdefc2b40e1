"""How long a communication step may be: for one percent of error, and before the motion no longer dies away."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from time import monotonic, process_time

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.errors import SimulationError
from workbench.health.check.result import Answer
from workbench.health.check.subject import CheckedFmu
from workbench.health.check.swing import swing_of
from workbench.signals.kinds import Signal

__all__ = ["largest_step"]

_WANTED = 0.01  # error, over the range of the variable
_TINY = 1e-300
_CLOCK = 1e-4  # [s], shorter times are not told apart everywhere
_FLOOR = 1e-9  # of the range: changes below it are rounding
_FEWEST = 8  # steps in a test run
_LEAST_ORDER, _ALIKE = 0.5, 0.3  # orders that differ by less are the order
_AGREE, _ORDERS = 3, 6  # of so many steps; halvings in which it must be seen
_HALVINGS = 3  # of a step, to see its error
_DOWN, _UP = 12, 6  # halvings of the longest step, doublings of the natural one, that are tried
_BISECTIONS = 6  # of a factor of two: to 1 %
_STEPS = 12_800  # in which a motion must die away: a change of 6e-6 a step is seen
_FEWEST_STEPS = 800  # where the FMU is slow
_PROBES = _UP + _BISECTIONS + 2  # runs of so many steps
_DIES = 0.98  # of the movement in the third quarter is left at most in the last
_STILL = 1e-4  # of the range: what error control leaves does not move
_LESS = 5  # halvings of the natural step
_UNSETTLED = "which steps are stable is not known: the motion does not die away, whatever the step"
_PATIENCE = 5.0  # [s] of the processor for either of the two steps, so that a busy machine tells the same ...
_LONGEST = 25.0  # ... and of time, where an FMU waits
_CHUNK = 200  # points, after which the clock is looked at


def largest_step(subject: CheckedFmu) -> Answer:
    """Find the longest communication steps with one percent of error, and with a motion that dies away.

    Inputs jump once and stand still, and for the error they also swing as fast as the model follows (see `swing_of`):
    the larger error counts. Error of the step h in the test run, where two neighbouring points
    have it: |y_h − y*| over the range of each variable, with y* = y_(h/8) + (y_(h/8) − y_(h/4)) / (2^p − 1) and the
    order p = log2(|y_(h/2) − y_(h/4)| / |y_(h/4) − y_(h/8)|) that is seen (Richardson). Stability: over 12,800 steps
    the movement, or what a straight line leaves of it, must get smaller from the third quarter to the last, and does
    not so with a longer step over the same time.
    Both steps are found by doubling and bisection, to 1 %. For a linear model with a real pole λ the second is 2/|λ|
    with Euler's method. What cannot be told is unknown: of a model that stays where it is, never settles, or shows no
    order, as with events or a solver's own step control.

    Source: L. F. Richardson (see `step`); E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, IV.2.
    """
    search = _StepSearch(subject)
    if not search.moves:
        return Answer("not applicable", "nothing moves when its inputs jump, so that steps cannot be judged")
    with np.errstate(over="ignore", invalid="ignore"):  # of what diverges
        accurate = search.within(search.accurate, "which step has an error of 1 % is not known")
        stable = search.within(search.stable, "which steps are stable is not known")
    numbers = {
        "order": search.order,
        "one_percent": accurate.longest,
        "stable": stable.longest,
        "unstable": stable.beyond,
        "tried": search.tried,
    }
    return Answer("good", f"{accurate.told}; {stable.told}", numbers=numbers)


@dataclass(frozen=True)
class _LongestStep:
    """The longest step with a property [s], the shortest that was seen without it, None: not known; in words."""

    longest: float | None
    beyond: float | None
    told: str


@dataclass(frozen=True)
class _Excitation:
    """What is observed, its inputs, for how long [s], and in words."""

    subject: CheckedFmu
    signals: Mapping[str, Signal]
    span: float
    words: str

    def steps(self, h: float) -> int:
        """Steps of its run; a few where they are longer than it."""
        return max(_FEWEST, math.floor(self.span / h * (1.0 + _FLOOR)))


class _NoTimeError(Exception):
    """There is no more time."""


class _StepSearch:
    """What has been tried.

    Attributes:
        moves: whether anything moves in a test run.
        order: that is seen at the step with one percent of error; None: none.
        tried: longest step [s].
    """

    def __init__(self, subject: CheckedFmu) -> None:
        self.subject, self.tried = subject, 0.0
        self.order: float | None = None
        self._failed: set[float] = set()
        swing = swing_of(subject)
        self._excitations = [_Excitation(subject, subject.constants(), subject.span, "after a jump of the inputs")]
        if not isinstance(swing, str):
            span = swing.steps * subject.step
            self._excitations.append(_Excitation(swing.subject, swing.signals, span, f"with {swing.words}"))
        self._until, self._end, self._errors = math.inf, math.inf, dict[tuple[float, int], tuple[float, float]]()
        begin = process_time()
        first = self._run(subject.step, subject.steps)
        self._cost = max(process_time() - begin, _CLOCK) / subject.steps  # [s] of a step
        self.moves = first is None or bool(
            (np.ptp(first, axis=0) > _FLOOR * np.abs(first).max(axis=0, initial=0.0)).any()
        )

    def _run(self, h: float, count: int, parts: int = 1, forced: _Excitation | None = None) -> Floats | None:
        """Return the values after so many times h, in steps of a part of it, shape (count, k); None: it fails.

        Raises:
            _NoTimeError: it takes too long.
        """
        points: Floats = self.subject.start + h * np.arange(1.0, count + 1.0)
        forced, result = forced or self._excitations[0], list[Floats]()
        try:
            with self.subject.open(step=h / parts) as session:
                for some in np.array_split(points, math.ceil(count / _CHUNK)):
                    if self._is_late():
                        raise _NoTimeError
                    result.append(forced.subject.observe(session, forced.signals, some).values)
        except SimulationError:
            return None
        return np.concatenate(result)

    def _is_late(self) -> bool:
        return process_time() > self._until or monotonic() > self._end

    def within(self, find: Callable[[], _LongestStep], unknown: str) -> _LongestStep:
        """Return what is found while there is time."""
        self._until, self._end = process_time() + _PATIENCE, monotonic() + _LONGEST
        try:
            return find()
        except _NoTimeError:
            return _LongestStep(None, None, f"{unknown}: its runs take too long")

    def _affordable(self, h: float, steps: int) -> bool:
        """Return whether there is time for so many more steps, which take longer where the FMU makes its own inside."""
        return process_time() + self._cost * steps * max(1.0, h / self.subject.step) <= self._until

    # -- accuracy -----------------------------------------------------------------------------

    def _judged(self, h: float, excitation: int) -> tuple[float, float]:
        """Return the error of a step, over the range, inf where it fails, and the order seen; NaN: none."""
        if (h, excitation) not in self._errors:
            forced = self._excitations[excitation]
            runs = [self._run(h, forced.steps(h), 2**k, forced) for k in range(_HALVINGS + 1)]
            self._errors[h, excitation] = _richardson(runs)
        return self._errors[h, excitation]

    def _worst(self, h: float) -> int:
        """Return the excitation with the larger error."""
        return max(range(len(self._excitations)), key=lambda k: self._judged(h, k)[0])

    def _error(self, h: float) -> float:
        return self._judged(h, self._worst(h))[0]

    def _can_judge(self, h: float, excitations: Sequence[_Excitation]) -> bool:
        return self._affordable(h, 2 ** (_HALVINGS + 1) * sum(e.steps(h) for e in excitations))

    def _is_accurate(self, h: float) -> bool:
        self.tried = max(self.tried, h)
        return self._error(h) <= _WANTED

    def accurate(self) -> _LongestStep:
        """Return the longest step with one percent of error, tried from long ones on."""
        h = longest = self.subject.step * 2.0 ** math.floor(math.log2(self.subject.span / _FEWEST / self.subject.step))
        for _ in range(_DOWN):
            if self._is_accurate(h):
                break
            h *= 0.5
            if not self._can_judge(h, self._excitations):
                return _LongestStep(
                    None, 2.0 * h, f"more than 1 % of error down to {_step(2.0 * h)}, the shortest tried"
                )
        else:
            return _LongestStep(None, 2.0 * h, f"more than 1 % of error down to {_step(2.0 * h)}, the shortest tried")
        error, excitation = self._error(h), self._excitations[self._worst(h)].words
        self.order = self._seen_order(h)
        words = "no order is seen" if self.order is None else f"order {self.order:.2f}"
        if h == longest:
            alone = "the step has no effect" if error <= _FLOOR else f"less than 1 % of error ({words})"
            return _LongestStep(None, None, f"{alone} up to {_step(h)}, the longest tried, {excitation}")
        if self.order is None:
            return _LongestStep(
                None, 2.0 * h, "which step has an error of 1 % is not known: the error follows no order"
            )
        low, high = self._bisected(self._is_accurate, h, 2.0 * h)
        return _LongestStep(low, high, f"1 % of error at {_step(low)} ({words}), {excitation}")

    def _seen_order(self, h: float) -> float | None:
        """Return the order on which three steps agree, from h down; None: none do before rounding or time ends it."""
        worst = self._worst(h)
        orders = [self._judged(h, worst)[1]]
        for _ in range(_ORDERS):
            h *= 0.5
            if not self._can_judge(h, [self._excitations[worst]]):
                break
            orders.append(self._judged(h, worst)[1])
            last = orders[-_AGREE:]
            seen = len(last) == _AGREE and all(p >= _LEAST_ORDER for p in last)  # NaN is not
            if seen and max(last) - min(last) <= _ALIKE:
                return last[-1]
        return None

    # -- stability ------------------------------------------------------------------------------

    def stable(self) -> _LongestStep:
        """Return the longest step with which the motion dies away, tried from the natural one on.

        A step is blamed only where a shorter one does better over the same time.
        """
        h = self.subject.step
        span = self._steps * h
        if self._dies_away(h, span):
            for _ in range(_UP):
                if not self._affordable(2.0 * h, self._steps):
                    break
                if not self._dies_away(2.0 * h, 2.0 * span):
                    return self._between(h, 2.0 * span)
                h, span = 2.0 * h, 2.0 * span
            return _LongestStep(None, None, f"stable up to {_step(h)}, the longest tried")
        for _ in range(_LESS):
            h *= 0.5
            if not self._affordable(h, round(span / h)):
                break
            if self._dies_away(h, span):
                return self._between(h, span)
        return _LongestStep(None, None, _UNSETTLED)

    def _between(self, low: float, span: float) -> _LongestStep:
        if not self._dies_away(low, span):
            return _LongestStep(None, None, _UNSETTLED)
        low, high = self._bisected(lambda h: self._dies_away(h, span), low, 2.0 * low)
        how = "the run fails" if high in self._failed else "not"
        return _LongestStep(low, high, f"stable up to {_step(low)}, {how} at {_step(high)}")

    @property
    def _steps(self) -> int:
        """Steps of a run in which a motion must die away."""
        return min(_STEPS, max(_FEWEST_STEPS, round(_PATIENCE / _PROBES / self._cost)))

    def _dies_away(self, h: float, span: float) -> bool:
        self.tried = max(self.tried, h)
        values = self._run(h, round(span / h))
        if values is None:
            self._failed.add(h)
            return False
        half = values[len(values) // 2 :]
        size = _STILL * np.maximum(np.ptp(values[: len(values) // 2], axis=0), np.abs(values).max(axis=0) * _FLOOR)
        place = np.linspace(-1.0, 1.0, len(half))
        line = np.polynomial.polynomial.polyfit(place, half, 1)
        shrinks = np.zeros(half.shape[1], dtype=bool)
        for rest in (half, half - np.polynomial.polynomial.polyval(place, line).T):
            before, after = (np.ptp(part, axis=0) for part in np.array_split(rest, 2))
            shrinks |= (after <= size) | (after < _DIES * before)
        return bool(shrinks.all())

    def _bisected(self, good: Callable[[float], bool], low: float, high: float) -> tuple[float, float]:
        for _ in range(_BISECTIONS):
            if self._is_late():
                break
            middle = math.sqrt(low * high)
            low, high = (middle, high) if good(middle) else (low, middle)
        return low, high


def _richardson(runs: Sequence[Floats | None]) -> tuple[float, float]:
    """Return the error of the first of runs with ever halved steps, inf where one fails, and the order; NaN: none."""
    made = [run for run in runs if run is not None]
    if len(made) < len(runs):
        return math.inf, math.nan
    *_, third, second, last = made
    moved, large = np.ptp(last, axis=0), np.abs(last).max(axis=0)
    size = np.maximum(np.where(moved > _FLOOR * large, moved, large), _TINY)
    coarse, fine = _gap(third - second, size), _gap(second - last, size)
    order = math.log2(coarse / fine) if min(coarse, fine) > _FLOOR else math.nan
    gain = 1.0 / (2.0**order - 1.0) if order >= _LEAST_ORDER else 0.0
    return _gap(made[0] - last - gain * (last - second), size), order


def _gap(difference: Floats, size: Floats) -> float:
    """Return the largest difference of two neighbouring points: at a single one a jump may fall to its other side."""
    gaps = np.abs(difference) / size
    return float(np.minimum(gaps[1:], gaps[:-1]).max(initial=0.0))


def _step(h: float) -> str:
    return f"{h:.3g} s"

"""When a forced model has settled, and what its response is then."""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass, field, replace
from enum import Enum
from itertools import pairwise
from operator import attrgetter

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.response.nfr.beats import mean_over_beats, repeats_every, spread_words
from workbench.response.nfr.error import (
    BELIEVED,
    Evidence,
    beyond,
    buried,
    error_of_limit,
    error_of_mean,
    follows,
    quadrature,
    relative_to_true,
    wanders,
)
from workbench.response.nfr.transient import Limit, directions, drift, levelled, remove_transient, rise_of
from workbench.response.periodic.fourier import COMPARED, Period, fundamental

__all__ = ["EDGES", "NO_EFFECT", "PointResponse", "Settling", "SettlingOutcome"]

# A defect (see `transient`) below this is the solver's noise; asking for less would never end.
_NOISE = 1e-4

# A response that was extrapolated to more than this many times what was reached was not measured at its amplitude.
_MOST_BEYOND = 2.0

_RESONANT = (
    "it has not reached its amplitude: near a lightly damped resonance it still grows, to more than twice its value"
)
_BURIED = (
    "the initial transient is larger than the response and decays slowly: wait longer "
    "(`max_periods`), for some of the model's slowest time constants"
)
_SLOW = "a transient decays slowly; more periods (`max_periods`) make it more accurate"
_RESTLESS = (
    "its periods differ, do not converge and do not repeat every 2 to 8 either: it is still on its way to another "
    "response (a jump), or irregular (sampling beats, noise, a motion of the model's own, chaos); more periods "
    "(`max_periods`) show which"
)
EDGES = (
    "the output has edges shorter than the distance of two rows, up to half of which is missing in its phase, as the "
    "error says"
)
_UNCLEAR = (
    "irregular, or a lightly damped mode that decays slowly: its periods alternate and converge only slowly; more "
    "periods (`max_periods`) show which"
)
NO_EFFECT = "no effect"
_ELSEWHERE = "the output moves, but not at the frequency of the input: only its harmonics, or its mean, respond"
_BEATS = (
    "sampling and forcing beat, near half the sampling rate or a multiple of it, more slowly than the measurement "
    "lasted"
)

# Of fewer common periods of forcing and sampling their limit is not believed.
_FEWEST_COMMON = 4

# What a response at rest leaves of a change, in allowed defects.
_AT_REST = 3.0

# A rise below this part of what is at rest is noise, and so is one by less than this factor rounding.
_TREMBLES, _ROUNDING = 0.03, 1.0 + 1e-9

# What changes between repetitions of a subharmonic, this many times, is its error.
_OF_CHANGE = 10.0

# Periods that lose less than this from one half of the newest to the other do not die away.
# Wandering ones may lose so much by accident.
_DWINDLES, _BY_ACCIDENT = 0.95, 0.4

# So many periods in a row, each this much larger than the one before, are divergence at once.
_RUNAWAY_FACTOR, _RUNAWAY_PERIODS = 10.0, 6


class SettlingOutcome(Enum):
    """How a point ended."""

    RESOLVED = "settled, its transient removed"
    SETTLED = "settled by the published rule"
    AVERAGED = "averaged"
    DIVERGED = "grows without bound"
    SCATTERED = "scattered"


@dataclass(frozen=True)
class PointResponse:
    """The response at one frequency and amplitude.

    Attributes:
        value: output over input, complex, [unit of output / unit of input].
        offset: mean of the output [unit of output].
        outcome: how it was obtained.
        harmonics: Fourier coefficients of the output, laid out as in `Period`, [unit of output].
        defect: by how much the response fails to repeat itself, relative to its fundamental: `transient.Limit`'s
            where one was believed, the scatter of the periods where they were averaged, else inf.
        error: of `value`, relative to the true one, as a complex number's magnitude; inf where it is not known.
        beyond: how many times larger the response that the periods tend to is than any measured.
        why: why it has not settled; None where it has.
    """

    value: complex
    offset: float
    outcome: SettlingOutcome
    harmonics: Floats
    defect: float
    error: float = math.inf
    beyond: float = 1.0
    why: str | None = None


@dataclass
class Settling:
    """Decide period by period whether the response has settled.

    The published rule (source report, chapter 4.4.1 and appendix 11.2) compares phase and gain of
    two successive periods: settled when |Δphase| ≤ errcrit [rad] and |Δgain| ≤ errcrit/10; after
    `most` periods the mean of P, Q and offset over the last half (11–20) is taken and marked.
    Two weaknesses: a slow or lightly damped transient changes little from one period to the next
    while it still falsifies both (a lag of 1 s at 10 Hz by 1.8°), and two periods of a beat agree
    by accident. So:

      1. RESOLVED, from the second period on: the periodic response is extrapolated
         (`transient.remove_transient`); it is believed when its defect, all harmonics together, is
         at most errcrit/100, but not below 1e-4, its error (`error.error_of_limit`) at most
         errcrit/10, and it is no larger than twice what was reached: a response that was
         never there is not measured, whatever a linear model would do.
      2. SETTLED: the periods resist that description (sampling beats, noise), but the published
         test passes in the second half of the periods allowed, from where on the source report,
         too, takes the model to be stationary, and the error is at most errcrit/10. The value is the same
         extrapolation or the mean of the last half of the periods, whichever has the smaller error. Such a mean counts
         only where those periods lie within 3/100 errcrit of it, or the model is known to sample: what wanders more
         may be chaos.
      3. AVERAGED: neither by the last period; as published, the mean of the last half, or the extrapolation where
         its error is less than half of the mean's. SCATTERED, which is a failure, if
         those periods lie farther from their mean (root mean square) than the mean from zero: then gain and
         phase are anything.
      4. DIVERGED: the change from period to period itself grows, exponentially. Tested by its
         logarithm over the second half: it rises in both halves of that window, and in the later
         at least 0.9 times as much as in the earlier. Powers of time (integrators in series:
         drift) fall back clearly there and pass. A growth of 10 in six successive periods is not
         waited for. Slower than 10 % in a quarter of the periods is not recognised.

    No response at all (gain 0: dead time, a dead band) never counts as settled.
    The published gain test is absolute, in units of output over input, and so says nothing for a
    gain far below 1; rule 2 therefore also asks that all harmonics together change by at most
    errcrit of the fundamental. For a gain far above 1 (an output in pascal) it hardly ever passes.
    Rule 1 is relative.

    Attributes:
        errcrit: error criterion, dimensionless [rad for the phase].
        most: largest number of periods, at least 2.
        evidence: what is known of the point besides its periods.
        periods: what was added so far.
    """

    errcrit: float
    most: int
    evidence: Evidence = field(default_factory=Evidence)
    periods: list[Period] = field(default_factory=list)

    def add(self, period: Period) -> PointResponse | None:
        """Take one more period; return the response once it is known, else None."""
        self.periods.append(period)
        count = len(self.periods)
        if self._runs_away():
            return self._response(period.harmonics, SettlingOutcome.DIVERGED, math.inf)
        if count >= 2 and period.responds(self._floor()):
            limit = self._limit()
            if limit.defect <= self._allowed():
                result = self._of_limit(limit, SettlingOutcome.RESOLVED)
                if self._is_good(result) and self._is_calm(limit):
                    return result
            if self.evidence.beat is not None:
                result = self._of_beats(limit)
                if self._is_good(result):
                    return result
            if 2 * count > self.most and self._repeats() and not self._grows():
                of_limit = self._of_limit(limit, SettlingOutcome.SETTLED)
                of_mean = self._of_mean(limit, of_limit, SettlingOutcome.SETTLED)
                result = min([of_mean, of_limit] if self._is_calm(limit) else [of_mean], key=attrgetter("error"))
                if self._is_good(result):
                    return result
        return self._last_resort() if count >= self.most else None

    def _is_good(self, response: PointResponse) -> bool:
        """Whether it is known as well as was asked for."""
        if self._beats_unseen():
            return False
        return response.error <= self.errcrit / 10.0 and response.beyond <= _MOST_BEYOND

    def _is_calm(self, limit: Limit) -> bool:
        """Whether the newest periods repeat for longer than a wandering response might by accident.

        A chaotic response passes close to a periodic one now and then, and repeats itself while it is there. The
        changes of a transient become smaller, at least from as many as there are modes to as many after them, and
        what the weights leave of them falls from each period to the next. How often it rose, so many periods and one
        it must have rested; and two more where the harmonics change in proportion, so that one mode fits any two
        changes. What the linear model does is not chaos.
        """
        if follows(limit, abs(self.periods[-1].drive), self.evidence, self._at_rest()):
            return True
        n, changes = limit.weights.size, limit.changes
        sizes = np.linalg.norm(changes[: 2 * limit.modes, 1:], axis=1)
        if np.linalg.norm(sizes[: limit.modes]) > np.linalg.norm(sizes[limit.modes :]):
            return False
        left = np.array([np.linalg.norm((limit.weights @ changes[i : i + n])[1:]) for i in range(len(changes) - n + 1)])
        rest = self._at_rest() * abs(fundamental(limit.harmonics))
        resting = int(np.argmin([*(left <= rest), False]))
        rises = int(np.sum((left[:-1] > _ROUNDING * left[1:]) & (left[:-1] > _TREMBLES * rest)))
        fitted = n if n > 1 and directions(changes[: 2 * n]) == 1 else 0
        return resting >= fitted + rises + (rises > 0)

    def _at_rest(self) -> float:
        """Return what a response at rest changes from period to period, relative to it."""
        return _AT_REST * self._allowed()

    def _allowed(self) -> float:
        """Return the largest defect that is believed."""
        return max(self.errcrit / 100.0, _NOISE)

    def _beats_unseen(self) -> bool:
        """Whether the sampling beats more slowly than was seen: the periods then say nothing of their mean."""
        return self.evidence.beat is not None and self.evidence.beat.length > len(self.periods)

    def _of_beats(self, limit: Limit) -> PointResponse:
        """Return the mean over the beats of a sampled model."""
        if self.evidence.beat is None:
            return self._response(limit.harmonics, SettlingOutcome.SETTLED, math.inf)
        mean, error = mean_over_beats(levelled(limit.periods), self.evidence.beat)
        error = relative_to_true(error + quadrature(mean, self.evidence.over(self.periods[-1])))
        fitted = self._response(mean, SettlingOutcome.SETTLED, limit.defect, error)
        return min(fitted, self._of_common(limit) or fitted, key=attrgetter("error"))

    def _of_common(self, limit: Limit) -> PointResponse | None:
        """Return what the means over the common periods of forcing and sampling tend to; None: too few were seen.

        From one to the next nothing changes but the transient, whose modes are those of the model; so they are removed
        as those of a model that does not sample.
        """
        every = None if self.evidence.beat is None else self.evidence.beat.common
        if every is None or every == 1 or len(limit.periods) < _FEWEST_COMMON * every:
            return None
        whole = len(limit.periods) // every
        means = levelled(limit.periods)[-whole * every :].reshape(whole, every, -1).mean(axis=1)
        tends = remove_transient(means, compared=1 + 2 * COMPARED)
        last = self.periods[-1]
        alone = replace(self.evidence.over(last), beat=None, twin=None)
        error = error_of_limit(tends, abs(last.drive), last.size, alone)
        if error > BELIEVED:
            return None
        return self._response(tends.harmonics, SettlingOutcome.SETTLED, tends.defect, error, beyond(tends))

    def _limit(self) -> Limit:
        return remove_transient(np.array([p.harmonics for p in self.periods]), compared=1 + 2 * COMPARED)

    def _of_limit(self, limit: Limit, outcome: SettlingOutcome) -> PointResponse:
        last = self.periods[-1]
        error = error_of_limit(limit, abs(last.drive), last.size, self.evidence.over(last))
        return self._response(limit.harmonics, outcome, limit.defect, error, beyond(limit))

    def _of_mean(self, limit: Limit, of_limit: PointResponse, outcome: SettlingOutcome) -> PointResponse:
        half = levelled(limit.periods)[len(limit.periods) // 2 :]
        mean = np.mean(half, axis=0)
        scatter = math.sqrt(float(np.mean(np.sum((half - mean)[:, 1:3] ** 2, axis=1))))
        size = abs(fundamental(mean))
        spread = scatter / size if size > 0.0 else math.inf
        last = self.periods[-1]
        evidence = self.evidence.over(last)
        error = error_of_mean(limit, abs(last.drive), of_limit.error, evidence) + quadrature(mean, evidence)
        if outcome is SettlingOutcome.SETTLED and not self.evidence.sampled and spread > self._at_rest():
            error = math.inf
        return self._response(mean, SettlingOutcome.SCATTERED if spread > 1.0 else outcome, spread, error)

    def _last_resort(self) -> PointResponse:
        last = self.periods[-1].harmonics
        if self._grows():
            return self._response(last, SettlingOutcome.DIVERGED, math.inf)
        if not any(period.responds(self._floor()) for period in self._latest()):
            return self._of_nothing()
        limit = self._limit()
        of_limit = self._of_limit(limit, SettlingOutcome.AVERAGED)
        of_mean = replace(self._of_mean(limit, of_limit, SettlingOutcome.AVERAGED), beyond=of_limit.beyond)
        of_beats = replace(self._of_beats(limit), outcome=SettlingOutcome.AVERAGED)
        better = 2.0 * of_limit.error < of_mean.error and of_limit.beyond <= _MOST_BEYOND
        if self.evidence.twin is None and of_limit.error > BELIEVED:
            of_limit = replace(of_limit, error=math.inf)
        result = min(of_limit if better else of_mean, of_beats, key=attrgetter("error"))
        if self._beats_unseen():
            return replace(result, error=math.inf, why=_BEATS)
        every = None if self.evidence.sampled else repeats_every(limit.periods)
        if every is not None:
            return self._of_subharmonic(limit, every)
        if self.evidence.sampled:
            return replace(result, why=self._why_sampled(of_mean.defect, result))
        return replace(result, why=self._why(limit, of_limit))

    def _latest(self) -> list[Period]:
        """Return the periods that tell whether there is a response: a hold may outlast one period of the forcing."""
        return self.periods[len(self.periods) // 2 :] if self.evidence.sampled else self.periods[-1:]

    def _floor(self) -> float:
        """Return the fundamental below which there is none."""
        return self.evidence.floor(abs(self.periods[-1].drive), max(p.size for p in self.periods))

    def _of_nothing(self) -> PointResponse:
        """Return the response 0; the reason says whether harmonics above rounding were seen."""
        dead = max(float(np.max(np.abs(p.harmonics[1:]))) for p in self._latest()) <= self._floor()
        mean = np.mean([p.harmonics for p in self.periods[len(self.periods) // 2 :]], axis=0)
        nothing = self._response(np.concatenate([mean[:1], 0.0 * mean[1:]]), SettlingOutcome.AVERAGED, math.inf)
        return replace(nothing, why=NO_EFFECT if dead else _ELSEWHERE)

    def _of_subharmonic(self, limit: Limit, every: int) -> PointResponse:
        """Return the mean over the periods after which the response repeats."""
        periods = levelled(limit.periods)
        last, before = periods[-every:].mean(axis=0), periods[-2 * every : -every].mean(axis=0)
        size = abs(fundamental(last))
        change = abs(fundamental(last - before)) / size if size > 0.0 else math.inf
        error = relative_to_true(_OF_CHANGE * change + quadrature(last, self.evidence.over(self.periods[-1])))
        result = self._response(last, SettlingOutcome.AVERAGED, limit.defect, error)
        return replace(
            result, why=f"a subharmonic of order {every}: it repeats only every {every} periods of the forcing"
        )

    def _why(self, limit: Limit, of_limit: PointResponse) -> str:
        """Return why the periods have not settled."""
        if _is_rough(self.periods[-1], self.errcrit):
            return EDGES
        if buried(limit, abs(self.periods[-1].drive), self.evidence) and of_limit.beyond <= 1.0:
            return _BURIED
        if of_limit.beyond > _MOST_BEYOND and of_limit.defect <= 1.0:
            return _RESONANT
        sizes = np.linalg.norm(limit.changes[:, 1:], axis=1)
        if _falls(sizes, max(1, len(sizes) // 2)) >= _DWINDLES:
            return _RESTLESS
        # Of the newest ones, in which quick modes are no more.
        steady = _falls(sizes, max(1, len(sizes) // 3)) > _BY_ACCIDENT
        foretold = follows(limit, abs(self.periods[-1].drive), self.evidence)
        doubtful = steady and not foretold and wanders(limit)
        return _UNCLEAR if doubtful else _SLOW

    def _why_sampled(self, spread: float, result: PointResponse) -> str:
        if self.evidence.beat is None:
            return spread_words(spread)
        return self.evidence.beat.words(spread, len(self.periods), known=math.isfinite(result.error))

    def _response(
        self, harmonics: Floats, outcome: SettlingOutcome, defect: float, error: float = math.inf, beyond: float = 1.0
    ) -> PointResponse:
        value = fundamental(harmonics) / self.periods[-1].drive
        return PointResponse(value, float(harmonics[0]), outcome, harmonics, defect, error, beyond)

    def residual(self) -> tuple[float, float, float] | None:
        """Return what still changed from the last period but one to the last.

        Phase [deg], gain (relative), mean of the output relative to its fundamental; all magnitudes.
        None before the second period and where one of the two has no fundamental.
        """
        if len(self.periods) < 2 or not all(p.responds(self._floor()) for p in self.periods[-2:]):
            return None
        before, last = self.periods[-2:]
        quotient = _value(last) / _value(before)
        drift = abs(float(last.harmonics[0] - before.harmonics[0])) / abs(fundamental(last.harmonics))
        return abs(math.degrees(cmath.phase(quotient))), abs(abs(quotient) - 1.0), drift

    @property
    def drift(self) -> float:
        """By how much the mean rises in each of the newest periods, in all alike [unit of output]; 0: it does not."""
        if not self.periods:
            return 0.0
        periods = np.array([p.harmonics for p in self.periods])
        rise, size = drift(periods), abs(fundamental(periods[-1]))
        if not rise and len(periods) > 1:  # seen through a transient that was removed
            limit = self._limit()
            rise = rise_of(periods, limit.weights) if limit.modes and limit.defect <= self._allowed() else 0.0
        return rise if abs(rise) > self._allowed() * size else 0.0

    def _repeats(self) -> bool:
        """Whether the last two periods pass the published test, and their other harmonics with them."""
        before, last = self.periods[-2], self.periods[-1]
        old, new = _value(before), _value(last)
        if old == 0.0:
            return False
        # The angle of the quotient is the difference modulo 2π, with no jump at ±180°.
        turned = abs(cmath.phase(new / old))
        grown = abs(abs(new) - abs(old))
        change = float(np.linalg.norm((last.compared - before.compared)[1:]))
        alike = change <= self.errcrit * abs(fundamental(last.harmonics))
        return turned <= self.errcrit and grown <= self.errcrit / 10.0 and alike

    def _runs_away(self) -> bool:
        sizes = [p.size for p in self.periods[-_RUNAWAY_PERIODS - 1 :]]
        return len(sizes) > _RUNAWAY_PERIODS and all(0.0 < _RUNAWAY_FACTOR * a <= b for a, b in pairwise(sizes))

    def _grows(self) -> bool:
        """Whether the changes between periods grow exponentially over the second half."""
        changes = np.linalg.norm(np.diff([p.compared for p in self.periods], axis=0), axis=1)
        window = changes[-max(3, len(changes) // 2) :]
        if len(window) < 3 or np.any(np.diff(window) <= 0.0) or window[0] == 0.0:
            return False
        half = (len(window) - 1) // 2
        first = math.log(window[half] / window[0]) / half
        second = math.log(window[-1] / window[half]) / (len(window) - 1 - half)
        return second >= 0.9 * first and first > math.log(1.1) * 4.0 / self.most


def _is_rough(period: Period, errcrit: float) -> bool:
    """Whether edges that were not resolved alone are more than an error that counts as settled."""
    return period.rough > errcrit / 10.0 * abs(fundamental(period.harmonics))


def _falls(sizes: Floats, count: int) -> float:
    """Return by what factor so many of the newest sizes fall from as many before them; newest first."""
    before = float(np.linalg.norm(sizes[count : 2 * count]))
    return float(np.linalg.norm(sizes[:count])) / before if before > 0.0 else math.inf


def _value(period: Period) -> complex:
    return fundamental(period.harmonics) / period.drive

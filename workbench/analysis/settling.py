"""When a forced model has settled, and what its response is then."""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass, field
from enum import Enum
from itertools import pairwise

import numpy as np

from workbench.analysis.harmonics import COMPARED, Period, fundamental
from workbench.analysis.transient import Limit, remove_transient
from workbench.session.base import Floats

__all__ = ["Outcome", "Response", "Settling"]

# A defect (see `transient`) below this is the solver's noise; asking for less would never end.
_NOISE = 1e-4

# So many periods in a row, each this much larger than the one before, are divergence at once.
_RUNAWAY_FACTOR, _RUNAWAY_PERIODS = 10.0, 6


class Outcome(Enum):
    """How a point ended."""

    RESOLVED = "settled, its transient removed"
    SETTLED = "settled by the published rule"
    AVERAGED = "averaged"
    DIVERGED = "grows without bound"
    SCATTERED = "scattered"


@dataclass(frozen=True)
class Response:
    """The response at one frequency and amplitude.

    Attributes:
        value: output over input, complex, [unit of output / unit of input].
        offset: mean of the output [unit of output].
        outcome: how it was obtained.
        harmonics: Fourier coefficients of the output, laid out as in `Period`, [unit of output].
        defect: by how much the response fails to repeat itself, relative to its fundamental: `transient.Limit`'s
            where one was believed, the scatter of the periods where they were averaged, else inf.
    """

    value: complex
    offset: float
    outcome: Outcome
    harmonics: Floats
    defect: float


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
         at most errcrit/100, but not below 1e-4. An error of the response of that size follows,
         a tenth of what the published gain test would let pass.
      2. SETTLED: the periods resist that description (sampling beats, noise), but the published
         test passes in the second half of the periods allowed, from where on the source report,
         too, takes the model to be stationary. The value is the same extrapolation: the last
         period with its drift removed, or better.
      3. AVERAGED: neither by the last period; as published. SCATTERED, which is a failure, if
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
        periods: what was added so far.
    """

    errcrit: float
    most: int
    periods: list[Period] = field(default_factory=list)

    def add(self, period: Period) -> Response | None:
        """Take one more period; return the response once it is known, else None."""
        self.periods.append(period)
        count = len(self.periods)
        if self._runs_away():
            return self._response(period.harmonics, Outcome.DIVERGED, math.inf)
        if count >= 2 and period.responds:
            limit = self._limit()
            if limit.defect <= max(self.errcrit / 100.0, _NOISE):
                return self._response(limit.harmonics, Outcome.RESOLVED, limit.defect)
            if 2 * count > self.most and self._repeats() and not self._grows():
                return self._response(limit.harmonics, Outcome.SETTLED, limit.defect)
        return self._last_resort() if count >= self.most else None

    def _limit(self) -> Limit:
        return remove_transient(np.array([p.harmonics for p in self.periods]), compared=1 + 2 * COMPARED)

    def _last_resort(self) -> Response:
        last = self.periods[-1].harmonics
        if self._grows():
            return self._response(last, Outcome.DIVERGED, math.inf)
        half = np.array([p.harmonics for p in self.periods[len(self.periods) // 2 :]])
        mean = np.mean(half, axis=0)
        if not any(p.responds for p in self.periods):
            return self._response(np.concatenate([mean[:1], 0.0 * mean[1:]]), Outcome.AVERAGED, math.inf)
        scatter = math.sqrt(float(np.mean(np.sum((half - mean)[:, 1:3] ** 2, axis=1))))
        scattered = scatter > abs(fundamental(mean))
        spread = scatter / abs(fundamental(mean)) if scatter > 0.0 else 0.0
        return self._response(mean, Outcome.SCATTERED if scattered else Outcome.AVERAGED, spread)

    def _response(self, harmonics: Floats, outcome: Outcome, defect: float) -> Response:
        value = fundamental(harmonics) / self.periods[-1].drive
        return Response(value, float(harmonics[0]), outcome, harmonics, defect)

    def residual(self) -> tuple[float, float, float] | None:
        """Return what still changed from the last period but one to the last.

        Phase [deg], gain (relative), mean of the output relative to its fundamental; all magnitudes.
        None before the second period and where one of the two has no fundamental.
        """
        if len(self.periods) < 2 or not all(p.responds for p in self.periods[-2:]):
            return None
        before, last = self.periods[-2:]
        quotient = _value(last) / _value(before)
        drift = abs(float(last.harmonics[0] - before.harmonics[0])) / abs(fundamental(last.harmonics))
        return abs(math.degrees(cmath.phase(quotient))), abs(abs(quotient) - 1.0), drift

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


def _value(period: Period) -> complex:
    return fundamental(period.harmonics) / period.drive

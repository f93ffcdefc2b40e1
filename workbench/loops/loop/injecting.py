"""Measure the loop transfer in closed loop: a sine is added, the signals on both sides of the sum are compared."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from workbench.core.values.linear import LinearPart
from workbench.errors import SimulationError
from workbench.loops.loop.cut import INJECTED, PASSED, RETURNED
from workbench.loops.loop.measured import LoopPoint
from workbench.loops.loop.points import Bench
from workbench.response.nfr.point import NfrPoint

__all__ = ["first_guess", "injected"]

# Relative: how near the amplitude of the signal passed on is to the one that is asked for. Where the gain falls with
# the amplitude, as behind a limit, a gain crossover moves by as much, and the phase margin there by 0.05°.
_NEAR = 0.001
_ROUNDS = 16
_EQUAL = 1e-4  # relative: injected amplitudes nearer than this are equal
_WIDEST = 4.0  # the injected sine changes by this factor at most from one round to the next


@dataclass(frozen=True)
class _Try:
    """One point under way: the injected amplitude, and what it gave.

    `below` and `above` are the nearest earlier tries on either side, ln injected and ln (seen / wanted).
    """

    frequency: float
    wanted: float
    injected: float
    passed: NfrPoint | None = None
    below: tuple[float, float] | None = None
    above: tuple[float, float] | None = None

    @property
    def seen(self) -> float:
        """Amplitude of the signal passed on; NaN where there is none, which ends the search."""
        if self.passed is None or not self.passed.response:
            return math.nan
        return abs(self.passed.response) * self.injected

    @property
    def hit(self) -> bool:
        """Whether the amplitude is the one that is asked for."""
        return abs(self.seen / self.wanted - 1.0) <= _NEAR

    @property
    def done(self) -> bool:
        return self.passed is not None and (self.hit or math.isnan(self.seen) or self.jumps)

    @property
    def jumps(self) -> bool:
        """Whether two injected amplitudes that are as good as equal pass on amplitudes on both sides."""
        return self.below is not None and self.above is not None and abs(self.above[0] - self.below[0]) < _EQUAL

    def with_point(self, point: NfrPoint) -> _Try:
        """Return the try with its measurement."""
        tried = replace(self, passed=point)
        if math.isnan(tried.seen):
            return tried
        here = (math.log(self.injected), math.log(tried.seen / self.wanted))
        return replace(tried, below=here) if here[1] < 0.0 else replace(tried, above=here)

    def next(self) -> _Try:
        """Return the next try: in proportion; once the amplitude lies between two, by the secant, well inside."""
        x, y = math.log(self.injected), math.log(self.seen / self.wanted)
        if self.below is None or self.above is None:
            aim = x - max(-math.log(_WIDEST), min(math.log(_WIDEST), y))
        else:
            (x0, y0), (x1, y1) = self.below, self.above
            part = min(max(y0 / (y0 - y1), 0.1), 0.9)
            aim = x0 + part * (x1 - x0)
        return replace(self, injected=math.exp(aim), passed=None)


def injected(bench: Bench, wanted: Sequence[tuple[float, float]]) -> list[LoopPoint]:
    """Measure points of the closed loop.

    With d the injected sine, y returned and z = y + d passed on, L = -Y/Z at the fundamental. d is changed until Z has
    the amplitude that is asked for, so that the amplitudes are those of the broken loop. The rest of the loop returns
    harmonics too, so z is not a pure sine; its distortion tells how far a describing function may be believed.
    Y and Z are measured in runs of their own; `balance` tells how well they fit.

    Not for a closed loop that is unstable or in a limit cycle: its periods do not repeat.

    Args:
        bench: on the system with the sum; its linear loop, where there is one, gives the first amplitudes.
        wanted: frequency [Hz] and amplitude of the signal passed on.
    """
    tries = [_Try(f, a, a * first_guess(bench.loop, f)) for f, a in wanted]
    for _ in range(_ROUNDS):
        open_ones = [i for i, t in enumerate(tries) if not t.done]
        fresh = [tries[i] if tries[i].passed is None else tries[i].next() for i in open_ones]
        result = bench.measure(INJECTED, PASSED, [(t.frequency, t.injected) for t in fresh])
        for i, t, point in zip(open_ones, fresh, result, strict=True):
            tries[i] = t.with_point(point)
        if not open_ones:
            break
    returned = bench.measure(INJECTED, RETURNED, [(t.frequency, t.injected) for t in tries])
    return [_point(t, y) for t, y in zip(tries, returned, strict=True)]


def first_guess(loop: LinearPart | None, frequency: float) -> float:
    """Return |1 + L|: the injected amplitude that passes an amplitude of 1 on, were the loop linear.

    Args:
        loop: linear L; None: not known.
        frequency: [Hz].
    """
    result = 1.0 if loop is None else abs(1.0 + loop.at(frequency))
    # At a pole or zero of 1 + L the guess is anything; the search begins nearby.
    return min(max(result, 1e-3), 1e3) if math.isfinite(result) else 1.0


def _point(tried: _Try, y: NfrPoint) -> LoopPoint:
    z = tried.passed
    if z is None or not z.response or y.response is None:
        nothing = ("the signal at the opened connection is zero", SimulationError.kind)
        reason, kind = next(((p.reason, p.kind) for p in (z, y) if p is not None and p.reason), nothing)
        return _failed(tried, reason, kind, 0 if z is None else z.periods)
    if not tried.hit:
        why = "it jumps past it as the injected sine grows" if tried.jumps else "the search for it came to no end"
        words = f"the signal passed on comes to no amplitude of {tried.wanted:.4g} ({tried.seen:.4g}): {why}"
        return _failed(tried, words, SimulationError.kind, z.periods)
    return LoopPoint(
        frequency_hz=tried.frequency,
        amplitude=tried.seen,
        value=-y.response / z.response,
        mean=z.offset,
        thd_passed=None if z.certificate is None else z.certificate.thd,
        thd_returned=None if y.certificate is None else y.certificate.thd,
        harmonics=() if y.certificate is None else y.certificate.harmonics,
        injected=tried.injected,
        balance=abs(z.response - y.response - 1.0),
        status="averaged" if z.averaged or y.averaged else "settled",
        error=None if z.error is None or y.error is None else z.error + y.error,
        periods=max(z.periods, y.periods),
    )


def _failed(tried: _Try, reason: str, kind: str | None, periods: int) -> LoopPoint:
    return LoopPoint(
        frequency_hz=tried.frequency,
        amplitude=math.nan,
        value=None,
        injected=tried.injected,
        status="failed",
        periods=periods,
        reason=reason,
        kind=kind,
    )

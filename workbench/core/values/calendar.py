"""One calendar for all that samples: exact periods, instants that are counted, what falls together.

A period that is declared as 0.1 means one tenth, which no double is. Instants that are computed from the rational
numbers that are meant are rounded once, so that those that coincide are the same double.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import reduce
from itertools import pairwise

from workbench.errors import InputError

__all__ = [
    "LONGEST",
    "TOGETHER",
    "Calendar",
    "PeriodsError",
    "Sampler",
    "check_countable",
    "check_periods",
    "exact",
    "gathered",
    "is_due",
    "rounding",
    "rounding_of",
    "simplest_between",
]

# Relative: periods within this have a common multiple. A thousand times what arithmetic leaves of a period that an FMU
# shows; 0.0333333 s three times is not 0.1 s, and a run over either holds four of its ticks.
TOGETHER = 1e-9

_BY_CHANCE = 1e-3  # expected number of fractions as simple within rounding, below which one is taken as meant
_MOST_ROUNDED = 2.0**20  # ulps; whoever adds up its period is off by half of one a tick at most: two million ticks
_MOST = 1e8  # samples of one run; the kernel makes about a million a second
LONGEST = 10_000  # instants of one sampler in a basic period; beyond that nobody wants to wait for it


def exact(value: float, ulps: float = 2.0) -> Fraction:
    """Return the rational number that is meant by a double: a simple fraction, or else its decimal literal.

    A fraction is meant if it is too simple to lie so near by chance: 1/10, 1/3, also where arithmetic rounded on the
    way to it.

    Args:
        value: finite.
        ulps: by how many units in the last place it may be off; the default is for what was written, or divided once.

    Example:
    >>> exact(0.1), exact(1 / 3), exact(3 * 0.1), exact(0.123456789012)
    (Fraction(1, 10), Fraction(1, 3), Fraction(3, 10), Fraction(30864197253, 250000000000))
    """
    reach = Fraction(ulps * math.ulp(value))
    result = simplest_between(Fraction(value) - reach, Fraction(value) + reach)
    by_chance = 2 * reach * result.denominator**2
    return Fraction(repr(float(value))) if by_chance > _BY_CHANCE else result


def simplest_between(low: Fraction, high: Fraction) -> Fraction:
    """Return the fraction with the smallest denominator in [low, high].

    Source: the Stern–Brocot tree; R. Graham, D. Knuth, O. Patashnik, Concrete Mathematics, 1994, section 4.5.

    Example:
    >>> simplest_between(Fraction(333, 1000), Fraction(334, 1000))
    Fraction(1, 3)
    """
    if low <= 0:
        return Fraction(0) if high >= 0 else -simplest_between(-high, -low)
    whole = math.ceil(low)
    if whole <= high:
        return Fraction(whole)
    whole -= 1
    return whole + 1 / simplest_between(1 / (high - whole), 1 / (low - whole))


def rounding(time: float) -> float:
    """Return how far apart two times of this size [s] may lie and still be the same instant [s]."""
    return _MOST_ROUNDED * math.ulp(time)


def rounding_of(time: float, wait: float) -> float:
    """Return the same for what is due so long after the stop before [s].

    Of one period, two million that are added up from 0 on are off by its 4096th part at most. At a late start a period
    is short beside that rounding, and few were added up: 8192 are off by a 256th of it.
    """
    return min(rounding(time), max(abs(wait) / 4096.0, rounding(time) / 256.0))


def is_due(due: float, now: float) -> bool:
    """Whether `due` [s] is now or past, or only rounding puts it later."""
    return due <= now + rounding(now)


def gathered(times: Iterable[float], now: float) -> float:
    """Return the next instant: of the times that are one with the first, the last, so that all of them are reached.

    Args:
        times: when something is due after `now` [s]; infinite: nothing is.
        now: [s].
    """
    known = list(times)
    first = min(known, default=math.inf)
    if first == math.inf:
        return first
    width = rounding_of(max(abs(now), abs(first)), first - now)
    return max(t for t in known if t <= first + width)


@dataclass(frozen=True)
class Sampler:
    """What samples at offset + k · period for all k from 0 on.

    Attributes:
        period: [s], positive.
        offset: the first instant [s].
        name: of the component, block or clock; two samplers that differ in it only are the same.

    Raises:
        InputError: the period is not positive, or so short that rounding at the first instant is half of it.
    """

    period: Fraction
    offset: Fraction = Fraction(0)
    name: str = field(default="", compare=False)

    def __post_init__(self) -> None:
        if self.period <= 0:
            raise InputError(f"a sample period must be positive, not {float(self.period):g} s")
        if 2.0 * rounding(float(self.offset)) > self.period:
            raise InputError(
                f"samples every {float(self.period):g} s cannot be told apart at a time of {float(self.offset):g} s: "
                f"times within {rounding(float(self.offset)):.2g} s are one instant there; start nearer to 0 s"
            )

    def since(self, time: float) -> Sampler:
        """Return the same multiples of the period, the first of them not before `time` [s]."""
        begin = Fraction(time) - Fraction(rounding(time))
        return replace(self, offset=self.offset + math.ceil((begin - self.offset) / self.period) * self.period)

    @property
    def integers(self) -> tuple[int, int, int]:
        """(first, step, denominator): instant k is (first + k · step) / denominator [s]."""
        denominator = math.lcm(self.period.denominator, self.offset.denominator)
        return int(self.offset * denominator), int(self.period * denominator), denominator

    def instant(self, k: int) -> float:
        """Return the time of instant k [s], rounded once."""
        return float(self.offset + k * self.period)

    def after(self, time: float) -> float:
        """Return the first instant later than `time` [s]."""
        k = max(0, math.floor((Fraction(time) - self.offset) / self.period))
        return next(t for t in map(self.instant, range(k, k + 3)) if t > time)


def check_countable(samplers: Iterable[Sampler], begin: float, end: float) -> None:
    """Refuse a run in which something samples so often that it would not end.

    Args:
        samplers: what samples in it.
        begin: [s].
        end: [s].

    Raises:
        InputError: one samples more than 1e8 times.
    """
    fastest = min(samplers, key=lambda s: s.period, default=None)
    if fastest is not None and (count := (end - begin) / float(fastest.period)) > _MOST:
        raise InputError(
            f"{fastest.name} samples every {float(fastest.period):g} s: {count:.2g} samples in a run from {begin:g} to "
            f"{end:.6g} s are more than the {_MOST:.0e} that end in reasonable time; enlarge its sample period"
        )


class PeriodsError(InputError):
    """Sample periods that a user gives for a model which, as it says or shows, repeats after others only."""


def check_periods(given: Sequence[float], own: Iterable[float], model: str) -> None:
    """Refuse sample periods after which a model cannot repeat.

    Args:
        given: in place of the model's own [s], one at least.
        own: those that the model declares or shows [s].
        model: its name, for the message.

    Raises:
        PeriodsError: the periods given repeat together after a time that is no multiple of one of the model's own.
    """
    basic = Calendar(tuple(Sampler(exact(p)) for p in given)).basic_period
    ratios = {p: float(basic) / p for p in own}
    apart = sorted(p for p, ratio in ratios.items() if abs(ratio - max(1, round(ratio))) > TOGETHER * ratio)
    if apart:
        own_listed, listed = (", ".join(f"{p:.9g}" for p in periods) for periods in (sorted(ratios), given))
        raise PeriodsError(
            f"{model} samples every {own_listed} s; periods {listed} s repeat together after {float(basic):.9g} s, "
            f"which is no multiple of {apart[0]:.9g} s: add that period, or leave periods out"
        )


@dataclass(frozen=True)
class Calendar:
    """Several samplers on one time axis.

    Attributes:
        samplers: one at least.

    Example:
    >>> Calendar((Sampler(exact(0.04)), Sampler(exact(0.06)))).basic_period
    Fraction(3, 25)
    """

    samplers: tuple[Sampler, ...]

    @property
    def basic_period(self) -> Fraction:
        """The shortest time after which all samplers repeat together [s].

        Raises:
            InputError: it is longer than 10 000 periods of the fastest sampler.
        """
        periods = [s.period for s in self.samplers]
        result = 1 / _gcd(1 / p for p in periods)
        if result > LONGEST * min(periods):
            listed = ", ".join(f"{float(p):.12g}" for p in sorted(set(periods)))
            raise InputError(
                f"the sample periods {listed} s repeat together after {float(result):.6g} s only, "
                f"{float(result / min(periods)):.3g} of the shortest; round them, or give periods"
            )
        return result

    @property
    def longest_gap(self) -> float:
        """The longest time between two instants, once all samplers have begun [s].

        Raises:
            InputError: see `basic_period`.
        """
        basic = self.basic_period
        instants = {(s.offset + k * s.period) % basic for s in self.samplers for k in range(int(basic / s.period))}
        times = sorted(instants)
        return float(max(b - a for a, b in pairwise([*times, times[0] + basic])))


def _gcd(values: Iterable[Fraction]) -> Fraction:
    """Return the largest fraction of which all are integer multiples; zeros do not count."""
    return reduce(_gcd_of_two, values, Fraction(0))


def _gcd_of_two(a: Fraction, b: Fraction) -> Fraction:
    denominator = math.lcm(a.denominator, b.denominator)
    return Fraction(math.gcd(int(a * denominator), int(b * denominator)), denominator)

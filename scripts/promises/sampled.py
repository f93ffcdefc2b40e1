"""Measure how often the error that the frequency response of a sampled model states covers the truth.

Each model samples every 0.01 … 1 s (logarithmic) and filters what it sampled by (1 − p)/(z − p) or its square, p = 0 …
0.95. Every second one has a continuous lag of 0.1 … 50 sample periods in front of the sampler; its outputs are what is
held, and that behind such a lag. They are forced at 0.02 … 0.98 of half the rate. The Fourier integrals of each period
are those of the exact motion, and nothing is integrated numerically; the truth is known in closed form.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scripts.promises.trial import Trial, lines
from workbench.core.values.arrays import Floats
from workbench.response.nfr.beats import Beat
from workbench.response.nfr.error import Evidence
from workbench.response.nfr.settling import Settling, SettlingOutcome
from workbench.response.periodic.fourier import ORDERS, Period

_STATUS = {
    SettlingOutcome.RESOLVED: "settled",
    SettlingOutcome.SETTLED: "settled",
    SettlingOutcome.AVERAGED: "averaged",
}


@dataclass(frozen=True)
class SampledPlant:
    """A sampled filter between continuous lags.

    Attributes:
        dt: sampling interval [s].
        pole: of the filter.
        order: how many of them, one after the other.
        before, behind: time constants of the lags [s]; 0: there is none.
    """

    dt: float
    pole: float
    order: int
    before: float
    behind: float

    @classmethod
    def random(cls, random: np.random.Generator) -> SampledPlant:
        """Return one."""
        dt = 10.0 ** random.uniform(-2.0, 0.0)
        before, behind = dt * 10.0 ** random.uniform(-1.0, math.log10(50.0), 2)
        return cls(
            dt, random.uniform(0.0, 0.95), int(random.integers(1, 3)), before * random.integers(0, 2), float(behind)
        )

    def truth(self, f: float) -> tuple[complex, complex]:
        """Return the responses of what is held and of what is behind the lag."""
        s = 2j * math.pi * f
        z = cmath.exp(s * self.dt)
        held = ((1.0 - self.pole) / (1.0 - self.pole / z)) ** self.order * (1.0 - 1.0 / z) / (s * self.dt)
        held /= 1.0 + s * self.before
        return held, held / (1.0 + s * self.behind)

    def periods(self, f: float, count: int) -> tuple[Floats, Floats]:
        """Return the Fourier coefficients of both outputs under sin(2πft) from rest, shapes (count, 1 + 2·orders)."""
        ticks = self.dt * np.arange(math.ceil(count / (f * self.dt)) + 1, dtype=np.float64)
        value = self._sampled(f, ticks)
        lagged = self._lagged(value)
        # Rows of constant value: from one sample or period to the next.
        borders = np.unique(np.concatenate([ticks, np.arange(count + 1) / f]))
        borders = borders[borders <= (count + 1e-9) / f]
        begin, end = borders[:-1], borders[1:]
        middle = 0.5 * (begin + end)
        # Where borders coincide but for rounding, a sliver lies behind the last period.
        tick, period = (middle / self.dt).astype(int), np.minimum((middle * f).astype(int), count - 1)
        rate = 1.0 / self.behind
        away = (lagged - value)[tick] * np.exp(-rate * (begin - ticks[tick]))
        held, behind = np.zeros((2, count, 1 + 2 * ORDERS))
        for n in range(ORDERS + 1):
            w = -2j * math.pi * n * f
            constant = _exponential(w, begin, end)
            decaying = _exponential(w - rate, begin, end, begin)
            for found, parts in (
                (held, value[tick] * constant),
                (behind, value[tick] * constant + away * decaying),
            ):
                total = f * (np.bincount(period, parts.real, count) + 1j * np.bincount(period, parts.imag, count))
                if n == 0:
                    found[:, 0] = total.real
                else:
                    found[:, 2 * n - 1], found[:, 2 * n] = -2.0 * total.imag, 2.0 * total.real
        return held, behind

    def _sampled(self, f: float, ticks: Floats) -> Floats:
        """Return what the filter holds from each tick on."""
        angle = 2.0 * math.pi * f * ticks
        value: Floats = np.sin(angle)
        if self.before > 0.0:
            g = 1.0 / (1.0 + 2j * math.pi * f * self.before)
            value = (g * np.exp(1j * angle)).imag - g.imag * np.exp(-ticks / self.before)
        for _ in range(self.order):
            last = 0.0
            for k, new in enumerate(value.tolist()):
                value[k] = last = self.pole * last + (1.0 - self.pole) * new
        return value

    def _lagged(self, value: Floats) -> Floats:
        """Return the lag at each tick."""
        found, keep = np.zeros(len(value)), math.exp(-self.dt / self.behind)
        for k in range(len(value) - 1):
            found[k + 1] = value[k] + keep * (found[k] - value[k])
        return found


def _exponential(rate: complex, begin: Floats, end: Floats, origin: Floats | float = 0.0) -> NDArray[np.complex128]:
    """Return ∫ e^(rate·t) dt; the real part of the exponent counts from `origin`."""
    if rate == 0.0:
        return (end - begin).astype(np.complex128)
    start = np.exp(rate * begin - rate.real * origin)
    return np.asarray(start * np.expm1(rate * (end - begin)) / rate)


def measure(periods: Floats, truth: complex, beat: Beat, *, max_periods: int) -> Trial:
    """Return what the periods are taken for."""
    settling = Settling(errcrit=0.1, most=max_periods, evidence=Evidence(beat=beat, sampled=True))
    added = (settling.add(Period(h, 1.0 + 0j, float(np.abs(h).sum()))) for h in periods)
    response = next(r for r in added if r is not None)
    status = _STATUS.get(response.outcome, "failed")
    stated = response.error if math.isfinite(response.error) else math.nan
    return Trial(status, stated, abs(response.value - truth) / abs(truth), len(settling.periods))


def trials(models: int, seed: int, *, max_periods: int = 20, frequencies: int = 10) -> Iterator[Trial]:
    """Measure random models."""
    random = np.random.default_rng(seed)
    for _ in range(models):
        plant = SampledPlant.random(random)
        for part in random.uniform(0.02, 0.98, frequencies):
            yield from trials_of(plant, 0.5 * part / plant.dt, max_periods=max_periods)


def trials_of(plant: SampledPlant, f: float, *, max_periods: int) -> Iterator[Trial]:
    """Measure what is held, and what is behind the lag."""
    for periods, truth in zip(plant.periods(f, max_periods), plant.truth(f), strict=True):
        yield measure(periods, truth, Beat(f, plant.dt), max_periods=max_periods)


def good(found: list[Trial]) -> bool:
    """Whether 95 % of the errors of settled and of averaged points hold, and no settled point is 1 % off."""
    for status in ("settled", "averaged"):
        of = [t for t in found if t.status == status and math.isfinite(t.stated)]
        if sum(t.true <= t.stated for t in of) < 0.95 * len(of):
            return False
    return not any(t.true > 0.01 for t in found if t.status == "settled")


def run(*, cases: int = 150, seed: int = 1, max_periods: int = 20) -> int:
    """Return 1 if points fall short.

    Args:
        cases: models, at ten frequencies and two outputs each.
        seed: of the first.
        max_periods: waited for at most; with 60 more of them settle.
    """
    found = list(trials(cases, seed, max_periods=max_periods))
    print("\n".join(lines(found)))
    return int(not good(found))

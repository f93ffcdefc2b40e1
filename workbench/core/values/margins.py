"""Margins of a loop: how much gain, phase, delay, or both gain and phase at once, it tolerates."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from workbench.core.records.record import RecordPart, entry
from workbench.core.values.decibels import decibels

__all__ = [
    "BORDER", "STABLE", "SUPPOSED", "UNKNOWN", "UNSTABLE", "DiskMargin", "GainCrossover", "Margins", "PhaseCrossover",
    "disk_of",
]  # fmt: skip

STABLE, UNSTABLE, BORDER, UNKNOWN = "stable", "unstable", "at the border", "unknown"  # verdicts on a closed loop
SUPPOSED = "not judged"  # of a curve that is read without its system: margins hold if the closed loop is stable


@dataclass(frozen=True)
class PhaseCrossover(RecordPart):
    """A frequency at which L is real and negative: a factor on the gain alone brings the loop to the border there.

    Attributes:
        frequency_hz: [Hz]; infinite: the direct part.
        factor: 1/|L|; above 1: the gain may grow so much (gain margin), below 1: it may fall to so much.
        upwards: L crosses the negative real axis from below to above as the frequency rises.
    """

    frequency_hz: float = field(metadata=entry(null=math.inf))
    factor: float
    upwards: bool = True

    def derived(self) -> dict[str, Any]:
        """Return the factor in decibels."""
        return {"db": self.db}

    @property
    def db(self) -> float:
        """20·log10 of the factor [dB]."""
        return float(decibels(self.factor))


@dataclass(frozen=True)
class GainCrossover:
    """A frequency at which |L| = 1: a phase lag or a delay alone brings the loop to the border there.

    Attributes:
        frequency_hz: [Hz].
        phase_margin_deg: 180° + arg L, in (-180°, 180°] [deg]; negative: the nearest way to the border is a lead.
        delay_s: delay that brings the loop to the border at this frequency [s]; NaN: the signal acts several times in
            a basic period.
    """

    frequency_hz: float
    phase_margin_deg: float
    delay_s: float

    @classmethod
    def of(cls, frequency_hz: float, value: complex) -> GainCrossover:
        """Return the crossover at which L has this value."""
        lag = math.degrees(math.atan2(value.imag, value.real)) + 180.0  # [0, 360]: so much lag, or
        if lag < 1e-9:
            lag = 0.0
        return cls(frequency_hz, lag - 360.0 if lag > 180.0 else lag, lag / 360.0 / frequency_hz)


@dataclass(frozen=True)
class DiskMargin:
    """What gain and phase may do at once, and independently over frequency (skew 0).

    The loop stays stable for every factor on L inside the disk of diameter (low, high).

    Attributes:
        alpha: size of the disk, 2 / max |S - T|.
        low, high: the gain may be anything between these factors, (2 - α)/(2 + α) and (2 + α)/(2 - α).
        phase_deg: or the phase may turn by so much either way, 2 atan(α/2) [deg].
        frequency_hz: where it is smallest [Hz].
    """

    alpha: float
    low: float
    high: float = field(metadata=entry(null=math.inf))
    phase_deg: float
    frequency_hz: float


@dataclass(frozen=True, kw_only=True)
class Margins(RecordPart):
    """Margins of one loop transfer. Of a closed loop that is unstable, or perhaps so, single numbers are NaN.

    The crossovers are facts of L and stand here whether the closed loop is stable or not.

    Attributes:
        verdict: on the closed loop: "stable", "unstable", "at the border", "unknown", or "not judged" (see
            `Response.margins`).
        words: verdict and reason, one line.
        phase_crossovers: all, by frequency.
        gain_crossovers: all, by frequency.
        disk: skew 0; None where the single numbers are NaN.
        peak_sensitivity: max |S|; its inverse is the distance of L from -1.
        peak_sensitivity_hz: where [Hz].
        peak_complementary: max |T|.
        peak_complementary_hz: where [Hz].
        everywhere: all frequencies were looked at; else what was not found is not known: NaN in place of infinity.
        direct: |L| at infinite frequency, of a continuous loop. At 1 or more the closed loop with a delay, however
            short, has a chain of poles that reaches the border or passes it, and the delay margin is 0.
    """

    verdict: str = field(metadata=entry(key="closed_loop"))
    words: str
    phase_crossovers: tuple[PhaseCrossover, ...]
    gain_crossovers: tuple[GainCrossover, ...]
    disk: DiskMargin | None = field(metadata=entry(key="disk_margin"))
    peak_sensitivity: float
    peak_sensitivity_hz: float
    peak_complementary: float
    peak_complementary_hz: float
    everywhere: bool = True
    direct: float = 0.0

    def __str__(self) -> str:
        """Return one line: the smallest margins, where they are, and the verdict."""
        if not self.meaningful or math.isnan(self.peak_sensitivity):
            return self.words
        gain = f"gain {self.gain_margin_db:.3g} dB" + _where(self.phase_crossover_hz)
        phase = f"phase {self.phase_margin_deg:.3g} deg" + _where(self.gain_crossover_hz)
        return f"margins: {gain}, {phase}, delay {self.delay_margin_s:.3g} s; {self.words}"

    @property
    def meaningful(self) -> bool:
        """Whether the closed loop is known, or supposed, to be stable."""
        return self.verdict in (STABLE, SUPPOSED)

    @property
    def crossovers_hz(self) -> tuple[float, ...]:
        """Frequencies of all crossovers, without 0 and infinity, rising [Hz]."""
        every = (*(c.frequency_hz for c in self.gain_crossovers), *(c.frequency_hz for c in self.phase_crossovers))
        return tuple(sorted(f for f in every if 0.0 < f < math.inf))

    @property
    def gain_margin(self) -> float:
        """Smallest factor above 1 that brings the loop to the border; infinite: none does."""
        return self._if(
            min((c.factor for c in self.phase_crossovers if c.factor > 1.0), default=self._absent(math.inf))
        )

    @property
    def gain_margin_db(self) -> float:
        """The same in dB."""
        return float(decibels(self.gain_margin))

    @property
    def gain_reduction(self) -> float:
        """Largest factor below 1 that brings the loop to the border; 0: none does."""
        return self._if(max((c.factor for c in self.phase_crossovers if c.factor <= 1.0), default=self._absent(0.0)))

    @property
    def gain_reduction_db(self) -> float:
        """The same in dB."""
        return float(decibels(self.gain_reduction))

    @property
    def phase_margin_deg(self) -> float:
        """Phase margin of the smallest size [deg]; infinite: |L| is 1 nowhere."""
        result = self._nearest()
        return self._if(result.phase_margin_deg if result else self._absent(math.inf))

    @property
    def delay_margin_s(self) -> float:
        """Smallest additional delay that brings the loop to the border [s]; infinite: none does."""
        if self.direct >= 1.0:
            return self._if(0.0)
        return self._if(min((c.delay_s for c in self.gain_crossovers), default=self._absent(math.inf)))

    @property
    def phase_crossover_hz(self) -> float:
        """Frequency of the gain margin [Hz]; NaN: there is none."""
        up = [c for c in self.phase_crossovers if c.factor > 1.0]
        return self._if(min(up, key=lambda c: c.factor).frequency_hz if up else math.nan)

    @property
    def gain_crossover_hz(self) -> float:
        """Frequency of the phase margin [Hz]; NaN: there is none."""
        result = self._nearest()
        return self._if(result.frequency_hz if result else math.nan)

    def _nearest(self) -> GainCrossover | None:
        return min(self.gain_crossovers, key=lambda c: abs(c.phase_margin_deg), default=None)

    def _absent(self, value: float) -> float:
        return value if self.everywhere else math.nan

    def _if(self, value: float) -> float:
        return value if self.meaningful else math.nan

    def derived(self) -> dict[str, Any]:
        """Return the margins in single numbers."""
        single = (
            "gain_margin", "gain_margin_db", "gain_reduction", "gain_reduction_db", "phase_crossover_hz",
            "phase_margin_deg", "gain_crossover_hz", "delay_margin_s",
        )  # fmt: skip
        return {name: getattr(self, name) for name in single}


def _where(frequency_hz: float) -> str:
    return f" at {frequency_hz:.3g} Hz" if math.isfinite(frequency_hz) else ""


def disk_of(largest: float, frequency_hz: float) -> DiskMargin:
    """Return the disk margin whose max |S - T| is given."""
    alpha = 2.0 / largest if largest > 0.0 else math.inf
    high = (2.0 + alpha) / (2.0 - alpha) if alpha < 2.0 else math.inf
    low = (2.0 - alpha) / (2.0 + alpha) if math.isfinite(alpha) else -1.0
    return DiskMargin(alpha, low, high, math.degrees(2.0 * math.atan(0.5 * alpha)), frequency_hz)

"""Frequency responses as requirements read them, whichever command measured or computed them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from workbench.study.kinds.base import NotMeasured

__all__ = ["QUANTITIES", "Curve", "interpolate", "unwrap"]

QUANTITIES = ("gain", "phase", "offset")
_SAME = 1e-9  # frequencies that differ by less are the same


@dataclass(frozen=True, kw_only=True)
class Curve:
    """One frequency response.

    Attributes:
        label: which one, such as "amplitude 4"; empty: there is only one.
        amplitude: of the sine; None: it is a linear model's.
        frequency: rising [Hz].
        gain: [dB].
        phase: [deg], without jumps.
        offset: mean of the output [its unit]; empty: not known.
        averaged: frequencies at which the response never settled [Hz].
        failed: frequency [Hz] → why there is no value.
        unit: of the offset.
    """

    label: str = ""
    amplitude: float | None = None
    frequency: Sequence[float]
    gain: Sequence[float]
    phase: Sequence[float]
    offset: Sequence[float] = ()
    averaged: Sequence[float] = ()
    failed: Mapping[float, str] = field(default_factory=dict)
    unit: str | None = None

    def values(self, quantity: str) -> Sequence[float]:
        """Return gain [dB], phase [deg] or offset, one for each frequency.

        Raises:
            NotMeasured: there is none.
        """
        found: Sequence[float] = getattr(self, quantity)
        if not self.frequency:
            raise NotMeasured(next(iter(self.failed.values()), "no point was measured"))
        if not found:
            raise NotMeasured(f"the result has no {quantity}")
        return found

    def at(self, quantity: str, frequency: float) -> float:
        """Return a value at a frequency, interpolated linearly over log frequency (gain in dB).

        Args:
            quantity: of `QUANTITIES`.
            frequency: [Hz].

        Raises:
            NotMeasured: outside of the measured frequencies, or the point failed.
        """
        values = self.values(quantity)
        self.check_failed(frequency, frequency)
        low, high = self.frequency[0], self.frequency[-1]
        if not self.reaches(frequency):
            raise NotMeasured(f"{frequency:g} Hz is outside of the measured {low:g} to {high:g} Hz{self.told}")
        return interpolate(frequency, self.frequency, values)

    def reaches(self, frequency: float) -> bool:
        """Whether a frequency [Hz] lies between the first and the last one."""
        return self.frequency[0] * (1.0 - _SAME) <= frequency <= self.frequency[-1] * (1.0 + _SAME)

    def only(self, frequencies: Sequence[float]) -> Curve:
        """Return the curve at some of its frequencies [Hz]."""
        kept = [k for k, f in enumerate(self.frequency) if f in set(frequencies)]
        return replace(
            self,
            frequency=[self.frequency[k] for k in kept],
            gain=[self.gain[k] for k in kept],
            phase=[self.phase[k] for k in kept],
        )

    def check_failed(self, low: float, high: float) -> None:
        """Raise where a point between two frequencies [Hz] failed.

        Raises:
            NotMeasured: which one, and why.
        """
        for frequency, reason in self.failed.items():
            if low * (1.0 - _SAME) <= frequency <= high * (1.0 + _SAME):
                raise NotMeasured(f"the point at {frequency:.4g} Hz{self.told} failed: {reason}")

    @property
    def told(self) -> str:
        """The label after a comma, for messages."""
        return f", {self.label}" if self.label else ""

    def where(self, frequency: float) -> str:
        """Return a place for people: "4.2 Hz, amplitude 4 (averaged)"."""
        averaged = any(math.isclose(frequency, f, rel_tol=_SAME) for f in self.averaged)
        return f"{frequency:.4g} Hz{self.told}{' (averaged)' if averaged else ''}"


def interpolate(frequency: float, frequencies: Sequence[float], values: Sequence[float]) -> float:
    """Return the value at a frequency inside of `frequencies` (rising), linear over log frequency."""
    return float(np.interp(math.log(frequency), np.log(frequencies), values))


def unwrap(phases: Sequence[float]) -> list[float]:
    """Return phases [deg] with jumps of more than half a turn taken out."""
    found: list[float] = np.unwrap(phases, period=360.0).tolist()
    return found

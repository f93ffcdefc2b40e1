"""Bandwidth of a frequency response."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

from workbench.study.kinds.base import Limited, NotMeasured, Result, Value
from workbench.study.kinds.curve import Curve
from workbench.study.kinds.response import UNITS, OfResponse, Positive

__all__ = ["Bandwidth"]


class Bandwidth(OfResponse, Limited):
    """The frequency at which the gain has fallen by 3 dB, or the phase to −90° [Hz].

    Attributes:
        criterion: "gain" or "phase".
        drop: how far the gain falls [dB].
        reference: gain [dB] from which it falls; None: that at the lowest frequency.
        angle: the phase [deg].
    """

    units = ("Hz",)

    criterion: Literal["gain", "phase"] = "gain"
    drop: Positive = 3.0
    reference: float | None = None
    angle: float = -90.0

    def values(self, result: Result) -> list[Value]:
        return [self._value(curve) for curve in self.responses(result)]

    def _value(self, curve: Curve) -> Value:
        values = curve.values(self.criterion)
        level = self.angle if self.criterion == "phase" else self._level(values)
        crossed = _falls_below(curve.frequency, values, level)
        curve.check_failed(0.0, crossed or math.inf)
        if crossed is not None:
            return Value(value=crossed, where=curve.label, unit="Hz")
        last = curve.frequency[-1]
        # Enough for a smallest bandwidth; for a largest one nothing is known beyond.
        if self.max is not None or self.equal is not None or (self.min or 0.0) > last:
            raise NotMeasured(f"{level:.4g} {UNITS[self.criterion]} is not reached up to {last:g} Hz{curve.told}")
        return Value(value=last, where=f"not reached up to {last:g} Hz{curve.told}", unit="Hz")

    def _level(self, values: Sequence[float]) -> float:
        return (values[0] if self.reference is None else self.reference) - self.drop


def _falls_below(frequencies: Sequence[float], values: Sequence[float], level: float) -> float | None:
    """Return the first frequency at which the values fall to a level; None: they do not."""
    if values[0] <= level:
        return frequencies[0]
    for k in range(1, len(values)):
        if values[k] <= level:
            part = (values[k - 1] - level) / (values[k - 1] - values[k])
            return frequencies[k - 1] * math.exp(part * math.log(frequencies[k] / frequencies[k - 1]))
    return None

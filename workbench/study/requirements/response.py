"""Requirements on frequency responses: at one frequency, bandwidth, masks."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from workbench.core.values.arrays import Floats
from workbench.errors import InputError
from workbench.study.requirements.base import (
    Compliance,
    Limited,
    NotMeasured,
    Requirement,
    Result,
    Value,
    judge,
    worst,
)  # fmt: skip
from workbench.study.requirements.curves import READERS, Curve, curves, interpolate

__all__ = ["UNITS", "Bandwidth", "Gain", "Mask", "OfResponse", "Offset", "Phase", "Positive"]

# Of a response; an offset has the unit of the output.
UNITS = {"gain": "dB", "phase": "deg"}
_INTERPOLATED = "between points: let nfr measure it, by `bandwidth`, or bring its frequencies closer together"
_BETWEEN = "between points: let nfr measure that frequency, too"
_MEASURED_SO = "as nfr measured it: measure with a tighter tolerance"
_SAME = 1e-9  # frequencies that differ by less are the same

Positive = Annotated[float, Field(gt=0.0)]
_Corner = Annotated[list[float], Field(min_length=2, max_length=2)]


class OfResponse(Requirement):
    """A requirement on frequency responses.

    Attributes:
        amplitude: only the response at this one; None: all, and the worst decides.
        source: "linear" or "measured", of a loop.
        input, output: of a linear model with several.
        plant: what an identified model stands for: "continuous" takes the hold of its data out, so that it can be held
            against sines; "sampled" adds the hold of a sampled plant; "held" leaves it as it is.
    """

    commands: ClassVar[tuple[str, ...]] = tuple(READERS)

    amplitude: Positive | None = None
    source: Literal["linear", "measured"] | None = None
    input: str | None = None
    output: str | None = None
    plant: Literal["continuous", "sampled", "held"] = "continuous"

    def responses(self, result: Result, at: Sequence[float] = ()) -> list[Curve]:
        """Return the responses that count.

        Args:
            result: of the analysis.
            at: frequencies at which a linear model is evaluated [Hz], besides those around its poles.
        """
        return curves(
            result, at=at, amplitude=self.amplitude, source=self.source, input=self.input, output=self.output,
            plant=self.plant,
        )  # fmt: skip


class _Interpolated(OfResponse, Limited):
    """A value that may lie between two points of a measured response."""

    def doubt(self, value: float, *ends: float) -> float:
        """Return how far a value may be off towards its limits, where the response does not turn between its ends."""
        towards_min = self.min is not None or self.max is None
        towards_max = self.max is not None or self.min is None
        return max(towards_min * (value - min(ends)), towards_max * (max(ends) - value))


class _AtFrequency(_Interpolated):
    """A value at one frequency.

    Between two measured ones it is interpolated, over log frequency, and they are told: a limit that lies between what
    was measured at the two is not met. A response that turns between them is not seen: its points are too far apart.

    Attributes:
        frequency: [Hz].
    """

    quantity: ClassVar[str]

    frequency: Positive

    def values(self, result: Result) -> list[Value]:
        return [self._value(curve) for curve in self.responses(result, (self.frequency,))]

    def _value(self, curve: Curve) -> Value:
        value = curve.at(self.quantity, self.frequency)
        where = curve.where_phase(self.frequency) if self.quantity == "phase" else curve.where(self.frequency)
        unit, around = UNITS.get(self.quantity, curve.unit), curve.around(self.frequency)
        if around is None:
            return Value(value=value, where=where, unit=unit)
        (low, high), ends = ([x[k] for k in around] for x in (curve.frequency, curve.values(self.quantity)))
        where = f"{where}, between {low:.4g} and {high:.4g} Hz"
        return Value(value=value, where=where, unit=unit, error=self.doubt(value, *ends), remedy=_BETWEEN)


class Gain(_AtFrequency):
    """Gain at a frequency [dB]."""

    quantity = "gain"
    units = ("dB",)


class Phase(_AtFrequency):
    """Phase at a frequency [deg]."""

    quantity = "phase"
    units = ("deg",)


class Offset(_AtFrequency):
    """Mean of the output at a frequency [its unit]."""

    commands: ClassVar[tuple[str, ...]] = ("nfr",)
    quantity = "offset"


class Bandwidth(_Interpolated):
    """The frequency at which the gain has fallen by 3 dB, or the phase to −90° [Hz].

    Where `nfr` measured it between the points (its option `bandwidth`, with the same drop; −90° goes along), that is
    its value. That of a linear model is exact. Else it is interpolated in dB (or deg) over log frequency between two
    points, which are told: a limit between them is not met, since nothing is known of the curve there.

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
        features = {one["amplitude"]: one for one in result.get("features", ())}
        return [self._value(curve, features.get(curve.amplitude, {})) for curve in self.responses(result)]

    def _value(self, curve: Curve, features: Mapping[str, Any]) -> Value:
        values = curve.values(self.criterion)
        level = self.angle if self.criterion == "phase" else self._level(values)
        crossed = _falls_below(curve, self.criterion, level)
        curve.check_failed(0.0, math.inf if crossed is None else crossed.high)
        measured, error = self._measured(features)
        if crossed is not None and crossed.low <= measured <= crossed.high:
            where = ", ".join(filter(None, [f"measured to ± {error:.1g} Hz", curve.label]))
            return Value(value=measured, where=where, unit="Hz", error=error, remedy=_MEASURED_SO)
        doubt = curve.doubt if self.criterion == "phase" else ""
        if crossed is not None:
            words = filter(None, [crossed.words, curve.label, doubt])
            where = ", ".join(words)
            error = 0.0 if crossed.at_a_point else self.doubt(crossed.value, crossed.low, crossed.high)
            return Value(value=crossed.value, where=where, unit="Hz", error=error, remedy=_INTERPOLATED)
        last = curve.frequency[-1]
        # Enough for a smallest bandwidth; for a largest one nothing is known beyond.
        if self.max is not None or self.equal is not None or (self.min or 0.0) > last:
            raise NotMeasured(f"{level:.4g} {UNITS[self.criterion]} is not reached up to {last:g} Hz{curve.told}")
        where = ", ".join(filter(None, [f"not reached up to {last:g} Hz{curve.told}", doubt]))
        return Value(value=last, where=where, unit="Hz")

    def _measured(self, features: Mapping[str, Any]) -> tuple[float, float]:
        """Return what was measured between the points, and its error [Hz]; NaN: nothing, or another quantity."""
        by_phase = self.criterion == "phase"
        same = self.angle == -90.0 if by_phase else self.reference is None and self.drop == features.get("drop_db")
        name = "lag" if by_phase else "bandwidth"
        value, error = (features.get(key) if same else None for key in (f"{name}_hz", f"{name}_error_hz"))
        return (value, error) if value is not None and error is not None else (math.nan, math.nan)

    def _level(self, values: Sequence[float]) -> float:
        return (values[0] if self.reference is None else self.reference) - self.drop


@dataclass(frozen=True)
class _Crossed:
    """Where values fall to a level.

    Attributes:
        value: by a straight line, or a point at the level itself [Hz].
        low, high: the points before and after it [Hz].
    """

    value: float
    low: float
    high: float

    @property
    def at_a_point(self) -> bool:
        """Whether a point is at the level itself."""
        return any(math.isclose(self.value, end, rel_tol=_SAME) for end in (self.low, self.high))

    @property
    def words(self) -> str:
        """Between which points; empty: it is one of them."""
        return f"between {self.low:.4g} and {self.high:.4g} Hz" if self.low < self.value < self.high else ""


def _falls_below(curve: Curve, quantity: str, level: float) -> _Crossed | None:
    """Return where a curve first falls to a level; None: it does not."""
    frequencies, values = curve.frequency, curve.values(quantity)
    if values[0] <= level:
        return _Crossed(frequencies[0], frequencies[0], frequencies[0])
    for k in range(1, len(values)):
        if values[k] <= level:
            low, high = frequencies[k - 1 : k + 1]
            if curve.exact is not None:
                place = _bisected(curve, quantity, level, low, high)
                return _Crossed(place, place, place)
            part = (values[k - 1] - level) / (values[k - 1] - values[k])
            return _Crossed(low * (high / low) ** part, low, high)
    return None


def _bisected(curve: Curve, quantity: str, level: float, low: float, high: float) -> float:
    """Return where a linear model, above a level at one frequency and not at the next, falls to it [Hz]."""
    while (middle := math.sqrt(low * high)) > low and middle < high:
        if curve.at(quantity, middle) > level:
            low = middle
        else:
            high = middle
    return high


class Mask(OfResponse):
    """Gain, phase or offset between an upper and a lower mask over a band.

    A mask is a list of [frequency, value], straight in dB (or deg) over log frequency; a frequency given twice is
    a step. Mask and measured response are compared at the corners of both, which is exact for straight lines; a linear
    model, which is known at every frequency, wherever it is nearest to the mask.

    Attributes:
        quantity: what the mask is for.
        upper, lower: corners ([Hz], [dB], [deg] or unit of the output).
    """

    quantity: Literal["gain", "phase", "offset"] = "gain"
    upper: list[_Corner] | None = None
    lower: list[_Corner] | None = None

    def check(self, where: str, commands: Sequence[str]) -> None:
        super().check(where, commands)
        if self.quantity == "offset" and commands[0] != "nfr":
            raise InputError(f"{where}: only nfr measures an offset; [analyses.{self.analysis}] runs {commands[0]}")
        if not self.upper and not self.lower:
            raise InputError(f"{where}: has no limit; give upper or lower, as in upper = [[1, 3], [10, -6]]")
        for side in ("upper", "lower"):
            _check_corners(f"{where}: {side}", getattr(self, side))
        self._check_order(where)

    def _check_order(self, where: str) -> None:
        """Nothing fits between masks that cross."""
        if not self.upper or not self.lower:
            return
        for frequency in sorted({c[0] for c in (*self.upper, *self.lower)}):
            above, below = _inside(self.upper, frequency), _inside(self.lower, frequency)
            if above and below and min(above) < max(below):
                text = f"{where}: lower is above upper at {frequency:g} Hz ({max(below):g} and {min(above):g})"
                raise InputError(text)

    @property
    def corners(self) -> list[float]:
        """Frequencies of all corners [Hz]."""
        return [c[0] for c in (*(self.upper or ()), *(self.lower or ()))]

    def find(self, results: Sequence[Result]) -> Compliance:
        result = [
            self._side(curve, name, corners)
            for curve in self.responses(results[0], self.corners)
            for name, corners in (("max", self.upper), ("min", self.lower))
            if corners
        ]
        return worst(result)

    def _side(self, curve: Curve, name: str, corners: list[list[float]]) -> Compliance:
        """Compare a curve with one mask; the place with the least margin counts."""
        curve.check_failed(corners[0][0], corners[-1][0])
        unit = UNITS.get(self.quantity, curve.unit)
        places = sorted(_places(corners, self._frequencies(curve, name, corners)))
        where = curve.where_phase if self.quantity == "phase" else curve.where
        values = [curve.at(self.quantity, f) for f, _ in places] if curve.exact is None else self._exact(curve, places)
        pairs = zip(values, places, strict=True)
        return worst([judge(v, {name: limit}, unit=unit, where=where(f)) for v, (f, limit) in pairs])

    def _exact(self, curve: Curve, places: Sequence[tuple[float, float]]) -> list[float]:
        """Return the values of a linear model at all places."""
        for frequency, _ in places:
            if not curve.reaches(frequency):
                curve.at(self.quantity, frequency)  # tells
        result: list[float] = curve.evaluated(self.quantity, np.array([f for f, _ in places])).tolist()
        return result

    def _frequencies(self, curve: Curve, name: str, corners: list[list[float]]) -> list[float]:
        """Return where a curve is compared with a mask, besides the corners of that [Hz]."""
        result: list[float] = []
        for (f0, v0), (f1, v1) in pairwise(corners):
            x, y = [math.log(f0), math.log(f1)], [v0, v1]

            def level(f: Floats, x: list[float] = x, y: list[float] = y) -> Floats:
                return np.asarray(np.interp(np.log(f), x, y))

            result += [f1, *curve.finest(self.quantity, (f0, f1), 1.0 if name == "min" else -1.0, level)]
        return result


def _check_corners(where: str, corners: list[list[float]] | None) -> None:
    for corner in corners or ():
        if not corner[0] > 0.0:
            raise InputError(f"{where}: {corner[0]:g} Hz is not a frequency; corners are [frequency, value]")
    for before, after in zip(corners or (), (corners or ())[1:], strict=False):
        if after[0] < before[0]:
            raise InputError(f"{where}: frequencies must rise; {after[0]:g} Hz comes after {before[0]:g} Hz")


def _places(corners: list[list[float]], frequencies: Sequence[float]) -> list[tuple[float, float]]:
    """Return (frequency, limit) wherever mask or response have a corner; both limits where the mask steps."""
    low, high = corners[0][0], corners[-1][0]
    result = [(c[0], c[1]) for c in corners]
    for frequency in frequencies:
        if low < frequency < high:
            result += [(frequency, limit) for limit in _inside(corners, frequency)]
    return result


def _inside(corners: list[list[float]], frequency: float) -> list[float]:
    """Return the limits of a mask at a frequency; none outside, two at a step."""
    exact = [c[1] for c in corners if math.isclose(c[0], frequency, rel_tol=_SAME)]
    if exact:
        return exact
    for (f0, v0), (f1, v1) in pairwise(corners):
        if f0 < frequency < f1:
            return [interpolate(frequency, (f0, f1), (v0, v1))]
    return []

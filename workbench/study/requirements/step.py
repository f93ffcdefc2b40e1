"""Requirements on time histories: settling, overshoot, rise, peak and final value."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated, ClassVar, NamedTuple

from pydantic import Field

from workbench.errors import InputError, suggest
from workbench.study.requirements.base import Limited, NotMeasured, Result, Value
from workbench.study.requirements.value import STEP_ERROR, STEP_REMEDY

__all__ = ["FinalValue", "Overshoot", "PeakRequirement", "RiseTime", "SettlingTime"]

_ROWS = "which lies between the rows: record more rows, by a smaller step"
_TOLD = 5e-6  # of a number that is shown with five digits: a smaller error is not seen
_REST = 0.1  # the last tenth of the record tells whether the signal rests

_Fraction = Annotated[float, Field(gt=0.0, lt=1.0)]


class _History(NamedTuple):
    """Times [s] after the step, values, unit, how far the signal is from the straight line behind each row, and off it.

    `step` is how far off each value may be by the communication step; empty: it is not known.
    """

    time: Sequence[float]
    values: Sequence[float]
    unit: str | None
    behind: Sequence[float]
    step: Sequence[float] = ()

    @property
    def off(self) -> Sequence[float]:
        """How far off each value may be."""
        return self.step or [0.0] * len(self.time)

    @property
    def bend(self) -> list[float]:
        """How far the signal may be from the straight lines on both sides of each row."""
        both = zip([0.0, *self.behind[:-1]], self.behind, self.off, strict=True)
        return [max(before, behind) + off for before, behind, off in both]


class _OfHistory(Limited):
    """A number of a signal of `workbench simulate`.

    Between two rows the signal is a parabola, as far as is known, or what the record says; at the rows twice of what
    half the communication step changes is the error (of a method of first order). What both add to the number is its
    error, and a limit within it is neither kept nor violated.

    Attributes:
        output: the signal; None: the only one recorded that is not an input.
        after: when the step happens [s]; what comes before does not count.
    """

    commands: ClassVar[tuple[str, ...]] = ("simulate",)
    between_rows: ClassVar[bool] = True

    output: str | None = None
    after: float = 0.0

    def signal(self, result: Result) -> str:
        """Return the name of the signal.

        Raises:
            InputError: it was not recorded.
        """
        signals = result["signals"]
        name = self.output or self._only(result)
        if name not in signals:
            raise InputError(f"{self.name}: output '{name}' was not recorded; {suggest(name, signals)}")
        return name

    def _only(self, result: Result) -> str:
        """Return the only signal that is not an input."""
        forced = result.get("asked", {}).get("inputs", [])
        inputs = {text.partition("=")[0] for text in ([forced] if isinstance(forced, str) else forced)}
        outputs = [name for name in result["signals"] if name not in inputs] or list(result["signals"])
        if len(outputs) > 1:
            listed = f"{', '.join(outputs[:-1])} and {outputs[-1]}"
            raise InputError(
                f'{self.name}: the record has {len(outputs)} outputs, {listed}; name one, as in output = "{outputs[0]}"'
            )
        return str(outputs[0])

    def history(self, result: Result) -> _History:
        """Return the signal from `after` on.

        Raises:
            InputError: no such signal.
            NotMeasured: the record ends before.
        """
        name, signals = self.signal(result), result["signals"]
        begin = _index(result["time"], self.after)
        kept = [k for k in range(begin, len(result["time"])) if signals[name][k] is not None]
        if len(kept) < 3:
            raise NotMeasured(
                f"the record ends at {result['time'][-1]:g} s, before the signal changes after {self.after:g} s"
            )
        time, values = [result["time"][k] for k in kept], [signals[name][k] for k in kept]
        behind = _bent(time, values)
        told = result.get("between_rows", {}).get(name)
        if told is not None:
            behind = [max(b, told[k]) for b, k in zip(behind, kept, strict=True)]
        changes = result.get("step_change", {}).get(name)
        step = [] if changes is None else [STEP_ERROR * (changes[k] or 0.0) for k in kept]
        return _History(time, values, result["units"].get(name), behind, step)

    @abstractmethod
    def number(self, history: _History, side: float) -> tuple[float, str]:
        """Return the number and where it is.

        Args:
            history: of the signal.
            side: 0: as the rows have it; ±1: as large or small as it may be with what lies between them.

        Raises:
            NotMeasured: the signal does not have it.
        """

    def values(self, result: Result) -> list[Value]:
        history = self.history(result)
        number, where = self.number(history, 0.0)
        error = self._error(history, number)
        of_rows = self._error(history._replace(step=()), number) if any(history.step) else error
        cause = "between the rows" if of_rows >= 0.5 * error else "by the communication step"
        words = f"± {error:.2g} {cause}" if error > _TOLD * abs(number) else ""
        unit = self.units[0] if self.units else history.unit
        place, remedy = ", ".join(filter(None, [where, words])), _ROWS if of_rows >= 0.5 * error else STEP_REMEDY
        return [Value(value=number, where=place, unit=unit, error=error, remedy=remedy)]

    def _error(self, history: _History, number: float) -> float:
        try:
            return max(abs(self.number(history, side)[0] - number) for side in (1.0, -1.0))
        except NotMeasured:
            return math.inf


def _bent(time: Sequence[float], values: Sequence[float]) -> list[float]:
    """Return how far a parabola through three rows is from the straight line behind each row; not across events."""
    curvature = [0.0] * len(time)
    for k in range(1, len(time) - 1):
        before, behind = time[k] - time[k - 1], time[k + 1] - time[k]
        if before > 0.0 and behind > 0.0:
            slopes = (values[k] - values[k - 1]) / before, (values[k + 1] - values[k]) / behind
            curvature[k] = abs(slopes[1] - slopes[0]) / (0.5 * (before + behind))
    return [
        max(a, b) * (t1 - t0) ** 2 / 8.0 for (a, b), (t0, t1) in zip(pairwise(curvature), pairwise(time), strict=True)
    ] + [0.0]


def _index(time: Sequence[float], after: float) -> int:
    """Return where a record begins: at `after`, before its jump, else at the last sample before."""
    slack = 1e-9 * max(abs(after), 1e-6)
    k = next((k for k, t in enumerate(time) if t >= after - slack), len(time))
    return max(k - 1, 0) if k == len(time) or time[k] > after + slack else k


class _OfStep(_OfHistory):
    """A number of a step response.

    Attributes:
        final: the value it tends to; None: the last one, which must be at rest.
        band: half width within which it is at rest, as a fraction of the step.
    """

    final: float | None = None
    band: _Fraction = 0.02

    def ends(self, history: _History) -> tuple[float, float]:
        """Return where the step begins and ends.

        Raises:
            NotMeasured: it does not move, or is not at rest at the end.
        """
        begin, last = history.values[0], history.values[-1]
        final = last if self.final is None else self.final
        if final == begin:
            raise NotMeasured("the signal does not move")
        if self.final is None:
            rest = history.time[-1] - _REST * (history.time[-1] - history.time[0])
            rows = zip(history.time, history.values, history.bend, strict=True)
            tail = [abs(v - last) + bend for t, v, bend in rows if t >= rest]
            if max(tail) > self.band * abs(final - begin):
                raise NotMeasured("the signal is not at rest at the end; simulate longer, or give the final value")
        return begin, final


class SettlingTime(_OfStep):
    """Time after which the signal stays within a band around its final value [s]."""

    units = ("s",)

    def number(self, history: _History, side: float) -> tuple[float, str]:
        begin, final = self.ends(history)
        width = self.band * abs(final - begin)
        errors = [abs(v - final) + side * e for v, e in zip(history.values, history.bend, strict=True)]
        outside = [k for k, e in enumerate(errors) if e > width]
        if not outside:
            return 0.0, ""
        k = outside[-1]
        if k + 1 == len(errors):
            raise NotMeasured(f"the signal does not stay within {100.0 * self.band:g} % until {history.time[-1]:g} s")
        part = (errors[k] - width) / (errors[k] - errors[k + 1])
        time = history.time[k] + part * (history.time[k + 1] - history.time[k])
        return time - max(self.after, history.time[0]), f"t = {time:.4g} s"


class Overshoot(_OfStep):
    """How far the signal goes beyond its final value [% of the step]."""

    units = ("%",)

    def number(self, history: _History, side: float) -> tuple[float, str]:
        begin, final = self.ends(history)
        up = math.copysign(1.0, final - begin)
        beyond = [
            (up * (v - final) + max(side, 0.0) * more + side * off) / abs(final - begin)
            for v, more, off in zip(
                history.values, _above([up * v for v in history.values], history.behind), history.off, strict=True
            )
        ]
        k = max(range(len(beyond)), key=beyond.__getitem__)
        return 100.0 * max(beyond[k], 0.0), f"t = {history.time[k]:.4g} s" if beyond[k] > 0.0 else ""


class RiseTime(_OfStep):
    """Time from 10 to 90 % of the step [s]."""

    units = ("s",)

    def number(self, history: _History, side: float) -> tuple[float, str]:
        begin, final = self.ends(history)
        size = final - begin
        low, high = (
            _first(
                history.time,
                [
                    (v - begin) / size + way * side * e / abs(size)
                    for v, e in zip(history.values, history.bend, strict=True)
                ],
                level,
            )
            for level, way in ((0.1, 1.0), (0.9, -1.0))
        )
        return high - low, f"t = {low:.4g} to {high:.4g} s"


def _first(time: Sequence[float], parts: Sequence[float], level: float) -> float:
    for k, part in enumerate(parts):
        if part >= level:
            before = parts[k - 1] if k else part
            share = (level - before) / (part - before) if part > before else 0.0
            return time[max(k - 1, 0)] + share * (time[k] - time[max(k - 1, 0)])
    raise NotMeasured(f"the signal does not reach {100.0 * level:g} % of its step")


class PeakRequirement(_OfHistory):
    """Largest absolute value of the signal."""

    def number(self, history: _History, side: float) -> tuple[float, str]:
        sizes = [
            max(v + max(side, 0.0) * up, -v + max(side, 0.0) * down) + side * off
            for v, up, down, off in zip(
                history.values, _above(history.values, history.behind),
                _above([-v for v in history.values], history.behind), history.off, strict=True,
            )
        ]  # fmt: skip
        k = max(range(len(sizes)), key=sizes.__getitem__)
        return sizes[k], f"t = {history.time[k]:.4g} s"


def _above(values: Sequence[float], bent: Sequence[float]) -> list[float]:
    """Return by how much the largest value around each row is above it: that of a parabola through two neighbours.

    Args:
        values: of the signal.
        bent: how far it is from the straight line behind each, in the middle.
    """
    result = [0.0] * len(values)
    for k, ((v, w), d) in enumerate(zip(pairwise(values), bent, strict=False)):
        if 4.0 * d > abs(w - v):
            top = max(v, w) + (4.0 * d - abs(w - v)) ** 2 / (16.0 * d)
            result[k], result[k + 1] = max(result[k], top - v), max(result[k + 1], top - w)
    return result


class FinalValue(_OfHistory):
    """Last value of the signal."""

    between_rows: ClassVar[bool] = False

    def number(self, history: _History, side: float) -> tuple[float, str]:
        if not math.isfinite(history.values[-1]):
            raise NotMeasured("the signal ends without a number")
        return history.values[-1] + side * history.off[-1], f"t = {history.time[-1]:.4g} s"

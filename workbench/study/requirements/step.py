"""Requirements on time histories: settling, overshoot, rise, peak and final value."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, ClassVar, NamedTuple

from pydantic import Field

from workbench.errors import InputError, suggest
from workbench.study.requirements.base import Limited, NotMeasured, Result, Value

__all__ = ["FinalValue", "Overshoot", "PeakRequirement", "RiseTime", "SettlingTime"]

_REST = 0.1  # the last tenth of the record tells whether the signal rests

_Fraction = Annotated[float, Field(gt=0.0, lt=1.0)]


class _History(NamedTuple):
    """Times [s] after the step, values, and their unit."""

    time: Sequence[float]
    values: Sequence[float]
    unit: str | None


class _OfHistory(Limited):
    """A number of a signal of `workbench simulate`.

    Attributes:
        output: the signal; None: the only one recorded that is not an input.
        after: when the step happens [s]; what comes before does not count.
    """

    commands: ClassVar[tuple[str, ...]] = ("simulate",)

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
        return outputs[0]

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
        time = [result["time"][k] for k in kept]
        return _History(time, [signals[name][k] for k in kept], result["units"].get(name))


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
            tail = [v for t, v in zip(history.time, history.values, strict=True) if t >= rest]
            if max(abs(v - last) for v in tail) > self.band * abs(final - begin):
                raise NotMeasured("the signal is not at rest at the end; simulate longer, or give the final value")
        return begin, final


class SettlingTime(_OfStep):
    """Time after which the signal stays within a band around its final value [s]."""

    units = ("s",)

    def values(self, result: Result) -> list[Value]:
        history = self.history(result)
        begin, final = self.ends(history)
        width = self.band * abs(final - begin)
        errors = [abs(v - final) for v in history.values]
        outside = [k for k, e in enumerate(errors) if e > width]
        if not outside:
            return [Value(value=0.0, unit="s")]
        k = outside[-1]
        if k + 1 == len(errors):
            raise NotMeasured(f"the signal does not stay within {100.0 * self.band:g} % until {history.time[-1]:g} s")
        part = (errors[k] - width) / (errors[k] - errors[k + 1])
        time = history.time[k] + part * (history.time[k + 1] - history.time[k])
        return [Value(value=time - max(self.after, history.time[0]), where=f"t = {time:.4g} s", unit="s")]


class Overshoot(_OfStep):
    """How far the signal goes beyond its final value [% of the step]."""

    units = ("%",)

    def values(self, result: Result) -> list[Value]:
        history = self.history(result)
        begin, final = self.ends(history)
        beyond = [(v - final) / (final - begin) for v in history.values]
        k = max(range(len(beyond)), key=beyond.__getitem__)
        where = f"t = {history.time[k]:.4g} s" if beyond[k] > 0.0 else ""
        return [Value(value=100.0 * max(beyond[k], 0.0), where=where, unit="%")]


class RiseTime(_OfStep):
    """Time from 10 to 90 % of the step [s]."""

    units = ("s",)

    def values(self, result: Result) -> list[Value]:
        history = self.history(result)
        begin, final = self.ends(history)
        parts = [(v - begin) / (final - begin) for v in history.values]
        low, high = (_first(history.time, parts, level) for level in (0.1, 0.9))
        return [Value(value=high - low, where=f"t = {low:.4g} to {high:.4g} s", unit="s")]


def _first(time: Sequence[float], parts: Sequence[float], level: float) -> float:
    for k, part in enumerate(parts):
        if part >= level:
            before = parts[k - 1] if k else part
            share = (level - before) / (part - before) if part > before else 0.0
            return time[max(k - 1, 0)] + share * (time[k] - time[max(k - 1, 0)])
    raise NotMeasured(f"the signal does not reach {100.0 * level:g} % of its step")


class PeakRequirement(_OfHistory):
    """Largest absolute value of the signal."""

    def values(self, result: Result) -> list[Value]:
        history = self.history(result)
        k = max(range(len(history.values)), key=lambda i: abs(history.values[i]))
        return [Value(value=abs(history.values[k]), where=f"t = {history.time[k]:.4g} s", unit=history.unit)]


class FinalValue(_OfHistory):
    """Last value of the signal."""

    def values(self, result: Result) -> list[Value]:
        history = self.history(result)
        if not math.isfinite(history.values[-1]):
            raise NotMeasured("the signal ends without a number")
        return [Value(value=history.values[-1], where=f"t = {history.time[-1]:.4g} s", unit=history.unit)]

"""Requirements on limit cycles and on the gains that remove them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Literal

from pydantic import Field

from workbench.errors import InputError, suggest
from workbench.study.requirements.base import Compliance, Limited, NotMeasured, Requirement, Result, Value

__all__ = ["LimitCycleAmplitude", "LimitCycleFrequency", "StableGains"]

_Method = Literal["describing function", "harmonic balance", "shooting", "simulation"]


class _OfCycles(Limited):
    """A number of the stable limit cycles of `workbench limit-cycle`.

    Attributes:
        method: whose answer counts.
        unstable: whether unstable limit cycles count, too.
    """

    commands: ClassVar[tuple[str, ...]] = ("limit-cycle",)

    method: _Method = "simulation"
    unstable: bool = False

    def cycles(self, result: Result) -> list[Result]:
        """Return the cycles that count.

        Raises:
            NotMeasured: a cycle is predicted, but the method did not find it.
        """
        every = [c for c in result["limit_cycles"] if self.unstable or c["stable"] is not False]
        cycles = [c for c in every if c["method"] == self.method]
        if every and not cycles:
            raise NotMeasured(f"a limit cycle is predicted, but not by {self.method}")
        return cycles


def _none(result: Result) -> str:
    """Return why no limit cycle counts.

    Raises:
        NotMeasured: none is predicted, but a free run does not come to rest.
    """
    ends = {run["outcome"] for run in result.get("observed", [])}
    if ends - {"rest"}:
        raise NotMeasured("describing functions predict no limit cycle, but a free run does not come to rest")
    return "none predicted, a free run comes to rest" if ends else "no limit cycle predicted"


class LimitCycleAmplitude(_OfCycles):
    """Amplitude of the largest limit cycle, at the block's input or of a signal; 0 where there is none.

    Attributes:
        signal: one that the analysis measured with `output`, which the simulations do; None: the block's input.
    """

    signal: str | None = None

    def check(self, where: str, commands: Sequence[str]) -> None:
        super().check(where, commands)
        if self.signal is not None and self.method != "simulation":
            raise InputError(f"{where}: a signal is measured in a simulation, not by {self.method}; leave method out")

    def values(self, result: Result) -> list[Value]:
        cycles = self.cycles(result)
        if not cycles:
            return [Value(value=0.0, where=_none(result))]
        if self.signal is not None:
            return [self._of_signal(result, cycle, self.signal) for cycle in cycles]
        unit = (result.get("simulated") or {}).get("units", {}).get(result["block_input"])
        return [
            Value(value=c["amplitude"], where=f"{c['frequency_hz']:.4g} Hz, {c['method']}", unit=unit) for c in cycles
        ]

    def _of_signal(self, result: Result, cycle: Result, signal: str) -> Value:
        measured, where = cycle["amplitudes"], f"{cycle['frequency_hz']:.4g} Hz, simulation"
        if signal not in measured:
            raise InputError(f"{self.name}: signal '{signal}' was not measured; {suggest(signal, measured)}")
        unit = (result["simulated"] or {}).get("units", {}).get(signal)
        return Value(value=measured[signal], where=where, unit=unit)


class LimitCycleFrequency(_OfCycles):
    """Frequency of the limit cycles [Hz]."""

    units = ("Hz",)

    def values(self, result: Result) -> list[Value]:
        cycles = self.cycles(result)
        if not cycles:
            raise NotMeasured("there is no limit cycle")
        return [Value(value=c["frequency_hz"], where=str(c["method"]), unit="Hz") for c in cycles]


class StableGains(Requirement):
    """Gains that must lie inside one interval in which the closed loop is stable.

    Attributes:
        contains: the gains, or the ends of an interval of gains.
        reserve: how far from the ends of the stable interval they must stay.
    """

    commands: ClassVar[tuple[str, ...]] = ("feedback",)

    contains: list[float] = Field(min_length=1)
    reserve: float = Field(default=0.0, ge=0.0)

    def find(self, results: Sequence[Result]) -> Compliance:
        low, high = min(self.contains), max(self.contains)
        intervals = [_open(interval) for interval in results[0]["stable_gains"]]
        if not intervals:
            raise NotMeasured("no gain stabilises the loop")
        reserve, nearest = max((min(low - a, b - high), (a, b)) for a, b in intervals)
        end = nearest[0] if low - nearest[0] <= nearest[1] - high else nearest[1]
        return Compliance(
            value=reserve,
            limit={"min": self.reserve},
            margin=reserve - self.reserve,
            passed=reserve >= self.reserve and reserve > 0.0,
            where=f"distance to {end:.5g}; stable from {nearest[0]:.5g} to {nearest[1]:.5g}",
        )


def _open(interval: Sequence[float | None]) -> tuple[float, float]:
    """Return an interval; JSON has null where it has no end."""
    low, high = interval
    return (float("-inf") if low is None else low), (float("inf") if high is None else high)

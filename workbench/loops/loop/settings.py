"""What is to be measured of a loop, and how long to wait for it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from workbench.core.values.linear import LinearPart
from workbench.response.nfr.point import PointTask

__all__ = ["LoopSettings"]


@dataclass(frozen=True, kw_only=True)
class LoopSettings:
    """Settings of every point.

    Attributes:
        errcrit: error criterion of `nfr`.
        max_periods: most periods at a point.
        value: of the signal at the operating point [unit of the source].
        loop: linear L, for the first guess of injected amplitudes; None: not known.
    """

    errcrit: float = 0.1
    max_periods: int = 20
    value: float = 0.0
    loop: LinearPart | None = None

    def task(self, input: str, output: str, frequency: float, amplitude: float) -> PointTask:
        """Return the task of one point."""
        return PointTask(
            input=input,
            output=output,
            frequency=frequency,
            amplitude=amplitude,
            errcrit=self.errcrit,
            max_periods=self.max_periods,
        )

    def guess(self, frequency: float) -> float:
        """Return |1 + L|: the injected amplitude that passes an amplitude of 1 on, were the loop linear."""
        found = 1.0 if self.loop is None else abs(1.0 + self.loop.at(frequency))
        # At a pole or zero of 1 + L the guess is anything; the search begins nearby.
        return min(max(found, 1e-3), 1e3) if math.isfinite(found) else 1.0

"""What the input does to the output, told apart from what the model does by itself."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.response.nfr.settling import PointResponse, Settling, SettlingOutcome
from workbench.response.periodic.fourier import Period, distortion, fundamental

__all__ = ["OWN", "Apart"]

# A response that differs from the linear model's, or has harmonics, by a part δ of itself may take up so many times δ
# of the model's own motion. With u³ beside u both are 3/4 δ at most; harmonics behind a low pass are smaller.
_MIXED, _FILTERED = 3.0, 30.0

# Own motion that wanders so many times more than the output under the forcing is not part of that output any more.
_GONE = 10.0

OWN = (
    "the model moves by itself, and how much of that the input changes is not known better: its error says how much it "
    "may be (a larger amplitude makes it smaller)"
)


@dataclass
class Apart(Settling):
    """Decide as `Settling` does, by what is left of the output without the model's own motion.

    The model is run a second time, from the same start, with the input at rest. What it does then (ripples, gusts,
    pulses, a drift) is subtracted, period by period. Where forced and own motion add up, as in a linear model, the
    difference is what the input does from rest, to rounding, also at the very frequency of the forcing. Where they do
    not, what remains is of the order of the own motion times what the response deviates from a linear one: three times
    the distance from the linear model's response and the harmonics together, at most all of it; without a linear
    model thirty times the harmonics. That is added to the error.

    Own motion that the forcing takes over (an oscillator that locks) does not add up: the output then settles, its
    difference does not, and the output itself is taken.

    Attributes:
        own: returns the period of the same number with the input at rest.
    """

    own: Callable[[int], Period] = field(kw_only=True)
    _alone: list[Period] = field(default_factory=list, init=False)
    _whole: list[Period] = field(default_factory=list, init=False)
    _answer: PointResponse | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        """Judge the whole output beside, without what only holds for the difference."""
        self._beside = Settling(self.errcrit, self.most, replace(self.evidence, twin=None))

    def add(self, period: Period) -> PointResponse | None:
        """Take one more period of the whole output; return the response once it is known, else None."""
        own = self.own(len(self.periods))
        self._alone.append(own)
        self._whole.append(period)
        if self._answer is None:
            self._answer = self._beside.add(period)
        size = max(period.size, own.size)
        result = super().add(
            Period(period.harmonics - own.harmonics, period.drive, size, period.rough + own.rough, period.steps)
        )
        return None if result is None else self._final(result)

    def _final(self, result: PointResponse) -> PointResponse:
        whole = self._answer if self._answer is not None and _settled(self._answer) else None
        if whole is not None and not _settled(result) and self._is_gone():
            return whole
        offset = result.offset + float(self._newest(self._alone)[:, 0].mean()) if whole is None else whole.offset
        result = replace(result, offset=offset, error=result.error + self._mixed(result))
        if _settled(result) and result.error > self.errcrit / 10.0:
            return replace(result, outcome=SettlingOutcome.AVERAGED, why=OWN)
        return result

    def _mixed(self, result: PointResponse) -> float:
        """Return what forced and own motion may do to each other, relative to the response."""
        size = abs(fundamental(result.harmonics))
        if size == 0.0:
            return 0.0
        own = self._newest(self._alone)
        moves = float(np.linalg.norm(own[:, 1:], axis=1).max()) + float(np.ptp(own[:, 0]))
        bent = math.hypot(*(h or 0.0 for h in distortion(result.harmonics)))
        twin = self.evidence.twin
        if twin is None:
            return min(1.0, _FILTERED * bent) * moves / size
        away = abs(result.value - twin.forced.response) / abs(result.value)
        return min(1.0, _MIXED * (away + bent)) * moves / size

    def _is_gone(self) -> bool:
        """Whether the output repeats while the model's own motion does not: the forcing has taken it over."""
        return _scatter(self._newest(self._alone)) > _GONE * _scatter(self._newest(self._whole))

    def _newest(self, periods: Sequence[Period]) -> Floats:
        return np.array([p.harmonics for p in periods[len(periods) // 2 :]])


def _settled(result: PointResponse) -> bool:
    return result.outcome in (SettlingOutcome.RESOLVED, SettlingOutcome.SETTLED)


def _scatter(harmonics: Floats) -> float:
    return float(np.linalg.norm((harmonics - harmonics.mean(axis=0))[:, 1:]))

"""The probability that a requirement is met, with an interval, and how many more samples a narrower one takes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from scipy.special import ndtri

from workbench.core.records.record import RecordPart

__all__ = ["Probability", "probability", "samples_for", "together", "wilson"]

_MOST = 1 << 40  # samples that nobody takes


@dataclass(frozen=True, kw_only=True)
class Probability(RecordPart):
    """How probable it is that a requirement is met.

    Attributes:
        failure: under which; None: the envelope has none; "all": weighted by their probabilities.
        samples: number of points.
        met: at how many of them.
        unknown: at how many nothing was measured; the interval holds whatever came out there.
        estimate: met/(samples − unknown), or the weighted sum of these; None: nothing is known.
        low, high: ends of the interval.
        confidence: of the interval.
        more: number of samples more that narrow the interval to the wanted width if the estimate stays; None: no
            width was asked for, or it cannot be reached, as more samples do not help where points fail.
    """

    failure: str | None
    samples: int
    met: int
    unknown: int
    estimate: float | None
    low: float
    high: float
    confidence: float
    more: int | None = None

    def derived(self) -> dict[str, Any]:
        """Return the width of the interval."""
        return {"width": self.high - self.low}


def wilson(met: float, samples: int, confidence: float) -> tuple[float, float]:
    """Return the Wilson score interval of a probability.

    With z the two-sided normal quantile and p = met/samples, (p + z²/2n ± z √(p(1−p)/n + z²/4n²)) / (1 + z²/n). It is
    for independent samples. On average over p it covers with the confidence; at single p, above all near 0 and 1, the
    discrete count makes it cover more or less.

    Args:
        met: how many of the samples, 0 … samples.
        samples: number of them; 0: the interval is 0 … 1.
        confidence: in 0 … 1, such as 0.95.

    Source: E. B. Wilson, Probable inference, the law of succession, and statistical inference, J. American Statistical
    Association 22 (1927) 209-212; L. D. Brown, T. T. Cai, A. DasGupta, Interval estimation for a binomial proportion,
    Statistical Science 16 (2001) 101-133, section 3.1.1.
    """
    if samples == 0:
        return 0.0, 1.0
    z = float(ndtri(0.5 + confidence / 2.0))
    p, q = met / samples, z * z / samples
    centre = (p + q / 2.0) / (1.0 + q)
    half = math.sqrt(q * p * (1.0 - p) + q * q / 4.0) / (1.0 + q)
    low = 0.0 if met <= 0 else max(0.0, centre - half)
    high = 1.0 if met >= samples else min(1.0, centre + half)
    return low, high


def samples_for(estimate: float, width: float, confidence: float) -> int:
    """Return the smallest number of samples whose Wilson interval is no wider, if the estimate stays as it is.

    Args:
        estimate: of the probability.
        width: wanted, above 0 and at most 1.
        confidence: of the interval.
    """

    def wide(n: int) -> bool:
        low, high = wilson(estimate * n, n, confidence)
        return high - low > width

    high = 1
    while wide(high) and high < _MOST:
        high *= 2
    low = high // 2
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if wide(middle) else (low, middle)
    return high


def probability(
    failure: str | None, passed: Sequence[bool | None], *, confidence: float, width: float | None
) -> Probability:
    """Return the probability that a requirement is met.

    Args:
        failure: under which.
        passed: of each sample whether it is; None: nothing was measured.
        confidence: of the interval.
        width: wanted width of the interval; None: none.
    """
    n, met, unknown = len(passed), sum(p is True for p in passed), sum(p is None for p in passed)
    low, high = wilson(met, n, confidence)[0], wilson(met + unknown, n, confidence)[1]
    estimate = met / (n - unknown) if n > unknown else None
    more = None
    if width is not None and not unknown and estimate is not None:
        more = max(0, samples_for(estimate, width, confidence) - n)
    return Probability(
        failure=failure, samples=n, met=met, unknown=unknown, estimate=estimate, low=low, high=high,
        confidence=confidence, more=more,
    )  # fmt: skip


def together(passed: Sequence[Sequence[bool | None]], weights: Sequence[float], *, confidence: float) -> Probability:
    """Return the probability over all failures, each with a probability of its own.

    The interval adds up the failures' intervals, each with the confidence 1 − (1 − confidence)/F for F failures, so
    that all hold at once with the confidence asked for (Bonferroni), whatever the samples have in common: it is wider
    than it needs to be.

    Args:
        passed: of each failure, of each of its samples whether the requirement is met; None: nothing was measured.
        weights: probabilities of the failures, of sum 1.
        confidence: of the interval.
    """
    each = 1.0 - (1.0 - confidence) / len(passed)
    parts = [probability(None, p, confidence=each, width=None) for p in passed]
    known = [p.estimate for p in parts if p.estimate is not None]
    return Probability(
        failure="all",
        samples=sum(p.samples for p in parts),
        met=sum(p.met for p in parts),
        unknown=sum(p.unknown for p in parts),
        estimate=math.fsum(w * e for w, e in zip(weights, known, strict=True)) if len(known) == len(parts) else None,
        low=math.fsum(w * p.low for w, p in zip(weights, parts, strict=True)),
        high=min(1.0, math.fsum(w * p.high for w, p in zip(weights, parts, strict=True))),
        confidence=confidence,
    )

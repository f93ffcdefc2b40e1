"""Do residuals still depend on the input? Their cross-correlation with its 95 % band."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.special import chdtrc, ndtr, ndtri

from workbench.core.records.record import RecordPart, entry, numbers
from workbench.core.values.arrays import Floats
from workbench.identification.validate.whiteness import LEVEL, covariances

__all__ = ["CrossCorrelation", "cross_correlation"]


@dataclass(frozen=True, eq=False, kw_only=True)
class CrossCorrelation(RecordPart):
    """Correlation of residual e(t) with input u(t − lag), and what it says.

    Attributes:
        lags: shape (2 L + 1,), −L … L [samples]; positive: the input came first.
        values: shape (2 L + 1, p, m), correlation coefficients.
        band: shape (p, m), ± this holds each lag with 95 % probability if e and u are independent.
        band_all: shape (p, m), ± this holds all lags of one sign, all inputs and outputs together, with 97.5 %
            probability or more: a single lag outside it is a finding.
        p_negative: probability that independent e and u are as correlated at negative lags, or more.
        p_positive: likewise at lags ≥ 0.
    """

    lags: Floats
    values: Floats = field(metadata=entry(kept=False, dims=("lags", "output", "input")))
    band: Floats = field(metadata=entry(dims=("output", "input")))
    band_all: Floats = field(metadata=entry(dims=("output", "input")))
    p_negative: float
    p_positive: float

    def derived(self) -> dict[str, Any]:
        """Return the values as [output][input][lag], and the verdicts."""
        verdicts = {name: getattr(self, name) for name in ("outside", "undermodelled", "feedback", "inside")}
        return {"values": self.values.transpose(1, 2, 0), **verdicts}

    @classmethod
    def restored(cls, data: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the values as [lag][output][input]."""
        return {**data, "values": numbers(data, "values").transpose(2, 0, 1)}

    @property
    def outside(self) -> tuple[int, int]:
        """How many values lie outside `band`: negative lags, others."""
        out, past = np.abs(self.values) > self.band, self.lags >= 0.0
        return int(np.sum(out[~past])), int(np.sum(out[past]))

    @property
    def undermodelled(self) -> bool:
        """The input is seen in later residuals: the model misses dynamics. False alarm in 5 % of cases or less."""
        return self.p_positive < LEVEL

    @property
    def feedback(self) -> bool:
        """Residuals are seen in later inputs. False alarm in 5 % of cases or less."""
        return self.p_negative < LEVEL

    @property
    def inside(self) -> bool:
        """No sign of missed dynamics nor of feedback."""
        return not (self.undermodelled or self.feedback)

    @property
    def words(self) -> tuple[str, str]:
        """The verdicts in a line each: missed dynamics, feedback."""
        before, after = self.outside
        past = int(np.sum(self.lags >= 0.0)) * self.band.size
        rest = self.values.size - past
        first = "the input is still visible in the residuals: order too low or not linear"
        second = "residuals are visible in later inputs: feedback, or not causal"
        return (
            _verdict(
                first if self.undermodelled else "no trace of the input in the residuals",
                self.p_positive,
                after,
                past,
                "≥",
            ),
            _verdict(second if self.feedback else "no sign of feedback", self.p_negative, before, rest, "<"),
        )


def cross_correlation(residual: Floats, u: Floats, lags: int) -> CrossCorrelation:
    """Return the cross-correlation of residuals and inputs with its bands and verdicts.

    If e and u are independent, √N times their covariance at lag τ is normal with variance c(0), and with covariance
    c(τ − σ) between two lags, c(δ) = Σₖ R_e(k) R_u(k + δ) (Ljung 1999, section 16.6, equation 16.60 ff.); e need not
    be white. The sum runs over all lags of the record, by way of the periodograms; so it needs no window, and c(0) is
    never negative.

    A verdict rests on two numbers, each given half of the 5 % (Bonferroni): the largest of all coefficients, by Šidák's
    inequality (J. Am. Stat. Assoc. 62, 1967), which sees a single peak, and the sum of the squares of each pair of
    channels, as a χ² with as many degrees of freedom as its mean and variance ask for (Box, Annals of Mathematical
    Statistics 25, 1954), which sees what is small but lasts.

    Not for residuals that are a function of the input without noise: they are never independent of it.

    Args:
        residual: shape (N, p), N > lags.
        u: shape (N, m).
        lags: L [samples].
    """
    e, v = residual - residual.mean(axis=0), u - u.mean(axis=0)
    size = np.outer(np.sqrt(np.mean(e**2, axis=0)), np.sqrt(np.mean(v**2, axis=0)))
    scale = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0.0)
    after, before = covariances(e, v, lags), covariances(v, e, lags)[:0:-1].transpose(0, 2, 1)
    c = _between_lags(e, v, lags) / len(e)
    deviation = np.sqrt(c[0])
    together = ndtri(1.0 - 0.5 * _each((lags + 1) * size.size))
    return CrossCorrelation(
        lags=np.arange(-lags, lags + 1.0),
        values=np.concatenate([before, after]) * scale,
        band=ndtri(1.0 - 0.5 * LEVEL) * deviation * scale,
        band_all=together * deviation * scale,
        p_negative=_probability(before, c),
        p_positive=_probability(after, c),
    )


def _between_lags(e: Floats, u: Floats, lags: int) -> Floats:
    """Return c(δ) for δ = 0 … lags, shape (lags + 1, p, m)."""
    n = len(e)
    power = [np.abs(np.fft.rfft(x, 2 * n, axis=0)) ** 2 / n for x in (e, u)]
    pairs = [[np.fft.irfft(a * b, 2 * n)[: lags + 1] for b in power[1].T] for a in power[0].T]
    return np.moveaxis(np.array(pairs), -1, 0)


def _each(count: int) -> float:
    """Return the rate at which each of `count` numbers may alarm so that all together do at half the level."""
    return float(-np.expm1(np.log1p(-0.5 * LEVEL) / count))


def _probability(values: Floats, c: Floats) -> float:
    """Return the probability of covariances like these or larger, shape (k, p, m), from independent signals."""
    k, p, m = values.shape
    alive = c[0] > 0.0
    if not alive.any():
        return 1.0
    largest = float(np.max(np.abs(values[:, alive]) / np.sqrt(c[0][alive])))
    peak = -np.expm1(k * p * m * np.log1p(-2.0 * ndtr(-largest)))
    weight = (2.0 * (k - np.arange(k))[:, None, None]) * c[:k] ** 2
    mean, variance = k * c[0][alive], (weight.sum(axis=0) - k * c[0] ** 2)[alive]
    energy = np.sum(values[:, alive] ** 2, axis=0)
    lasting = p * m * float(np.min(chdtrc(mean**2 / variance, energy * mean / variance)))
    return float(min(1.0, 2.0 * min(peak, lasting)))


def _verdict(text: str, p_value: float, outside: int, count: int, sign: str) -> str:
    band = f"{outside} of {count} lags {sign} 0 outside the 95 % band ({LEVEL * count:.3g} expected)"
    return f"{text} (p = {p_value:.2g}): {band}"

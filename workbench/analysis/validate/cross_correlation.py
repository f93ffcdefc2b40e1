"""Do residuals still depend on the input? Their cross-correlation with its 95 % band."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from workbench.analysis.validate.whiteness import LEVEL, covariances
from workbench.session.base import Floats

__all__ = ["CrossCorrelation", "cross_correlation"]


@dataclass(frozen=True, eq=False, kw_only=True)
class CrossCorrelation:
    """Correlation of residual e(t) with input u(t − lag), and what it says.

    Attributes:
        lags: shape (2 L + 1,), −L … L [samples]; positive: the input came first.
        values: shape (2 L + 1, p, m), correlation coefficients.
        band: shape (p, m), ± this holds each lag with 95 % probability if e and u are independent.
        band_all: shape (p, m, 2), ± this holds all negative lags together (first) and all others together (second),
            over all outputs and inputs, with 95 % probability or more.
    """

    lags: Floats
    values: Floats
    band: Floats
    band_all: Floats

    @property
    def outside(self) -> tuple[int, int]:
        """How many values lie outside `band`: negative lags, others."""
        out, past = np.abs(self.values) > self.band, self.lags >= 0.0
        return int(np.sum(out[~past])), int(np.sum(out[past]))

    @property
    def undermodelled(self) -> bool:
        """A lag ≥ 0 lies outside `band_all`: the model misses dynamics. False alarm in 5 % of cases or less."""
        return bool(np.any(np.abs(self.values[self.lags >= 0.0]) > self.band_all[..., 1]))

    @property
    def feedback(self) -> bool:
        """A lag < 0 lies outside `band_all`: residuals affect later inputs. False alarm in 5 % of cases or less."""
        return bool(np.any(np.abs(self.values[self.lags < 0.0]) > self.band_all[..., 0]))

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
        first = "the input is still seen in the residuals: order too low or not linear"
        second = "residuals are seen in later inputs: feedback, or not causal"
        return (
            f"{first if self.undermodelled else 'no input left in the residuals'}: {_count(after, past, 'lags ≥ 0')}",
            f"{second if self.feedback else 'no sign of feedback'}: {_count(before, rest, 'lags < 0')}",
        )


def cross_correlation(residual: Floats, u: Floats, lags: int) -> CrossCorrelation:
    """Return the cross-correlation of residuals and inputs with its bands.

    If e and u are independent, √N times their covariance at any lag is normal with variance Σₖ R_e(k) R_u(k)
    (Ljung 1999, section 16.6, equation 16.60 ff.); e need not be white. The sum runs over all lags of the record, by
    way of the periodograms: it is never negative and needs no window. A correlation somewhere among many lags is judged
    by the wider band in which all of them lie together (Šidák's inequality, J. Am. Stat. Assoc. 62, 1967).

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
    values = np.concatenate([before, after]) * scale
    spread = np.sqrt(_sum_of_products(e, v) / len(e)) * scale
    together = [_factor(count * size.size) for count in (lags, lags + 1)]
    return CrossCorrelation(
        lags=np.arange(-lags, lags + 1.0),
        values=values,
        band=_factor(1) * spread,
        band_all=np.stack([f * spread for f in together], axis=-1),
    )


def _count(outside: int, count: int, which: str) -> str:
    return f"{outside} of {count} {which} outside the 95 % band ({LEVEL * count:.3g} expected)"


def _factor(count: int) -> float:
    """Return how many standard deviations hold `count` normal numbers together with 95 %."""
    one = -np.expm1(np.log1p(-LEVEL) / max(count, 1))
    return float(ndtri(1.0 - one / 2.0))


def _sum_of_products(e: Floats, u: Floats) -> Floats:
    """Return Σₖ R_e(k) R_u(k) over all lags, shape (p, m)."""
    n = len(e)
    power = [np.abs(np.fft.rfft(x, 2 * n, axis=0)) ** 2 / n for x in (e, u)]
    weight = np.full(n + 1, 2.0)
    weight[[0, -1]] = 1.0
    sums: Floats = np.einsum("f,fp,fm->pm", weight, *power) / (2 * n)
    return sums

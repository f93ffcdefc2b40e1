"""Are residuals white? Their autocorrelation with its 95 % band, and one test over all lags."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.special import chdtrc, ndtri

from workbench.core.records.record import RecordPart, entry, numbers
from workbench.core.values.arrays import Floats

__all__ = ["LEVEL", "Autocorrelation", "autocorrelation", "covariances"]

LEVEL = 0.05  # false-alarm rate of every test


@dataclass(frozen=True, eq=False, kw_only=True)
class Autocorrelation(RecordPart):
    """Autocorrelation of residuals and what it says.

    Attributes:
        lags: shape (L + 1,), 0 … L [samples].
        values: shape (L + 1, p), of each output's residual, 1 at lag 0.
        band: ± this holds each lag of a white residual with 95 % probability: 1.96/√N.
        outside: shape (p,), how many of the lags 1 … L lie outside the band; 5 % of them are expected there.
        statistic: portmanteau statistic over all lags and outputs.
        degrees: of freedom of the χ² it follows if the residuals are white.
        p_value: probability of a statistic as large or larger from white residuals.
    """

    lags: Floats
    values: Floats = field(metadata=entry(kept=False, dims=("lags", "output")))
    band: float
    outside: tuple[int, ...]
    statistic: float
    degrees: int
    p_value: float

    def derived(self) -> dict[str, Any]:
        """Return the values as [output][lag], and the verdict."""
        return {"values": self.values.T, "white": self.white}

    @classmethod
    def restored(cls, data: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the values as [lag][output]."""
        return {**data, "values": numbers(data, "values").T}

    @property
    def white(self) -> bool:
        """Whether the test passes; it fails for 5 % of the records with truly white residuals."""
        return self.p_value >= LEVEL

    @property
    def words(self) -> str:
        """The verdict in one line."""
        total, count = sum(self.outside), (len(self.lags) - 1) * len(self.outside)
        seen = f"{total} of {count} lags outside the 95 % band ({LEVEL * count:.3g} expected)"
        return f"residuals are {'white' if self.white else 'not white'}: {seen}, p = {self.p_value:.2g}"


def autocorrelation(residual: Floats, lags: int) -> Autocorrelation:
    """Return autocorrelation and whiteness test.

    The band is that of Ljung (1999), section 16.6. The verdict rests on one number over all lags,
    N² Σ tr(CₖᵀC₀⁻¹CₖC₀⁻¹)/(N − k): Ljung and Box's statistic where there is one output (Biometrika 65, 1978), Hosking's
    where there are more (J. Am. Stat. Assoc. 75, 1980). It is χ² with p²·L degrees of freedom. No degrees are taken
    off for fitted parameters; on the data of the fit itself the test therefore alarms in less than 5 % of cases.

    Not for records shorter than about ten times the lags, nor for residuals that are a function of the input without
    noise: they are not random, and "white" says nothing.

    Args:
        residual: shape (N, p), N > lags.
        lags: L [samples].
    """
    e = residual - residual.mean(axis=0)
    n = len(e)
    C = covariances(e, e, lags)
    size = np.sqrt(np.diag(C[0]))
    values = np.einsum("kii->ki", C) / size**2
    normal = C / np.outer(size, size)
    inverse = np.linalg.pinv(normal[0])
    terms = np.einsum("kji,jl,klm,mi->k", normal[1:], inverse, normal[1:], inverse)
    statistic = float(n**2 * np.sum(terms / (n - np.arange(1, lags + 1))))
    degrees = lags * int(np.linalg.matrix_rank(normal[0])) ** 2
    band = float(ndtri(1.0 - LEVEL / 2.0) / np.sqrt(n))
    return Autocorrelation(
        lags=np.arange(lags + 1.0),
        values=values,
        band=band,
        outside=tuple(int(k) for k in np.sum(np.abs(values[1:]) > band, axis=0)),
        statistic=statistic,
        degrees=degrees,
        p_value=float(chdtrc(degrees, statistic)),
    )


def covariances(a: Floats, b: Floats, lags: int) -> Floats:
    """Return C[k] = 1/N Σ a(t) b(t − k)ᵀ for k = 0 … lags, shape (lags + 1, p, m).

    Args:
        a: shape (N, p), without mean.
        b: shape (N, m), without mean.
        lags: [samples], less than N.
    """
    n = len(a)
    return np.array([a[k:].T @ b[: n - k] for k in range(lags + 1)]) / n

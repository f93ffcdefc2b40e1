"""What a computed output leaves of a measured one: fit, whiteness, what still depends on the input."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.special import chdtrc, ndtr, ndtri

from workbench.core.records.record import RecordPart, entry, numbers
from workbench.core.values.arrays import Floats
from workbench.data.experiment.experiment import Experiment

__all__ = [
    "LEVEL",
    "OutputFit",
    "Residuals",
    "autocorrelation",
    "cross_correlation",
    "fit_of",
    "residuals_of",
]


@dataclass(frozen=True)
class OutputFit:
    """One output, measured y against computed ŷ; ȳ is the mean of y.

    Attributes:
        output: its name.
        fit_percent: 100 (1 − ‖y − ŷ‖ / ‖y − ȳ‖) [%]: 100 is perfect, 0 is no better than the mean, less is worse.
        error_percent: 100 ‖e − ē‖ / ‖y − ȳ‖ with e = y − ŷ [%]: the error of the detrended output, in which an offset
            that no linear model can have does not count. 100 − fit_percent where the error has no mean.
        rms: root mean square of e [unit of the output].
        offset: mean of e [unit of the output].
    """

    output: str
    fit_percent: float
    error_percent: float
    rms: float
    offset: float

    @property
    def reason(self) -> str:
        """Why there is no fit; empty where there is one."""
        if np.isfinite(self.fit_percent):
            return ""
        if not np.isfinite(self.rms):
            return (
                "the model is unstable and has no finite output over these data; take the automatic order, "
                "another order or method, or the option stable"
            )
        return "the measured output is constant"

    @property
    def words(self) -> str:
        """The figures in one line."""
        if self.reason:
            return f"{self.output}: no fit: {self.reason}"
        return f"{self.output}: fit {self.fit_percent:.4g} %, error {self.error_percent:.4g} % without its mean"


def fit_of(output: str, measured: Floats, computed: Floats) -> OutputFit:
    """Return the figures of one output; NaN where the computed output is not finite or the measured one never moves.

    Args:
        output: its name.
        measured: shape (N,).
        computed: shape (N,).
    """
    error = measured - computed
    with np.errstate(all="ignore"):  # an unstable model overflows
        rms, offset = float(np.sqrt(np.mean(error**2))), float(np.mean(error))
        missed, about = (_percent(e, measured - np.mean(measured)) for e in (error, error - offset))
    fit = 100.0 - missed
    return OutputFit(output, fit, about, rms, offset)


def _percent(error: Floats, size: Floats) -> float:
    """Return the norm of one over that of the other [%]; NaN where there is none."""
    part = float(np.linalg.norm(error)) / max(float(np.linalg.norm(size)), 1e-300)
    return 100.0 * part if np.any(size) and np.isfinite(part) else float("nan")


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


ROUNDING = 1e-9  # residuals below this part of the output's size are rounding


@dataclass(frozen=True, eq=False, kw_only=True)
class Residuals(RecordPart):
    """Computed outputs, what is left, and what that says.

    Attributes:
        kind: "simulation", "one-step prediction" or "n-step prediction".
        computed: shape (N, p), outputs of the model [units of the outputs].
        residual: shape (N, p), measured less computed.
        fits: one for each output.
        autocorrelation: with its verdict; None where nothing is left to test, or the model has no finite output.
        cross: likewise.
        remark: why there is no test; empty otherwise.
    """

    kind: str
    computed: Floats = field(metadata=entry(dims=("sample", "output")))
    residual: Floats = field(metadata=entry(dims=("sample", "output")))
    fits: tuple[OutputFit, ...]
    autocorrelation: Autocorrelation | None
    cross: CrossCorrelation | None = field(metadata=entry(key="cross_correlation"))
    remark: str = ""

    @property
    def words(self) -> tuple[str, ...]:
        """Fits and verdicts, one line each."""
        fits = [f.words for f in self.fits]
        if self.autocorrelation is None or self.cross is None:
            return (*(f"{self.kind}: {text}" for text in (*fits, self.remark)),)
        tests = (self.autocorrelation.words, *self.cross.words)
        return (*(f"{self.kind}: {text}" for text in (*fits, *tests)),)

    @property
    def tests(self) -> dict[str, Any]:
        """Fits, correlations and verdicts by their keys in JSON, without the time histories."""
        return {key: held for key, held in self.to_dict().items() if key not in ("computed", "residual")}

    def derived(self) -> dict[str, Any]:
        """Return the verdict."""
        return {"words": self.words}


def residuals_of(kind: str, data: Experiment, computed: Floats, *, lags: int) -> Residuals:
    """Return fits and residual tests of computed outputs.

    Args:
        kind: how they were computed.
        data: measured.
        computed: shape (N, p).
        lags: of the tests [samples].
    """
    residual = data.y - computed
    columns = zip(data.output_names, data.y.T, computed.T, strict=True)
    fits = tuple(fit_of(name, y, c) for name, y, c in columns)
    remark = _remark(data, residual)
    tested = not remark
    return Residuals(
        kind=kind,
        computed=computed,
        residual=residual,
        fits=fits,
        autocorrelation=autocorrelation(residual, lags) if tested else None,
        cross=cross_correlation(residual, data.u, lags) if tested else None,
        remark=remark,
    )


def _remark(data: Experiment, residual: Floats) -> str:
    if not np.all(np.isfinite(residual)):
        return "the model is unstable, so its output grows without bound: no residual tests"
    size, moved = np.sqrt(np.mean(residual**2, axis=0)), np.sqrt(np.mean(data.y**2, axis=0))
    if np.any(size <= ROUNDING * moved):
        return "the residuals of an output are rounding errors: there is nothing to test"
    return ""

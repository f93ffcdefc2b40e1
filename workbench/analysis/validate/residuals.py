"""One way of computing the output beside the measured one: fit, residuals and their tests."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from workbench.analysis.experiment import Experiment
from workbench.analysis.validate.cross_correlation import CrossCorrelation, cross_correlation
from workbench.analysis.validate.fit import Fit, fit_of
from workbench.analysis.validate.whiteness import Autocorrelation, autocorrelation
from workbench.session.base import Floats

__all__ = ["Residuals", "residuals_of"]

ROUNDING = 1e-9  # residuals below this part of the output's size are rounding


@dataclass(frozen=True, eq=False, kw_only=True)
class Residuals:
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
    computed: Floats
    residual: Floats
    fits: tuple[Fit, ...]
    autocorrelation: Autocorrelation | None
    cross: CrossCorrelation | None
    remark: str = ""

    @property
    def words(self) -> tuple[str, ...]:
        """Fits and verdicts, one line each."""
        fits = [f.words for f in self.fits]
        if self.autocorrelation is None or self.cross is None:
            return (*(f"{self.kind}: {text}" for text in (*fits, self.remark)),)
        tests = (self.autocorrelation.words, *self.cross.words)
        return (*(f"{self.kind}: {text}" for text in (*fits, *tests)),)

    def to_dict(self) -> dict[str, Any]:
        """Return figures and correlations as plain lists and numbers."""
        a, c = self.autocorrelation, self.cross
        tests: dict[str, Any] = {"autocorrelation": None, "cross_correlation": None}
        if a is not None and c is not None:
            tests = {"autocorrelation": _white(a), "cross_correlation": _cross(c)}
        fits = [{k: _finite(v) for k, v in vars(f).items()} for f in self.fits]
        return {"kind": self.kind, "fits": fits, **tests, "remark": self.remark, "words": list(self.words)}


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
        return "the model is unstable, its output grows beyond all bounds: no residual tests"
    size, moved = np.sqrt(np.mean(residual**2, axis=0)), np.sqrt(np.mean(data.y**2, axis=0))
    if np.any(size <= ROUNDING * moved):
        return "the residuals of an output are rounding: nothing is left to test"
    return ""


def _white(a: Autocorrelation) -> dict[str, Any]:
    plain = {"lags": a.lags.tolist(), "values": a.values.T.tolist(), "band": a.band, "outside": list(a.outside)}
    return {**plain, "statistic": a.statistic, "degrees": a.degrees, "p_value": a.p_value, "white": a.white}


def _cross(c: CrossCorrelation) -> dict[str, Any]:
    """Values and bands as [output][input]."""
    plain = {"lags": c.lags.tolist(), "values": c.values.transpose(1, 2, 0).tolist(), "band": c.band.tolist()}
    probabilities = {"p_negative": c.p_negative, "p_positive": c.p_positive}
    verdicts = {**probabilities, "undermodelled": c.undermodelled, "feedback": c.feedback, "inside": c.inside}
    return {**plain, "band_all": c.band_all.tolist(), "outside": list(c.outside), **verdicts}


def _finite(value: str | float) -> str | float | None:
    return value if isinstance(value, str) or np.isfinite(value) else None

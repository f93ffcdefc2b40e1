"""One way of computing the output beside the measured one: fit, residuals and their tests."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from workbench.core.records.record import RecordPart, entry
from workbench.core.values.arrays import Floats
from workbench.data.experiment.experiment import Experiment
from workbench.identification.validate.cross_correlation import CrossCorrelation, cross_correlation
from workbench.identification.validate.fit import OutputFit, fit_of
from workbench.identification.validate.whiteness import Autocorrelation, autocorrelation

__all__ = ["Residuals", "residuals_of"]

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

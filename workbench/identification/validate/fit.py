"""How well a computed output follows a measured one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.errors import InputError

__all__ = ["ERROR_FIGURES", "OutputFit", "error_figure", "fit_of"]


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
        return f"{self.output}: fit {self.fit_percent:.4g} %, error {self.error_percent:.4g} %"


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
    fit = 100.0 - error_figure(measured, computed, "fit")
    return OutputFit(output, fit, error_figure(measured, computed, "detrended"), rms, offset)


def error_figure(measured: Floats, computed: Floats, definition: str = "detrended") -> float:
    """Return the error in per cent under one of several definitions in use.

    Published figures seldom say which one they are; this makes them comparable.

    Args:
        measured: shape (N,).
        computed: shape (N,).
        definition: name in `ERROR_FIGURES`.

    Raises:
        InputError: unknown definition.
    """
    if definition not in ERROR_FIGURES:
        raise InputError(f"error figure '{definition}' is unknown; known: {', '.join(ERROR_FIGURES)}")
    with np.errstate(all="ignore"):
        error, size = ERROR_FIGURES[definition](measured, computed)
        return float(100.0 * error / size) if size > 0.0 and np.isfinite(error) else float("nan")


def _norm(values: Floats) -> float:
    return float(np.linalg.norm(values))


def _level(values: Floats) -> Floats:
    return values - np.mean(values)


_Pair = tuple[float, float]

# Name → size of the error, size it is compared with.
ERROR_FIGURES: Mapping[str, Callable[[Floats, Floats], _Pair]] = {
    # ‖e − ē‖ / ‖y − ȳ‖: means taken off both. The workbench's `error_percent`.
    "detrended": lambda y, c: (_norm(_level(y - c)), _norm(_level(y))),
    # ‖e‖ / ‖y − ȳ‖ = 100 − fit.
    "fit": lambda y, c: (_norm(y - c), _norm(_level(y))),
    # ‖e‖ / ‖y‖: as recorded, an operating point makes it small.
    "raw": lambda y, c: (_norm(y - c), _norm(y)),
    # The part of the variance that is not explained (100 − VAF).
    "variance": lambda y, c: (_norm(_level(y - c)) ** 2, _norm(_level(y)) ** 2),
    # Mean magnitudes instead of root mean squares.
    "absolute": lambda y, c: (float(np.sum(np.abs(_level(y - c)))), float(np.sum(np.abs(_level(y))))),
    # Root mean square of the error over the range of the output.
    "range": lambda y, c: (_norm(_level(y - c)) / np.sqrt(len(y)), float(np.ptp(y))),
    # Largest error over the largest deflection.
    "peak": lambda y, c: (float(np.max(np.abs(y - c))), float(np.max(np.abs(_level(y))))),
}

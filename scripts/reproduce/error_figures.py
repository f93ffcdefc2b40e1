"""Definitions of an error in per cent that are in use; published figures seldom say which one they are."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.errors import InputError

__all__ = ["ERROR_FIGURES", "error_figure"]


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

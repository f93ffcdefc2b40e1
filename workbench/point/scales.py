"""How far a variable is moved: errors of what is evaluated, and the scale where nothing is declared."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from workbench.core.values.arrays import Floats

__all__ = ["INTEGRATION", "MODELS_OWN_ERROR", "straight_over"]

INTEGRATION = 1e-10  # relative tolerance, where the workbench integrates and small differences count
MODELS_OWN_ERROR = 1e-9  # relative, of a period that something integrates
_DECADES = 16
_AGREES = 0.3  # of two slopes over widths ten times apart
_ROUNDING = 1e-14


def straight_over(slope: Callable[[float], Floats], here: Floats, widest: float) -> float:
    """Return the largest width, from the widest downwards, over which equations are straight; else the widest.

    Their slope over it is that over a tenth of it, up to 30 %.

    Args:
        slope: width → slope of each equation over it, shape (e,); NaN where the model cannot be evaluated.
        here: their values at the point, shape (e,).
        widest: to begin with, in the unit of the variable.
    """
    width, wide = widest, slope(widest)
    for _ in range(_DECADES):
        narrow = slope(0.1 * width)
        noise = _ROUNDING * np.abs(here) / (0.1 * width)
        with np.errstate(invalid="ignore"):
            same = np.abs(wide - narrow) <= _AGREES * np.maximum(np.abs(wide), np.abs(narrow)) + noise
        if same.all():
            return width
        width, wide = 0.1 * width, narrow
    return widest

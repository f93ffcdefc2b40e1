"""The error of a result from its change when the step is halved, twice.

Source: L. Richardson, J. Gaunt, The deferred approach to the limit, Phil. Trans. R. Soc. A 226 (1927); E. Hairer,
S. Nørsett, G. Wanner, Solving Ordinary Differential Equations I, 2nd ed., section II.4. Not for results that do not
converge evenly: the order says so.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from workbench.core.values.arrays import Floats

__all__ = ["Halving", "halving"]


_EVEN = (0.5, 6.0)  # orders that can be believed
_ROUNDING = 1e-12  # relative: smaller changes are not counted as changes


@dataclass(frozen=True)
class Halving:
    """One output at three steps.

    Attributes:
        name: of the output.
        span: largest minus smallest value.
        change: largest change when the step is halved.
        order: observed; None where nothing changes, or it does so unevenly.
        error: estimated largest error at the step; with no order the change is taken twice, as for order 1.
    """

    name: str
    span: float
    change: float
    order: float | None
    error: float


def halving(name: str, coarse: Floats, half: Floats, quarter: Floats) -> Halving:
    """Return what three runs say about the error of the first.

    Args:
        name: of the output.
        coarse: values with the step, shape (n,).
        half: with half of it.
        quarter: with a quarter.
    """
    first, second = coarse - half, half - quarter
    change, after = (float(np.max(np.abs(d), initial=0.0)) for d in (first, second))
    floor = _ROUNDING * float(np.max(np.abs(quarter), initial=0.0))
    order = math.log2(change / after) if change > floor and after > floor else None
    if order is not None and not _EVEN[0] <= order <= _EVEN[1]:
        order = None
    error = 2.0 * change if order is None else change / (1.0 - 2.0**-order)
    return Halving(name, float(np.ptp(quarter)), change, order, error)

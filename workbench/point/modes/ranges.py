"""Where over the parameter any of the modes is unstable."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.point.modes.mode import Critical, Mode

__all__ = ["USUAL_TOLERANCE", "unstable_ranges"]

USUAL_TOLERANCE = 1e-6  # of the range of the parameter


def unstable_ranges(
    values: Floats, modes: Sequence[Mode], critical: Sequence[Critical], *, tolerance: float
) -> tuple[tuple[float, float], ...]:
    """Return the ranges of the parameter in which at least one mode is unstable: the union over the modes.

    Args:
        values: of the parameter, rising, shape (k,).
        modes: at these values.
        critical: where they become unstable or stable, rising.
        tolerance: of the critical values; a gap between two of them that it leaves in doubt counts as unstable.
    """
    borders = [float(values[0]), *(c.value for c in critical), float(values[-1])]
    result = list[tuple[float, float]]()
    for low, high in pairwise(borders):
        if low == high or not any(_unstable(values, m, critical, low, high) for m in modes):
            continue
        joined = bool(result) and low - result[-1][1] <= 2.0 * tolerance
        result.append((result.pop()[0] if joined else low, high))
    return tuple(result)


def _unstable(values: Floats, mode: Mode, critical: Sequence[Critical], low: float, high: float) -> bool:
    """Return whether a mode is unstable between two neighbouring critical values, or an end of the range."""
    grows = mode.pole.real > mode.uncertain  # False, too, where it does not exist
    inside = (values > low) & (values < high)
    if inside.any():
        return bool(grows[inside].any())
    # Both lie in one step: the mode's own critical values in the step say on which side of them it is unstable.
    k = min(int(np.searchsorted(values, low, side="right")) - 1, len(values) - 2)
    own = [c for c in critical if c.mode == mode.number and values[k] <= c.value <= values[k + 1]]
    if before := [c for c in own if c.value <= low]:
        return before[-1].becomes == "unstable"
    if own:
        return own[0].becomes == "stable"
    return bool(grows[k] or grows[k + 1])

"""Whether a periodic motion is stable, by its Floquet multipliers and what they may be off by."""

from __future__ import annotations

import numpy as np

from workbench.core.values.arrays import Complex

__all__ = ["NEUTRAL", "is_stable", "largest"]

# So near to 1 a multiplier is that of an integrator, or of a family of motions. Along slopes that of an integrator is 1
# exactly; from differences, of periods integrated at 1e-6, it is off by some 1e-6. One that were to grow by 1e-5 in a
# period would take 70 000 of them to double: no run tells it from standing still.
NEUTRAL = 1e-5


def is_stable(multipliers: Complex | None, doubt: float = 0.0) -> bool | None:
    """Whether a motion attracts what is near it: all multipliers inside the unit circle. None: not known.

    A multiplier of 1 itself, where the states can be shifted (an integrator) or where motions form a family, neither
    grows nor decays, and is not counted. The one along a closed orbit is to be left out before.

    Args:
        multipliers: shape (n,); None, or not finite: not known.
        doubt: what they may be off by.
    """
    if multipliers is None or not np.isfinite(multipliers).all():
        return None
    size = np.abs(multipliers[np.abs(multipliers - 1.0) > NEUTRAL])
    if (size - doubt > 1.0).any():
        return False
    return True if (size + doubt < 1.0).all() else None


def largest(multipliers: Complex | None) -> float | None:
    """Return the size of the largest multiplier; None: there is none, or it is not known.

    Args:
        multipliers: besides the one along the orbit, shape (n,); None: not known.
    """
    return float(np.abs(multipliers).max()) if multipliers is not None and len(multipliers) else None

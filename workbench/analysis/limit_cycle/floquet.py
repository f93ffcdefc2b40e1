"""Floquet multipliers of a periodic motion of a linear part and a static block."""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm

from workbench.analysis.describing.base import Block, Complex, Floats
from workbench.analysis.describing.fourier import series
from workbench.analysis.limit_cycle.harmonic_balance import Cycle
from workbench.analysis.nyquist.linear_part import LinearPart

__all__ = ["is_stable", "multipliers"]

_STEPS = 512
_STEPS_LARGE = 256
_LARGE = 20  # states
_MARGIN = 1e-6


def multipliers(part: LinearPart, block: Block, cycle: Cycle) -> Complex:
    """Return the Floquet multipliers, largest first, shape (n,); one of them is 1 (the motion along the orbit).

    Over each of many steps the block is replaced by the slope of its chord, which keeps jumps: a relay is passed as
    the jump of the flow demands.

    Args:
        part: L.
        block: static.
        cycle: the motion.

    Raises:
        NotImplementedError: the block has a memory.
    """
    count = _STEPS if len(part.A) <= _LARGE else _STEPS_LARGE
    theta = np.linspace(0.0, 2.0 * np.pi, count + 1) + 0.1  # no step ends where an odd block turns over
    v = series(cycle.v, theta)
    w = block.static(v)
    rise = np.diff(v)
    small = np.abs(rise) < 1e-9 * np.abs(v).max()
    slope = np.where(small, 0.0, np.diff(w) / np.where(small, 1.0, rise))
    slope /= 1.0 + part.D * slope
    step = 1.0 / cycle.frequency / count
    flow = np.eye(len(part.A))
    rank_one = np.outer(part.B, part.C)
    steps: dict[float, Floats] = {}  # blocks of straight pieces have few slopes
    unit = max(float(np.abs(slope).max(initial=0.0)), 1e-300)
    for k in (np.round(slope / unit, 10) * unit).tolist():
        if k not in steps:
            steps[k] = expm((part.A - k * rank_one) * step)
        flow = steps[k] @ flow
    found = np.linalg.eigvals(flow).astype(np.complex128)
    return found[np.argsort(-np.abs(found))]


def is_stable(found: Complex) -> bool:
    """Whether all multipliers but the one nearest to 1 lie inside the unit circle.

    Args:
        found: shape (n,).
    """
    others = np.delete(found, int(np.argmin(np.abs(found - 1.0))))
    return bool(np.all(np.abs(others) < 1.0 + _MARGIN))

"""Floquet multipliers of a periodic motion of a linear part and a static block."""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm

from workbench.analysis.describing.base import Block, Complex, Floats
from workbench.analysis.describing.fourier import series
from workbench.analysis.limit_cycle.harmonic_balance import Cycle
from workbench.core.linear import LinearPart

__all__ = ["multipliers", "others"]

_STEPS = 512
_STEPS_SPLIT = 1024
_TRUE_ENOUGH = 1e-3
_LARGE = 20  # states
_SEEN = 1e-10  # of the largest multiplier: smaller ones are rounding
_FOUND = 0.2  # by which the multiplier of the motion along the orbit may be off from 1


def multipliers(part: LinearPart, block: Block, cycle: Cycle) -> Complex:
    """Return the Floquet multipliers, largest first, shape (n,); one of them is 1 (the motion along the orbit).

    Over each of many steps the block is replaced by the slope of its chord, which keeps jumps: a relay is passed as
    the jump of the flow demands. Large systems are split (Strang) into the linear part alone and the block alone, whose
    exponential is of rank one; where the multiplier 1 then comes out wrong, exponentials of the whole are taken. Where
    their product is not that of Liouville's formula they are NaN.

    Args:
        part: L.
        block: static.
        cycle: the motion.

    Raises:
        NotImplementedError: the block has a memory.
    """
    if len(part.A) > _LARGE:
        found = _sorted(_split(part, *_slopes(part, block, cycle, _STEPS_SPLIT)))
        if np.min(np.abs(found - 1.0)) < _TRUE_ENOUGH:
            return found
    slopes, step = _slopes(part, block, cycle, _STEPS)
    found = _sorted(_whole(part, slopes, step))
    return found if _agrees_with_liouville(found, part, slopes, step) else np.full_like(found, np.nan)


def _agrees_with_liouville(found: Complex, part: LinearPart, slopes: list[float], step: float) -> bool:
    """Whether the product of the multipliers is the exponential of the traces, where rounding lets one see it."""
    size = np.abs(found)
    if not np.isfinite(size).all() or size.min(initial=np.inf) <= _SEEN * size.max(initial=0.0):
        return bool(np.isfinite(size).all())
    traces = step * float(len(slopes) * np.trace(part.A) - sum(slopes) * float(part.c @ part.b))
    return bool(abs(float(np.log(size).sum()) - traces) <= _TRUE_ENOUGH * max(1.0, abs(traces)))


def _sorted(flow: Floats) -> Complex:
    found = np.linalg.eigvals(flow).astype(np.complex128)
    return found[np.argsort(-np.abs(found))]


def _slopes(part: LinearPart, block: Block, cycle: Cycle, count: int) -> tuple[list[float], float]:
    """Return the slope of the block's chord over each step, and the step [s]."""
    theta = np.linspace(0.0, 2.0 * np.pi, count + 1) + 0.1  # no step ends where an odd block turns over
    v = series(cycle.v, theta)
    w = block.static(v)
    rise = np.diff(v)
    small = np.abs(rise) < 1e-9 * np.abs(v).max()
    slope = np.where(small, 0.0, np.diff(w) / np.where(small, 1.0, rise))
    slope /= 1.0 + part.d * slope
    unit = max(float(np.abs(slope).max(initial=0.0)), 1e-300)
    # Blocks of straight pieces have few slopes.
    return [float(k) for k in np.round(slope / unit, 10) * unit], 1.0 / cycle.frequency / count


def _whole(part: LinearPart, slopes: list[float], step: float) -> Floats:
    """Return the flow over a period by exponentials of A − k B C."""
    flow = np.eye(len(part.A))
    rank_one = np.outer(part.b, part.c)
    steps: dict[float, Floats] = {}
    for k in slopes:
        if k not in steps:
            steps[k] = expm((part.A - k * rank_one) * step)
        flow = steps[k] @ flow
    return flow


def _split(part: LinearPart, slopes: list[float], step: float) -> Floats:
    """Return the flow over a period, half a step of A, a step of −k B C, half a step of A."""
    half = np.asarray(expm(part.A * (0.5 * step)), dtype=np.float64)
    whole, direct = half @ half, float(part.c @ part.b)
    flow = half
    for k in slopes:
        x = k * step * direct
        reach = k * step if abs(x) < 1e-12 else -np.expm1(-x) / direct
        flow = whole @ (flow - reach * np.outer(part.b, part.c @ flow))
    # One half step too many at the end.
    return np.asarray(np.linalg.solve(half, flow), dtype=np.float64)


def others(found: Complex) -> tuple[Complex | None, float]:
    """Return the multipliers without the one at 1, and by how much that one is off; None: none is near 1.

    The motion along the orbit has the multiplier 1. Where the orbit is approximate (few harmonics), that one is off,
    and the others are as well; where none is near 1, none is right.

    Args:
        found: shape (n,).
    """
    off = np.abs(found - 1.0)
    if not np.isfinite(found).all() or not off.min(initial=np.inf) < _FOUND:
        return None, np.inf
    return np.delete(found, int(np.argmin(off))), float(off.min())

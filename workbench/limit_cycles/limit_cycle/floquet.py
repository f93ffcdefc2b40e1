"""Floquet multipliers of a periodic motion of a linear part and static blocks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import expm

from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.linear import Linear
from workbench.limit_cycles.limit_cycle.harmonic_balance import Cycle
from workbench.loops.describing.base import DescribedBlock
from workbench.loops.describing.fourier import series

__all__ = ["multipliers", "others"]

_STEPS = 512
_STEPS_SPLIT = 1024
_TRUE_ENOUGH = 1e-3
_LARGE = 20  # states
_SEEN = 1e-10  # of the largest multiplier: smaller ones are rounding
_FOUND = 0.2  # by which the multiplier of the motion along the orbit may be off from 1


def multipliers(part: Linear, blocks: Sequence[DescribedBlock], cycle: Cycle) -> Complex:
    """Return the Floquet multipliers, largest first, shape (n,); one of them is 1 (the motion along the orbit).

    Over each of many steps each block is replaced by the slope of its chord, which keeps jumps: a relay is passed as
    the jump of the flow demands. Large systems with one block are split (Strang) into the linear part alone and the
    block alone, whose exponential is of rank one; where the multiplier 1 then comes out wrong, exponentials of the
    whole are taken. Where their product is not that of Liouville's formula they are NaN.

    Args:
        part: L, from the outputs of the blocks to their inputs.
        blocks: static.
        cycle: the motion.

    Raises:
        NotImplementedError: a block has a memory.
    """
    if len(part.A) > _LARGE and len(blocks) == 1:
        slopes, step = _slopes(part, blocks, cycle, _STEPS_SPLIT)
        result = _sorted(_split(part, slopes[:, 0, 0].tolist(), step))
        if np.min(np.abs(result - 1.0)) < _TRUE_ENOUGH:
            return result
    slopes, step = _slopes(part, blocks, cycle, _STEPS)
    result = _sorted(_whole(part, slopes, step))
    return result if _agrees_with_liouville(result, part, slopes, step) else np.full_like(result, np.nan)


def _agrees_with_liouville(result: Complex, part: Linear, slopes: Floats, step: float) -> bool:
    """Whether the product of the multipliers is the exponential of the traces, where rounding lets one see it."""
    size = np.abs(result)
    if not np.isfinite(size).all() or size.min(initial=np.inf) <= _SEEN * size.max(initial=0.0):
        return bool(np.isfinite(size).all())
    traces = step * float(len(slopes) * np.trace(part.A) - np.trace(slopes.sum(axis=0) @ part.C @ part.B))
    return bool(abs(float(np.log(size).sum()) - traces) <= _TRUE_ENOUGH * max(1.0, abs(traces)))


def _sorted(flow: Floats) -> Complex:
    result = np.linalg.eigvals(flow).astype(np.complex128)
    return result[np.argsort(-np.abs(result))]


def _slopes(part: Linear, blocks: Sequence[DescribedBlock], cycle: Cycle, count: int) -> tuple[Floats, float]:
    """Return K over each step, from what the states do to the blocks' inputs to their outputs, and the step [s].

    With the slopes S of the chords K = S (1 + D S)⁻¹, so that dξ/dt = (A − B K C) ξ; shape (count, m, m).
    """
    theta = np.linspace(0.0, 2.0 * np.pi, count + 1) + 0.1  # no step ends where an odd block turns over
    slopes = np.zeros((count, len(blocks), len(blocks)))
    for i, (block, coefficients) in enumerate(zip(blocks, cycle.v, strict=True)):
        v = series(coefficients, theta)
        rise = np.diff(v)
        small = np.abs(rise) < 1e-9 * np.abs(v).max()
        slope = np.where(small, 0.0, np.diff(block.static(v)) / np.where(small, 1.0, rise))
        unit = max(float(np.abs(slope).max(initial=0.0)), 1e-300)
        slopes[:, i, i] = np.round(slope / unit, 10) * unit  # blocks of straight pieces have few slopes
    if part.D.any():
        slopes = slopes @ np.linalg.inv(np.eye(len(blocks)) + part.D @ slopes)
    return slopes, 1.0 / cycle.frequency / count


def _whole(part: Linear, slopes: Floats, step: float) -> Floats:
    """Return the flow over a period by exponentials of A − B K C."""
    flow = np.eye(len(part.A))
    steps: dict[bytes, Floats] = {}
    for K in slopes:
        key = K.tobytes()
        if key not in steps:
            steps[key] = expm((part.A - part.B @ K @ part.C) * step)
        flow = steps[key] @ flow
    return flow


def _split(part: Linear, slopes: list[float], step: float) -> Floats:
    """Return the flow over a period, half a step of A, a step of −k B C, half a step of A."""
    half = np.asarray(expm(part.A * (0.5 * step)), dtype=np.float64)
    b, c = part.B[:, 0], part.C[0]
    whole, direct = half @ half, float(c @ b)
    flow = half
    for k in slopes:
        x = k * step * direct
        reach = k * step if abs(x) < 1e-12 else -np.expm1(-x) / direct
        flow = whole @ (flow - reach * np.outer(b, c @ flow))
    # One half step too many at the end.
    return np.asarray(np.linalg.solve(half, flow), dtype=np.float64)


def others(result: Complex) -> tuple[Complex | None, float]:
    """Return the multipliers without the one at 1, and by how much that one is off; None: none is near 1.

    The motion along the orbit has the multiplier 1. Where the orbit is approximate (few harmonics), that one is off,
    and the others are as well; where none is near 1, none is right.

    Args:
        result: shape (n,).
    """
    off = np.abs(result - 1.0)
    if not np.isfinite(result).all() or not off.min(initial=np.inf) < _FOUND:
        return None, np.inf
    return np.delete(result, int(np.argmin(off))), float(off.min())

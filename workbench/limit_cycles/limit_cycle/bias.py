"""Where a loop has its middle: the linear part at rest, the block on its characteristic, jumps filled in."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import bisect

from workbench.core.values.arrays import Floats
from workbench.point.lin.result import LinResult

__all__ = ["Centre", "centre_of", "is_moving"]

_MOVES = 1e-7  # of the terms of a derivative: smaller ones are rest
_LEFT = 1e-9  # of the first derivatives
_SINGULAR = 1e-9  # of the largest singular value
_DECADES = 12
_PER_DECADE = 40
_ZERO = 1e-12  # of the size of the loop: a smaller input of the block is rounding


@dataclass(frozen=True, eq=False)
class Centre:
    """A point about which a loop oscillates.

    Attributes:
        x: states of the linear part, shape (n,).
        v: input of the block.
        w: its output; between the values on both sides where it jumps at `v`, as a relay does.
    """

    x: Floats
    v: float
    w: float


def is_moving(rest: LinResult, first: LinResult | None = None) -> bool:
    """Whether the linear part moves at the point where it was linearised.

    Args:
        rest: it.
        first: from where one came to that point; what is left of the derivatives there by rounding counts as rest.
    """
    if first is not None and np.abs(_rates(rest)).max(initial=0.0) <= _LEFT * np.abs(_rates(first)).max(initial=0.0):
        return False
    dx, x, u = _rates(rest), _states(rest), np.array([rest.operating_point.u[n] for n in rest.input_names])
    terms = np.abs(rest.A) @ np.abs(x) + np.abs(rest.B) @ np.abs(u)
    return bool((np.abs(dx) > _MOVES * terms).any())


def centre_of(rest: LinResult, block: Callable[[Floats], Floats], v: float, w: float) -> Centre | None:
    """Return where dx/dt = 0 and w is on the characteristic of the block; None: nowhere.

    The linear part at rest gives a straight line between v and w, an integrator w alone; it meets the
    characteristic, its jumps drawn as upright lines.

    Args:
        rest: linear from w to v, about a point where it moves.
        block: its output at inputs, shape (n,).
        v: input of the block at that point.
        w: its output there.
    """
    left, sigma, _ = np.linalg.svd(rest.A)
    rank = int((sigma > _SINGULAR * sigma.max(initial=0.0)).sum())
    if rank < len(sigma):
        return _held(rest, block, v, w, left[:, rank:])
    return _on_line(rest, block, v, w)


def _held(rest: LinResult, block: Callable[[Floats], Floats], v: float, w: float, open_: Floats) -> Centre | None:
    """Return the centre where integrators rest at one w alone; `open_`: the left null space of A, shape (n, i)."""
    a, b, c, d = rest.A, rest.B[:, 0], rest.C[0], float(rest.D[0, 0])
    drift = _rates(rest)
    forced, free = open_.T @ b, open_.T @ drift
    if not np.abs(forced).max() > 0.0:
        return None
    held = w - float(forced @ free) / float(forced @ forced)
    at = _meeting(lambda x: block(x) - held, v, max(abs(v), 1.0))
    if at is None:
        return None
    dw = held - w
    wanted = np.append(-(drift + b * dw), at - v - d * dw)
    moved = np.linalg.lstsq(np.vstack([a, c]), wanted, rcond=None)[0]
    return Centre(_states(rest) + moved, at, held)


def _on_line(rest: LinResult, block: Callable[[Floats], Floats], v: float, w: float) -> Centre | None:
    """Return the centre where the linear part rests at every w: v is a straight line over it; see `centre_of`."""
    per_w, per_drift = np.linalg.solve(rest.A, np.column_stack([rest.B[:, 0], _rates(rest)])).T
    c, d = rest.C[0], float(rest.D[0, 0])
    slope = d - float(c @ per_w)
    level = v - float(c @ per_drift)
    probe = block(np.array([v, level, v + 1.0, v - 1.0]))
    size = max(abs(v), abs(level), abs(slope) * float(np.abs(probe - w).max()), 1e-9)
    at = _meeting(lambda x: x - level - slope * (block(x) - w), v, size)
    if at is None:
        return None
    dw = (at - level) / slope if slope else 0.0
    return Centre(_states(rest) - per_drift - per_w * dw, at, w + dw)


def _meeting(distance: Callable[[Floats], Floats], near: float, size: float) -> float | None:
    """Return the zero or jump through zero that is nearest to `near`."""
    steps = size * np.logspace(-0.5 * _DECADES, 0.5 * _DECADES, _DECADES * _PER_DECADE)
    grid = np.unique(np.concatenate([near - steps, [near], near + steps, [0.0]]))
    sign = np.sign(distance(grid))
    at = np.flatnonzero(sign[:-1] * sign[1:] <= 0.0)
    if not len(at):
        return None
    i = int(at[np.argmin(np.abs(0.5 * (grid[at] + grid[at + 1]) - near))])
    low, high = float(grid[i]), float(grid[i + 1])
    if zeros := [x for x, s in ((low, sign[i]), (high, sign[i + 1])) if s == 0.0]:
        return min(zeros, key=lambda x: abs(x - near))
    middle = float(bisect(lambda x: float(distance(np.array([x]))[0]), low, high, xtol=1e-3 * _ZERO * size))
    return 0.0 if abs(middle) <= _ZERO * size else middle


def _rates(rest: LinResult) -> Floats:
    return _filled(rest, rest.operating_point.dx)


def _states(rest: LinResult) -> Floats:
    return _filled(rest, rest.operating_point.x)


def _filled(rest: LinResult, values: Mapping[str, float]) -> Floats:
    """Return values of all states; those of a Padé approximation count from where the delay is at rest."""
    return np.array([values.get(n, 0.0) for n in rest.state_names])

"""Crossings of the real axis by L(jω), each refined to rounding."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from workbench.analysis.describing.base import Complex, Floats
from workbench.core.linear import LinearPart

__all__ = ["AxisCrossing", "axis_crossings"]

_SIDE = 1e-9  # relative distance at which both sides of a root are looked at


@dataclass(frozen=True)
class AxisCrossing:
    """Where L is real.

    Attributes:
        frequency: [Hz].
        gain: −1/L, the gain that puts a pole pair on the imaginary axis there; 0 at a pole of L on that axis.
    """

    frequency: float
    gain: float


def axis_crossings(part: LinearPart, f: Floats, value: Complex) -> list[AxisCrossing]:
    """Return where L(j2πf) crosses the real axis, rising in frequency.

    Args:
        part: the linear part.
        f: frequencies from `adaptive_grid` [Hz].
        value: L there.
    """
    sine = _sine(value)
    brackets = [(float(f[i]), float(f[i + 1])) for i in np.flatnonzero(sine[:-1] * sine[1:] < 0.0).tolist()]
    brackets += _tangents(part, f, sine)
    roots = [_root(part, a, b) for a, b in brackets] + [float(x) for x in f[sine == 0.0]]
    found = [crossing for root in roots if (crossing := _crossing(part, root)) is not None]
    return _distinct(sorted(found, key=lambda c: c.frequency))


def _sine(value: Complex) -> Floats:
    """Return Im L/|L|, 0 on a pole."""
    with np.errstate(all="ignore"):
        sine = value.imag / np.abs(value)
    return np.where(np.isfinite(sine), sine, 0.0)


def _at(part: LinearPart, frequency: float) -> float:
    return float(_sine(part.response(frequency))[0])


def _root(part: LinearPart, low: float, high: float) -> float:
    ends = _at(part, low), _at(part, high)
    if ends[0] * ends[1] >= 0.0:  # one of them is rounding, which another order of summation turned
        return low if abs(ends[0]) <= abs(ends[1]) else high
    return float(brentq(lambda x: _at(part, x), low, high, xtol=1e-14 * high, rtol=1e-14))


def _tangents(part: LinearPart, f: Floats, sine: Floats) -> list[tuple[float, float]]:
    """Return brackets of pairs of crossings between two points of the grid on the same side of the axis."""
    size = np.abs(sine)
    inner = (size[1:-1] < size[:-2]) & (size[1:-1] < size[2:]) & (size[1:-1] < 0.3) & (size[1:-1] > 0.0)
    found = []
    for i in (np.flatnonzero(inner) + 1).tolist():
        if not (sine[i - 1] * sine[i] > 0.0 and sine[i] * sine[i + 1] > 0.0):
            continue
        sign, low, high = np.sign(sine[i]), float(f[i - 1]), float(f[i + 1])
        # The derivative of the phase is large there only where the grid is fine.
        best = minimize_scalar(
            lambda x, sign=sign: sign * _at(part, x),
            bounds=(low, high),
            method="bounded",
            options={"xatol": 1e-9 * high},
        )
        if best.fun < 0.0:
            found += [(low, float(best.x)), (float(best.x), high)]
    return found


def _crossing(part: LinearPart, root: float) -> AxisCrossing | None:
    """Return the crossing at a root of Im L/|L|; None where L itself is zero there."""
    here = part.at(root)
    left, right = part.response(root * np.array([1.0 - _SIDE, 1.0 + _SIDE]))
    beside = 0.5 * (abs(left) + abs(right))
    jumps = _sine(np.array([left]))[0] * _sine(np.array([right]))[0] < -0.25
    if not np.isfinite(here) or (jumps and not abs(here) < beside):
        return AxisCrossing(root, 0.0)
    if here == 0.0 or jumps:
        return None
    return AxisCrossing(root, -1.0 / here.real)


def _distinct(found: list[AxisCrossing]) -> list[AxisCrossing]:
    kept: list[AxisCrossing] = []
    for crossing in found:
        if not kept or crossing.frequency > kept[-1].frequency * (1.0 + 1e-9):
            kept.append(crossing)
    return kept

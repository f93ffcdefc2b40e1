"""Crossings of the real axis by L(jω), and of −1/N where that is complex, each refined to rounding."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq, minimize_scalar, root

from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.linear import LinearPart
from workbench.loops.describing.base import Block

__all__ = ["AxisCrossing", "axis_crossings", "intersections"]

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


# -- intersections with −1/N(A, f) where N is complex ---------------------------------------------

_MOST_FREQUENCIES = 4000
_CLOSE = 1e-8
_LIMITS = 60.0  # of the logarithms, so that a search that runs away ends


def intersections(block: Block, part: LinearPart, f: Floats, value: Complex, amplitudes: Floats) -> Floats:
    """Return amplitude and frequency [Hz] of each solution of 1 + N(A, f) L(f) = 0, shape (k, 2).

    Cells of the grid in which real and imaginary part change sign are searched by Powell's hybrid method.

    Args:
        block: its N may depend on the frequency.
        part: the linear part.
        f: frequencies [Hz], close enough that L turns little from one to the next.
        value: L there.
        amplitudes: rising.
    """
    keep = np.isfinite(value)
    f, value = f[keep], value[keep]
    stride = max(1, len(f) // _MOST_FREQUENCIES)
    f, value = f[::stride], value[::stride]
    f = np.asarray(f, dtype=np.float64)
    sheet = 1.0 + _gains(block, amplitudes, f) * value[None, :]
    found: list[tuple[float, float]] = []
    for i, j in zip(*np.nonzero(_mixed(sheet.real) & _mixed(sheet.imag)), strict=True):
        begin = (float(np.sqrt(amplitudes[i] * amplitudes[i + 1])), float(np.sqrt(f[j] * f[j + 1])))
        spread = (amplitudes[i + 1] / amplitudes[i], f[j + 1] / f[j])
        solution = _refined(block, part, begin, spread)
        if solution is not None and not any(np.allclose(solution, other, rtol=1e-5) for other in found):
            found.append(solution)
    return np.array(sorted(found, key=lambda s: s[1]), dtype=np.float64).reshape(-1, 2)


def _gains(block: Block, amplitudes: Floats, f: Floats) -> Complex:
    if not block.frequency_dependent:
        column = np.array([block.gain(a) for a in amplitudes.tolist()], dtype=np.complex128)
        return np.repeat(column[:, None], len(f), axis=1)
    return block.gains(amplitudes[:, None], f[None, :])


def _mixed(values: Floats) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Return which cells have corners on both sides of zero."""
    corners = np.stack([values[:-1, :-1], values[:-1, 1:], values[1:, :-1], values[1:, 1:]])
    return np.asarray((corners.min(axis=0) <= 0.0) & (corners.max(axis=0) >= 0.0))


def _refined(
    block: Block, part: LinearPart, begin: tuple[float, float], spread: tuple[float, float]
) -> tuple[float, float] | None:
    def distance(z: Floats) -> Floats:
        a, x = np.exp(np.clip(z, -_LIMITS, _LIMITS)).tolist()
        r = 1.0 + block.gain(a, x) * part.at(x)
        return np.array([r.real, r.imag]) if np.isfinite(r) else np.array([10.0, 10.0])

    solved = root(distance, np.log(begin), method="hybr", options={"xtol": 1e-13})
    amplitude, frequency = np.exp(np.clip(solved.x, -_LIMITS, _LIMITS)).tolist()
    near = abs(np.log(amplitude / begin[0])) < 4.0 * np.log(spread[0]) and abs(np.log(frequency / begin[1])) < max(
        4.0 * np.log(spread[1]), 1e-3
    )
    return (amplitude, frequency) if near and float(np.abs(solved.fun).max()) < _CLOSE else None

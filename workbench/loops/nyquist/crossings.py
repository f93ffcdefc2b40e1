"""Crossings of the real axis by L(jω), and of −1/N where that is complex, each refined to rounding."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.optimize import root

from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.linear import LinearPart
from workbench.core.values.modal import poles_of
from workbench.loops.describing.base import DescribedBlock
from workbench.loops.nyquist.level_crossings import real_crossings

__all__ = ["SAME", "AxisCrossing", "axis_crossings", "intersections"]

SAME = 1e-9  # relative difference of two gains, or frequencies, that are one
_INSIDE = -5.0  # ln |z| of discrete poles that are far inside the unit circle
_ZERO = 1e-10  # |L| below this part of its size elsewhere is a zero of L, which no finite gain belongs to
_BESIDE = (0.6, 1.7)  # times the size of a pole
_NEAR = 1e-5  # of the slowest pole: so near 0 a pole there would dominate L, if L had it
_AXIS = 1e-9  # relative distance of an open-loop pole from the border that counts as on it


@dataclass(frozen=True)
class AxisCrossing:
    """Where L is real.

    Attributes:
        frequency: [Hz]; infinite: beyond all frequencies, where L is D.
        real: L there; infinite at a pole on the border of stability.
    """

    frequency: float
    real: float

    @property
    def gain(self) -> float:
        """The k with 1 + k·L = 0, which puts a pole on the border of stability there."""
        return 0.0 - 1.0 / self.real


def axis_crossings(part: LinearPart) -> list[AxisCrossing]:
    """Return all places on the border of stability where L is real, rising in frequency.

    Between the eigenvalues of a pencil, the zeros of L(s) − L(−s), Im L keeps its sign; each crossing is refined to
    rounding. Then there are 0 (and half the sampling frequency), an infinite frequency where L has a direct part, and
    the poles of L on the border.

    Args:
        part: L.

    Source: Boyd, Balakrishnan & Kabamba 1989 (for the pencil).
    """
    kept: list[AxisCrossing] = []
    for place in sorted(_places(part), key=lambda c: c.frequency):
        if not any(_alike(place, other) for other in kept):
            kept.append(place)
    return kept


def _alike(one: AxisCrossing, other: AxisCrossing) -> bool:
    return all(math.isclose(*pair, rel_tol=SAME) for pair in ((one.real, other.real), (one.frequency, other.frequency)))


def _places(part: LinearPart) -> Iterator[AxisCrossing]:
    poles = _border_poles(part)
    size = _size(part)
    near_zero = _NEAR * float(_sizes(part).min()) if np.any(poles == 0.0) else 0.0
    for frequency in real_crossings(part):
        value = part.at(frequency)
        beside = frequency > near_zero and not np.any(np.abs(poles - frequency) < 1e-7 * frequency)
        if abs(value) > _ZERO * size and beside:
            yield AxisCrossing(frequency, value.real)
    ends = [0.0, part.highest_hz] if part.dt > 0.0 else [0.0]
    for frequency in ends:
        value = _at_zero(part, near_zero) if frequency == 0.0 and near_zero else part.at(frequency)
        on_pole = frequency > 0.0 and np.any(np.abs(poles - frequency) < 1e-12)
        if np.isfinite(value) and abs(value) > _ZERO * size and not on_pole:
            yield AxisCrossing(frequency, value.real)
    if part.d != 0.0 and len(part.A):
        yield AxisCrossing(math.inf, part.d)
    for frequency in np.unique(poles).tolist():
        yield AxisCrossing(frequency, math.inf)


def _sizes(part: LinearPart) -> Floats:
    """Return the sizes of the open-loop poles that are not 0, and one of its own [Hz]."""
    poles = poles_of(part.A, dt=part.dt)
    rates = np.abs(poles.value[np.abs(poles.value) > 10.0 * poles.uncertain])
    own = 1.0 if part.dt == 0.0 else 0.3 * math.pi / part.dt
    return np.append(rates, own) / (2.0 * math.pi)


def _at_zero(part: LinearPart, near: float) -> complex:
    """Return G(0) of a system with poles at 0 where u does not reach them or y does not see them; else infinity."""
    values = [part.at(f) for f in (near, 0.1 * near)]
    alike = abs(values[0] - values[1]) <= 1e-3 * abs(values[0])
    return complex(values[0].real) if alike else complex(math.inf)


def _border_poles(part: LinearPart) -> Floats:
    """Return the frequencies of the open-loop poles on the border, as far as rounding lets them be known [Hz]."""
    poles = poles_of(part.A, dt=part.dt)
    # Its balancing takes entries that are rounding only for exact ones: hence the second bound.
    rounding = 100.0 * np.finfo(float).eps * float(np.linalg.norm(part.A)) if len(part.A) else 0.0
    value, uncertain = poles.value, np.maximum(5.0 * poles.uncertain, rounding / (part.dt or 1.0))
    size = np.full(len(value), 1.0 / part.dt) if part.dt > 0.0 else np.abs(value)
    near = np.abs(value.real) <= _AXIS * size + uncertain
    result = np.where(value.imag > _AXIS + uncertain, value.imag, 0.0)
    if part.dt > 0.0:
        near &= value.real * part.dt > _INSIDE  # the bound is one of |z|, and its logarithm near z = 0 wide
        result = np.where(result > math.pi / part.dt - uncertain, math.pi / part.dt, result)
    kept: list[float] = []
    for turn, apart in zip(result[near].tolist(), uncertain[near].tolist(), strict=True):
        if all(abs(turn - other) > 2.0 * apart for other in kept):
            kept.append(turn)
    return np.array(kept) / (2.0 * math.pi)


def _size(part: LinearPart) -> float:
    """Return how large G is where it is large, beside its poles: on the border G is as large as rounding makes it."""
    f = np.concatenate([factor * _sizes(part) for factor in _BESIDE])
    value = np.abs(part.response(f[f < part.highest_hz]))
    value = value[np.isfinite(value)]
    return max(float(np.median(value)) if len(value) else 0.0, abs(part.d), 1e-300)


# -- intersections with −1/N(A, f) where N is complex ---------------------------------------------

_MOST_FREQUENCIES = 4000
_CLOSE = 1e-8
_LIMITS = 60.0  # of the logarithms, so that a search that runs away ends


def intersections(block: DescribedBlock, part: LinearPart, f: Floats, value: Complex, amplitudes: Floats) -> Floats:
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
    result: list[tuple[float, float]] = []
    for i, j in zip(*np.nonzero(_mixed(sheet.real) & _mixed(sheet.imag)), strict=True):
        begin = (float(np.sqrt(amplitudes[i] * amplitudes[i + 1])), float(np.sqrt(f[j] * f[j + 1])))
        spread = (amplitudes[i + 1] / amplitudes[i], f[j + 1] / f[j])
        solution = _refined(block, part, begin, spread)
        if solution is not None and not any(np.allclose(solution, other, rtol=1e-5) for other in result):
            result.append(solution)
    return np.array(sorted(result, key=lambda s: s[1]), dtype=np.float64).reshape(-1, 2)


def _gains(block: DescribedBlock, amplitudes: Floats, f: Floats) -> Complex:
    if not block.frequency_dependent:
        column = np.array([block.gain(a) for a in amplitudes.tolist()], dtype=np.complex128)
        return np.repeat(column[:, None], len(f), axis=1)
    return block.gains(amplitudes[:, None], f[None, :])


def _mixed(values: Floats) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Return which cells have corners on both sides of zero."""
    corners = np.stack([values[:-1, :-1], values[:-1, 1:], values[1:, :-1], values[1:, 1:]])
    return np.asarray((corners.min(axis=0) <= 0.0) & (corners.max(axis=0) >= 0.0))


def _refined(
    block: DescribedBlock, part: LinearPart, begin: tuple[float, float], spread: tuple[float, float]
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

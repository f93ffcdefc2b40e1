"""Blocks whose output depends on where the input came from, however fast: relay with hysteresis, backlash."""

from __future__ import annotations

import cmath
import math
from itertools import pairwise

import numpy as np

from workbench.core.values.arrays import Complex, Floats
from workbench.errors import InputError
from workbench.loops.describing.base import DescribedBlock
from workbench.loops.describing.fourier import series

__all__ = ["BacklashDescribingFunction", "RelayWithHysteresis", "sampled_coefficients"]

_SAMPLES = 4096


def sampled_coefficients(w: Floats, count: int) -> Complex:
    """Return the coefficients 0 … count of equidistant samples of one period.

    Args:
        w: shape (n,).
        count: highest harmonic.
    """
    result: Complex = np.fft.rfft(w)[: count + 1] * (2.0 / len(w))
    result[0] *= 0.5
    return result


class RelayWithHysteresis(DescribedBlock):
    """y = ±level: + once the input exceeds half_width, − once it falls below −half_width.

    N = (4M/πA) e^{−j asin(h/A)} for A > h; a smaller sine never switches, and N = 0 [Gelb & Vander Velde, appendix B].

    Args:
        level: M.
        half_width: h.
    """

    real = False

    def __init__(self, level: float = 1.0, half_width: float = 0.1) -> None:
        if not (level > 0.0 and half_width >= 0.0):
            raise InputError(f"relay with hysteresis: level {level:g} must be positive, half_width not negative")
        self.name = "relay with hysteresis"
        self.level, self.half_width = level, half_width

    def gain(self, amplitude: float, frequency: float = 1.0) -> complex:
        if amplitude <= self.half_width:
            return 0j
        lag = math.asin(self.half_width / amplitude)
        return 4.0 * self.level / (math.pi * amplitude) * cmath.exp(-1j * lag)

    def answer(self, v: Complex, frequency: float, count: int) -> Complex:
        """Return the coefficients; switching is located to 1/4096 of a period and refined linearly."""
        theta = np.linspace(0.0, 2.0 * np.pi, _SAMPLES + 1)
        x = series(v, theta)
        up = _crossings(theta, x, self.half_width)
        down = _crossings(theta, -x, self.half_width)
        result: Complex = np.zeros(count + 1, dtype=np.complex128)
        switches = _alternating(up, down)
        k = np.arange(1, count + 1)
        for (begin, sign), (end, _) in pairwise(switches):
            result[0] += sign * self.level * (end - begin) / (2.0 * np.pi)
            result[1:] += sign * self.level * (np.exp(-1j * k * end) - np.exp(-1j * k * begin)) / (-1j * k * np.pi)
        return result


def _crossings(theta: Floats, x: Floats, level: float) -> list[float]:
    """Return where x rises through a level."""
    i = np.flatnonzero((x[:-1] < level) & (x[1:] >= level))
    part = (level - x[i]) / (x[i + 1] - x[i])
    return [float(t) for t in theta[i] + part * (theta[i + 1] - theta[i])]


def _alternating(up: list[float], down: list[float]) -> list[tuple[float, float]]:
    """Return the effective switches (angle, sign) of one period, the first repeated at the end."""
    every = sorted([(t, 1.0) for t in up] + [(t, -1.0) for t in down])
    kept = [s for s, before in zip(every, [every[-1:], *([e] for e in every)], strict=False) if before[0][1] != s[1]]
    return [*kept, (kept[0][0] + 2.0 * math.pi, kept[0][1])] if kept else []


class BacklashDescribingFunction(DescribedBlock):
    """Play: the output, slope · position, moves only when the input has taken up the gap of ±half_width.

    N in closed form [Slotine & Li, 5.2.1]; a sine smaller than the gap moves nothing.

    Args:
        half_width: b, half the gap.
        slope: k.
    """

    real = False

    def __init__(self, half_width: float = 0.1, slope: float = 1.0) -> None:
        if not half_width > 0.0:
            raise InputError(f"backlash: half_width must be positive, not {half_width:g}")
        self.name = "backlash"
        self.half_width, self.slope = half_width, slope

    def gain(self, amplitude: float, frequency: float = 1.0) -> complex:
        r = self.half_width / amplitude
        if r >= 1.0:
            return 0j
        q = 1.0 - 2.0 * r
        along = (0.5 * math.pi + math.asin(q) + 2.0 * q * math.sqrt(r * (1.0 - r))) / math.pi
        return self.slope * complex(along, -4.0 * r * (1.0 - r) / math.pi)

    def answer(self, v: Complex, frequency: float, count: int) -> Complex:
        x = series(v, np.linspace(0.0, 2.0 * np.pi, _SAMPLES, endpoint=False))
        return sampled_coefficients(self.slope * self._settled(x), count)

    def _settled(self, x: Floats) -> Floats:
        """Return the position over the second of two periods."""
        position, b = float(x[0]), self.half_width
        path = []
        for value in np.tile(x, 2).tolist():
            position = min(max(position, value - b), value + b)
            path.append(position)
        return np.array(path[len(x) :], dtype=np.float64)

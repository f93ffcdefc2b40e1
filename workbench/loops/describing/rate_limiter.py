"""Rate limiter: its describing function depends on amplitude · frequency."""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import brentq

from workbench.core.values.arrays import Complex, Floats
from workbench.errors import InputError
from workbench.loops.describing.base import DescribedBlock
from workbench.loops.describing.fourier import series
from workbench.loops.describing.memory import sampled_coefficients

__all__ = ["RateLimiterDescribingFunction"]

_SAMPLES = 8192
_MOST_PERIODS = 200
_SAME = 1e-6
_TRIANGLE = math.sqrt(1.0 + 0.25 * math.pi**2)  # from here on the output is a triangle
_X, _W = np.polynomial.legendre.leggauss(40)


class RateLimiterDescribingFunction(DescribedBlock):
    """The output follows the input, at most `rate` per second.

    With ρ = ωA/rate: N = 1 for ρ ≤ 1; a triangle, N = (4/πρ) e^{−j acos(π/2ρ)}, for ρ ≥ √(1 + π²/4) = 1.862; between
    them the output follows, leaves the input where that becomes too fast, and meets it again [Duda, Prediction of
    pilot-in-the-loop oscillations due to rate saturation, J. Guidance 20(3), 1997].

    Args:
        rate: [unit of the input / s].
    """

    real = False
    frequency_dependent = True

    def __init__(self, rate: float = 1.0) -> None:
        if not rate > 0.0:
            raise InputError(f"rate limiter: rate must be positive, not {rate:g}")
        self.name = "rate limiter"
        self.rate = rate

    def gain(self, amplitude: float, frequency: float = 1.0) -> complex:
        ratio = 2.0 * math.pi * frequency * amplitude / self.rate
        if ratio <= 1.0:
            return 1.0 + 0j
        if ratio >= _TRIANGLE:
            lag = math.acos(0.5 * math.pi / ratio)
            return 4.0 / (math.pi * ratio) * complex(math.cos(lag), -math.sin(lag))
        return _partly(ratio)

    def answer(self, v: Complex, frequency: float, count: int) -> Complex:
        x = series(v, np.linspace(0.0, 2.0 * np.pi, _SAMPLES, endpoint=False))
        return sampled_coefficients(self._settled(x, self.rate / frequency / _SAMPLES), count)

    @staticmethod
    def _settled(x: Floats, most: float) -> Floats:
        """Return the output over a period that is like the one before, moving by `most` per sample."""
        y, values = float(np.mean(x)), x.tolist()
        path: list[float] = []
        for _ in range(_MOST_PERIODS):
            before, path = y, []
            for value in values:
                y += min(max(value - y, -most), most)
                path.append(y)
            if abs(y - before) < _SAME * most:
                break
        return np.array(path, dtype=np.float64)


def _partly(ratio: float) -> complex:
    """Return N where the output leaves a unit sine at the angle `off` and meets it again at `on`."""
    off = math.pi - math.acos(1.0 / ratio)  # falling too fast from here on

    def line(t: float) -> float:
        return math.sin(off) - (t - off) / ratio

    # Close to ρ = 1 the two meet again soon after the steepest fall at π.
    on = float(brentq(lambda t: math.sin(t) - line(t), math.pi + 1e-12 + 0.5 * (math.pi - off), 2.0 * math.pi))
    half = _integral(on - math.pi, off, math.sin) + _integral(off, on, line)
    return half * 2.0 / math.pi * 1j


def _integral(low: float, high: float, function: object) -> complex:
    """Return ∫ function(θ) e^{−jθ} dθ."""
    theta = 0.5 * (high + low) + 0.5 * (high - low) * _X
    values = np.array([function(t) for t in theta.tolist()])  # type: ignore[operator]  # a function of an angle
    return complex(0.5 * (high - low) * np.sum(_W * values * np.exp(-1j * theta)))

"""Margins of a loop transfer that is known at single frequencies."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.optimize import brentq

from workbench.analysis.loop.margins import GainCrossover, Margins, PhaseCrossover, disk_of
from workbench.analysis.loop.stability import BORDER, STABLE, UNKNOWN, UNSTABLE, Stability
from workbench.core.linear import Complex
from workbench.session.base import Floats

__all__ = ["curve_margins"]

_FINE = 24  # looked at between two neighbouring frequencies


def curve_margins(
    frequency_hz: Floats, value: Complex, *, linear: Margins | None = None, stability: Stability | None = None
) -> Margins:
    """Return the margins of a measured loop transfer, interpolated in log gain and phase over log frequency.

    Only what lies between the lowest and the highest frequency is seen. Stability cannot be read off a curve alone. The
    closed loop's unstable poles are counted by Nyquist's criterion as against the linear loop, whose number is known:
    each crossing of the negative real axis left of -1 upwards adds two, each downwards takes two away.

    Args:
        frequency_hz: rising, shape (k,) [Hz].
        value: L there, shape (k,).
        linear: margins of the linear loop at the operating point, if known.
        stability: of that loop.
    """
    curve = _Curve(frequency_hz, value)
    phase = tuple(curve.phase_crossovers())
    verdict, words = _verdict(phase, frequency_hz, linear, stability)
    grid, fine = curve.fine()
    s, difference, t = (np.abs(x) for x in (1.0 / (1.0 + fine), (1.0 - fine) / (1.0 + fine), fine / (1.0 + fine)))
    at = {name: _top(grid, x) for name, x in (("s", s), ("d", difference), ("t", t))}
    stable = verdict in (STABLE, UNKNOWN) and len(grid) > 0
    return Margins(
        verdict=verdict,
        words=words,
        phase_crossovers=phase,
        gain_crossovers=tuple(curve.gain_crossovers()),
        disk=disk_of(*at["d"]) if stable else None,
        peak_sensitivity=at["s"][0],
        peak_sensitivity_hz=at["s"][1],
        peak_complementary=at["t"][0],
        peak_complementary_hz=at["t"][1],
        everywhere=False,
    )


class _Curve:
    """Log gain and unwrapped phase over log frequency, monotone between the points (no overshoot of its own)."""

    def __init__(self, frequency_hz: Floats, value: Complex) -> None:
        good = np.isfinite(value) & (np.abs(value) > 0.0)
        self.x = np.log(frequency_hz[good])
        self.gain = np.log(np.abs(value[good]))
        self.phase = np.unwrap(np.angle(value[good]))

    def _interpolant(self, y: Floats) -> Callable[[float], float]:
        made = PchipInterpolator(self.x, y)
        return lambda x: float(made(x))

    def _roots(self, y: Floats, level: float) -> list[float]:
        """Return where y crosses a level: x."""
        if len(self.x) < 2:
            return []
        between = self._interpolant(y - level)
        v = y - level
        crossed = np.flatnonzero((v[:-1] < 0.0) != (v[1:] < 0.0))
        return [self._root(between, float(self.x[i]), float(self.x[i + 1])) for i in crossed]

    def _root(self, between: Callable[[float], float], a: float, b: float) -> float:
        # A value of exactly 0 at an end is no change of sign there.
        if between(a) == 0.0 or between(b) == 0.0:
            return a if between(a) == 0.0 else b
        return float(brentq(between, a, b, xtol=1e-12))

    def at(self, x: float) -> complex:
        return complex(np.exp(self._interpolant(self.gain)(x) + 1j * self._interpolant(self.phase)(x)))

    def gain_crossovers(self) -> list[GainCrossover]:
        return [GainCrossover.of(float(np.exp(x)), self.at(x)) for x in self._roots(self.gain, 0.0)]

    def phase_crossovers(self) -> list[PhaseCrossover]:
        found = []
        low, high = self.phase.min(initial=0.0), self.phase.max(initial=0.0)
        for k in range(int(np.floor(low / np.pi)) - 1, int(np.ceil(high / np.pi)) + 1):
            for x in self._roots(self.phase, np.pi * k) if k % 2 else ():
                slope = self._interpolant(self.phase)(x + 1e-6) - self._interpolant(self.phase)(x - 1e-6)
                # Seen from -180° a rising angle leads below the axis.
                found.append(PhaseCrossover(float(np.exp(x)), 1.0 / abs(self.at(x)), slope < 0.0))
        return sorted(found, key=lambda c: c.frequency_hz)

    def fine(self) -> tuple[Floats, Complex]:
        if len(self.x) < 2:
            return np.exp(self.x), np.exp(self.gain + 1j * self.phase).astype(np.complex128)
        parts = np.arange(_FINE) / _FINE
        x = np.append((self.x[:-1, None] + np.diff(self.x)[:, None] * parts).ravel(), self.x[-1])
        log = PchipInterpolator(self.x, self.gain)(x) + 1j * PchipInterpolator(self.x, self.phase)(x)
        return np.exp(x), np.exp(log)


def _top(grid: Floats, values: Floats) -> tuple[float, float]:
    if not len(grid):
        return np.nan, np.nan
    k = int(np.argmax(values))
    return float(values[k]), float(grid[k])


def _verdict(
    phase: tuple[PhaseCrossover, ...], frequency_hz: Floats, linear: Margins | None, stability: Stability | None
) -> tuple[str, str]:
    why = _why_unknown(frequency_hz, linear, stability)
    count = (
        0
        if why or linear is None or stability is None
        else stability.unstable + 2 * (_turns(phase) - _turns(linear.phase_crossovers))
    )
    if count < 0:
        why = "its open loop is not the linear one's"
    if why:
        return UNKNOWN, f"whether the quasi-linear loop is stable is not known: {why}"
    if count:
        return UNSTABLE, f"the quasi-linear loop has {count} unstable poles; margins mean nothing then"
    return STABLE, "the quasi-linear loop is stable, by Nyquist's criterion from the linear one"


def _why_unknown(frequency_hz: Floats, linear: Margins | None, stability: Stability | None) -> str:
    """Return why poles cannot be counted; empty if they can."""
    if len(frequency_hz) < 2:
        return "fewer than two points have a value"
    if linear is None or stability is None:
        return "there is no linear loop to count from"
    if stability.verdict == BORDER:
        return stability.words
    left = [c.frequency_hz for c in linear.phase_crossovers if c.factor < 1.0]
    if any(not frequency_hz.min() <= f <= frequency_hz.max() for f in left):
        return "the band leaves out phase crossovers of the linear loop"
    return ""


def _turns(crossovers: tuple[PhaseCrossover, ...]) -> int:
    """Return crossings left of -1: upwards less downwards."""
    return sum(1 if c.upwards else -1 for c in crossovers if c.factor < 1.0)

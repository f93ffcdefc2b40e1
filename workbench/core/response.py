"""Frequency responses: gain and phase, what lies between their frequencies, crossings; one place for all analyses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from workbench.core.matrices import Complex, Floats

__all__ = ["Response", "decibels", "degrees", "difference", "follow_phase", "unwrapped"]

# A jump of the phase by more than this upwards is a turn of −360° (1.74533 rad in the source report).
_JUMP_DEG = 100.0
_SAME = 1e-12  # log frequencies that differ by less are one


def decibels(values: ArrayLike) -> Floats:
    """Return 20·log10|v| [dB], same shape; −inf for 0.

    Args:
        values: real or complex, of any shape.
    """
    with np.errstate(divide="ignore"):
        return np.asarray(20.0 * np.log10(np.abs(values)), dtype=np.float64)


def degrees(values: ArrayLike) -> Floats:
    """Return the angles in (−180°, 180°] [deg], same shape.

    Args:
        values: complex, of any shape.
    """
    return np.asarray(np.degrees(np.angle(np.asarray(values, dtype=np.complex128))), dtype=np.float64)


def follow_phase(value: Complex) -> Floats:
    """Return the phase followed along rising frequency [deg], shape (k,); NaN for NaN and 0, which are passed over.

    Of all angles φ + n·360° the one in (last − 260°, last + 100°] is taken, last being the phase of the point before,
    0 at first. That is the published rule, an upward jump of more than 100° means one turn down, carried on over
    several turns and made single-valued in the other direction.

    Args:
        value: of the response, shape (k,).
    """
    return _phase(value, lambda a: a - 360.0 * np.cumsum(np.ceil((np.diff(a, prepend=0.0) - _JUMP_DEG) / 360.0)))


def unwrapped(value: Complex) -> Floats:
    """Return the phase without jumps of more than 180° [deg], shape (k,); NaN for NaN and 0, which are passed over.

    For curves so dense that none of their steps is a turn.

    Args:
        value: of the response, shape (k,).
    """
    return _phase(value, lambda a: np.unwrap(a, period=360.0))


def _phase(value: Complex, rule: Callable[[Floats], Floats]) -> Floats:
    phase, known = np.full(np.shape(value), np.nan), _known(value)
    phase[known] = rule(degrees(value[known]))
    return phase


def _known(value: Complex) -> NDArray[np.bool_]:
    return np.asarray(np.isfinite(value) & (value != 0.0))


def difference(one: ArrayLike, other: ArrayLike) -> tuple[Floats, Floats]:
    """Return by how much gain [dB] and phase, within ±180 [deg], of two responses differ; NaN where one has none.

    Args:
        one: of any shape.
        other: what is taken off, of the same shape.
    """
    with np.errstate(all="ignore"):
        ratio = np.asarray(one, dtype=np.complex128) / np.asarray(other, dtype=np.complex128)
    ratio = np.where(_known(ratio), ratio, np.nan)
    return decibels(ratio), degrees(ratio)


@dataclass(frozen=True, eq=False)
class Response:
    """A frequency response from one input to one output.

    Between its frequencies the logarithm of the gain and the phase are interpolated over the logarithm of the
    frequency, monotone between two points (no overshoot of its own).

    Attributes:
        frequency_hz: rising, shape (k,) [Hz].
        value: shape (k,); NaN where there is none.
    """

    frequency_hz: Floats
    value: Complex

    @property
    def gain_db(self) -> Floats:
        """Gain, shape (k,) [dB]; −inf where it is 0."""
        return decibels(self.value)

    @property
    def phase_deg(self) -> Floats:
        """Phase followed along the frequency, shape (k,) [deg]."""
        return follow_phase(self.value)

    @cached_property
    def _log(self) -> tuple[Floats, Complex]:
        """Log of the frequency, and of the values with their phase unwrapped, where they have any."""
        known = _known(self.value)
        phase = np.radians(unwrapped(self.value[known]))
        return np.log(self.frequency_hz[known]), np.asarray(np.log(np.abs(self.value[known])) + 1j * phase)

    def between(self, frequency_hz: ArrayLike) -> Complex:
        """Return the interpolated response, shape of the frequencies; NaN outside of the first and the last value.

        Args:
            frequency_hz: of any shape [Hz].
        """
        x = np.log(np.asarray(frequency_hz, dtype=np.float64))
        inside = np.clip(x, *self._log[0][[0, -1]])
        x = np.where(np.abs(x - inside) < _SAME, inside, x)
        return np.asarray(np.exp(self._shape(self._log[1].real)(x) + 1j * self._shape(self._log[1].imag)(x)))

    def _shape(self, y: Floats) -> Callable[[ArrayLike], Floats]:
        from scipy.interpolate import PchipInterpolator  # noqa: PLC0415  slow to import

        made: Callable[[ArrayLike], Floats] = PchipInterpolator(self._log[0], y, extrapolate=False)
        return made

    def finer(self, times: int) -> Response:
        """Return the interpolated response at further frequencies between neighbours.

        Args:
            times: into so many parts each interval is divided.
        """
        x, log = self._log
        if len(x) < 2:
            return Response(np.exp(x), np.exp(log))
        fine = np.append((x[:-1, None] + np.diff(x)[:, None] * np.arange(times) / times).ravel(), x[-1])
        return Response(np.exp(fine), self.between(np.exp(fine)))

    def gain_crossings(self) -> list[float]:
        """Return the frequencies at which the interpolated gain is 1, rising [Hz]."""
        return self._roots(self._log[1].real, 0.0)

    def phase_crossings(self) -> list[tuple[float, bool]]:
        """Return the frequencies at which the interpolated response is real and negative, rising [Hz].

        Each with whether it crosses the axis upwards as the frequency rises.
        """
        phase = self._log[1].imag
        low, high = phase.min(initial=0.0), phase.max(initial=0.0)
        turns = [k for k in range(int(np.floor(low / np.pi)) - 1, int(np.ceil(high / np.pi)) + 1) if k % 2]
        found = []
        for f in (f for k in turns for f in self._roots(phase, np.pi * k)):
            ends = np.clip(np.log(f) + np.array([-1e-6, 1e-6]), *self._log[0][[0, -1]])
            before, after = self._shape(phase)(ends)
            found.append((f, bool(after < before)))  # seen from −180° a rising angle leads below the axis
        return sorted(found)

    def _roots(self, y: Floats, level: float) -> list[float]:
        x, v = self._log[0], y - level
        if len(x) < 2:
            return []
        crossed = np.flatnonzero((v[:-1] < 0.0) != (v[1:] < 0.0))
        between = self._shape(v)
        return [float(np.exp(_root(between, float(x[i]), float(x[i + 1])))) for i in crossed]


def _root(between: Callable[[ArrayLike], Floats], a: float, b: float) -> float:
    """Return where the function is 0; a value of exactly 0 at an end is not a change of sign."""
    from scipy.optimize import brentq  # noqa: PLC0415  slow to import

    ends = [end for end in (a, b) if float(between(end)) == 0.0]
    return ends[0] if ends else float(brentq(lambda x: float(between(x)), a, b, xtol=1e-12))

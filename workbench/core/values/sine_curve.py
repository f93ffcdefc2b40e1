"""Gain and phase of a linear model at any frequency: no extreme between points is overlooked, no turn is lost."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.decibels import decibels, degrees, unwrapped
from workbench.core.values.poles import ON_BORDER

__all__ = ["SineCurve"]

_DENSE = 60  # points per decade between the resonances
_PARTS = 8  # of each neighbourhood of an extreme, in each round
_ROUNDS = 5  # 8⁻⁵ of a distance of 4 %: the value at an extreme, flat there, is known to all digits
_PER_TURN = 16  # points in a turn of the slowest-turning pair of echoes of a delay
_ECHOES = 2000  # turns of a delay that are followed; above, its poles and zeros lie closer than a picture shows
_SMALLEST = 1e-300
_FLAT = 1e-9  # dB or deg: what changes by less is rounding


@dataclass(frozen=True, eq=False)
class SineCurve:
    """The response of one output to a sine at one input.

    Attributes:
        respond: frequencies [Hz], shape (k,), → response, shape (k,).
        poles: as those of a continuous model, without those that are 0 within their error, shape (n,) [1/s].
        zeros: likewise, shape (m,).
        highest_hz: half the sampling rate; infinite: of a continuous model [Hz].
        delays: transport delays, that make poles and zeros without end [s].
        rational: whether the response is K·∏(s − z)/∏(s − p) with these poles and zeros, and others at 0.
    """

    respond: Callable[[Floats], Complex]
    poles: Complex
    zeros: Complex
    highest_hz: float = math.inf
    delays: Floats = field(default_factory=lambda: np.zeros(0))
    rational: bool = True

    @property
    def _roots(self) -> Complex:
        return np.concatenate([self.zeros, self.poles])

    @cached_property
    def band(self) -> tuple[float, float]:
        """Frequencies around the poles [Hz]."""
        rates = np.abs(self.poles) / (2.0 * np.pi)
        return (float(rates.min()) / 100.0, float(rates.max()) * 10.0) if len(rates) else (0.01, 100.0)

    def grid(self, at: Sequence[float] = ()) -> Floats:
        """Return frequencies as far as the band and those asked for, rising, between which nothing turns [Hz].

        A pole or zero σ ± jω turns the response within |σ| of ω: there the points lie in steps of a third of |σ|, then
        three times as far, up to the spacing of the others.

        Args:
            at: frequencies that are in it, too [Hz].
        """
        last = self.highest_hz * (1.0 - 1e-6)
        low, high = min([self.band[0], *at]), min(max([self.band[1], *at]), last)
        count = max(2, math.ceil(_DENSE * math.log10(high / low)) + 1) if high > low else 0
        every = [np.geomspace(low, high, count), np.asarray(at, dtype=np.float64), *map(self._near, self._roots)]
        for delay in self.delays[self.delays > 0.0].tolist():
            turns = min(high * delay, _ECHOES)
            every.append(np.arange(1, int(_PER_TURN * turns) + 1) / (_PER_TURN * delay))
        f = np.unique(np.concatenate(every))
        return np.asarray(f[(f >= low) & (f <= max(high, low)) & (f <= last)])

    def _near(self, root: complex) -> Floats:
        """Return frequencies around a pole or zero [Hz]."""
        centre, size = abs(root.imag), abs(root)
        least = max(abs(root.real), 4.0 * np.finfo(float).eps * size) / 3.0
        width = size / _DENSE
        steps = least * 3.0 ** np.arange(max(1, math.ceil(math.log(max(width / least, 1.0), 3.0)) + 2))
        resonance = math.sqrt(max(root.imag**2 - root.real**2, 0.0))  # where a lone pair is largest
        found = np.concatenate([[centre, size, resonance], centre - steps, centre + steps]) / (2.0 * np.pi)
        return np.asarray(found[found > 0.0])

    def gain(self, frequency_hz: Floats) -> Floats:
        """Return the gain [dB], shape (k,); infinite on a pole.

        Args:
            frequency_hz: shape (k,).
        """
        return np.asarray(decibels(self._sized(self.respond(frequency_hz))))

    @staticmethod
    def _sized(value: Complex) -> Complex:
        value = np.where(np.isnan(value), np.inf, value)
        return np.where(np.abs(value) < _SMALLEST, _SMALLEST, value)

    def phase(self, frequency_hz: Floats) -> Floats:
        """Return the phase [deg], shape (k,), followed from that of K·sᵐ, which the response is at low frequencies.

        That is 90° for each zero at 0, −90° for each pole there, and 180° more for a negative K. A pair on the
        imaginary axis counts as left of it.

        Args:
            frequency_hz: shape (k,).
        """
        value = self._sized(self.respond(frequency_hz))
        known = np.isfinite(value)
        angle = degrees(np.where(known, value, 1.0))
        near = self._turned(frequency_hz) if self.rational else self._followed(frequency_hz, value)
        return np.asarray(np.where(known, angle + 360.0 * np.round((near - angle) / 360.0), near))

    @property
    def _first(self) -> float:
        """A frequency below all poles and zeros but those at 0 [Hz]."""
        sizes = np.abs(self._roots)
        return min(self.band[0], float(sizes[sizes > 0.0].min(initial=math.inf)) / (200.0 * np.pi))

    @cached_property
    def _begin(self) -> float:
        """The phase at that frequency [deg]."""
        first = self._first
        value = self._sized(self.respond(np.array([first, 2.0 * first])))
        if not np.isfinite(value).all():
            return 0.0
        turned = float(self._turn(np.array([first]))[0])
        power = round(math.log2(abs(value[1]) / abs(value[0])))
        rest = value[0] * (-1j) ** power * np.exp(-1j * math.radians(turned))
        return 90.0 * power + turned + (180.0 if rest.real < 0.0 else 0.0)

    def _turned(self, frequency_hz: Floats) -> Floats:
        """Return the phase as the poles and zeros have it [deg], shape (k,)."""
        return self._begin + self._turn(frequency_hz) - self._turn(np.array([self._first]))

    def _turn(self, frequency_hz: Floats) -> Floats:
        """Return by how much poles and zeros have turned the response from frequency 0 on [deg], shape (k,)."""
        s = 2j * np.pi * np.asarray(frequency_hz, dtype=np.float64)
        result = np.zeros(len(s))
        for sign, roots in ((1.0, self.zeros), (-1.0, self.poles)):
            for root in roots.tolist():
                side = -1.0 if root.real > ON_BORDER * abs(root) else 1.0
                place = -abs(side * root.real) + 1j * side * root.imag  # s − z = −(z − s) at the right
                result += sign * (np.angle(side * s - place) - np.angle(-place))
        return np.degrees(result)

    @cached_property
    def _path(self) -> tuple[Floats, Complex, Floats]:
        """Frequencies [Hz], the response there and its phase [deg], followed from the lowest on."""
        f = self.grid((self._first,))
        value = self._sized(self.respond(f))
        known = np.isfinite(value)
        f, value = f[known], value[known]
        phase = unwrapped(value)
        return f, value, phase + 360.0 * np.round((self._begin - phase[0]) / 360.0)

    def _followed(self, frequency_hz: Floats, value: Complex) -> Floats:
        """Return the phase near to that of the last point of a dense path [deg], shape (k,)."""
        f, path, phase = self._path
        k = np.clip(np.searchsorted(f, frequency_hz, side="right") - 1, 0, len(f) - 1)
        return np.asarray(phase[k] + degrees(np.where(np.isfinite(value), value, path[k]) / path[k]))

    def refined(self, frequency_hz: Floats, margin: Callable[[Floats], Floats]) -> Floats:
        """Return frequencies with those at which a function is least among its neighbours, rising [Hz].

        Args:
            frequency_hz: a `grid`, or a part of it with its ends, shape (k,).
            margin: frequencies → values.
        """
        # Those that rounding alone tells apart would hide what lies beside them.
        f = frequency_hz[np.append(np.diff(frequency_hz) > 8.0 * np.finfo(float).eps * frequency_hz[1:], True)]
        last = len(f) - 1
        least = _with_least(margin(f)) if last > 0 else np.zeros(0, dtype=np.intp)
        if not len(least):
            return frequency_hz
        low, top, high = f[np.maximum(least - 1, 0)], f[least], f[np.minimum(least + 1, last)]
        parts, rows = np.linspace(0.0, 1.0, 2 * _PARTS + 1), np.arange(len(least))
        for _ in range(_ROUNDS):
            fine = low[:, None] * (high / low)[:, None] ** parts
            best = np.argmin(margin(fine.ravel()).reshape(fine.shape), axis=1)
            low, top, high = (fine[rows, k] for k in (np.maximum(best - 1, 0), best, np.minimum(best + 1, 2 * _PARTS)))
        return np.unique(np.concatenate([frequency_hz, top]))


def _with_least(margin: Floats) -> NDArray[np.intp]:
    """Return where values are least among their neighbours, by more than rounding.

    Args:
        margin: shape (k,).
    """
    padded = np.concatenate([margin[1:2], margin, margin[-2:-1]])
    before, after = padded[:-2], padded[2:]
    rises = np.maximum(before, after) - margin > _FLAT * np.maximum(1.0, np.abs(margin))
    return np.flatnonzero((margin <= before) & (margin <= after) & rises)

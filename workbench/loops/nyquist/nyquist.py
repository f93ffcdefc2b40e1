"""The public function: all crossings of a loop."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import brentq

from workbench.core.machine.blas import one_thread
from workbench.core.values.arrays import Floats
from workbench.core.values.linear import LinearPart
from workbench.errors import InputError
from workbench.loops.describing.base import HARMONICS, DescribedBlock
from workbench.loops.describing.measured import MeasuredBlock
from workbench.loops.nyquist.crossings import AxisCrossing, axis_crossings, intersections
from workbench.loops.nyquist.grid import adaptive_grid
from workbench.loops.nyquist.part import part_of
from workbench.loops.nyquist.result import Crossing, NyquistResult
from workbench.requests.decorator import with_origin

if TYPE_CHECKING:
    import control

    from workbench.point.lin.state_space import LinearModel

__all__ = ["AMPLITUDES", "BAND", "nyquist"]

BAND = (0.01, 1000.0)  # [Hz]
AMPLITUDES = (1e-4, 1e4)
_PER_DECADE = 20
_ASIDE = 1e-2  # relative change of a gain at which the poles are counted, less where another crossing is near
_STANDS = 1e-12  # relative: N that changes by less between two amplitudes stands still


@with_origin()
def nyquist(
    loop: LinearPart | LinearModel | control.StateSpace | control.TransferFunction,
    block: DescribedBlock | None = None,
    *,
    band: tuple[float, float] = BAND,
    amplitudes: tuple[float, float] | Sequence[float] | Floats = AMPLITUDES,
    name: str = "loop",
) -> NyquistResult:
    """Return the Nyquist curve of a loop with negative feedback, 1 + N·L = 0, and all its crossings in a band.

    Frequencies are adaptive (see `workbench.loops.nyquist.grid`), so that no crossing is missed for a lightly
    damped mode; each is refined to rounding. At each crossing the poles are counted with the block replaced by a gain
    a little below and above: that is the criterion of stability, and it counts all poles, not the pair that crosses
    alone.

    Not for a sampled linear part, nor for a block that depends on more than amplitude and frequency of a sine.

    Args:
        loop: L, one input and one output, continuous.
        block: N; None: crossings of the negative real axis alone.
        band: lowest and highest frequency [Hz].
        amplitudes: lowest and highest amplitude looked at, or all of them, rising.
        name: name of the loop.

    Raises:
        InputError: L is sampled or has several inputs or outputs, a band or amplitudes that do not rise.

    Source: Slotine & Li, Applied Nonlinear Control, 5.4 (describing function analysis).

    Examples:
        An ideal relay in a loop with 1/(s(s + 1)(s + 2)) oscillates at √2 rad/s with the amplitude 2/(3π).

        >>> import control
        >>> linear = control.tf([1], [1, 3, 2, 0])
        >>> (crossing,) = wb.nyquist(linear, wb.standard_block("relay")).crossings
        >>> print(f"{2 * math.pi * crossing.frequency_hz:.4f} rad/s, {crossing.amplitude:.4f}")
        1.4142 rad/s, 0.2122
    """
    with one_thread():
        return _nyquist(part_of(loop), block, _checked(band), _grid(amplitudes), name)


def _nyquist(
    part: LinearPart, block: DescribedBlock | None, band: tuple[float, float], a: Floats, name: str
) -> NyquistResult:
    f, value = adaptive_grid(part, band)
    real_axis = [c for c in axis_crossings(part) if band[0] <= c.frequency <= band[1]]
    sides = _LoopParts(part, real_axis)
    if block is None:
        result, gains = [sides.plain(c) for c in real_axis if c.gain >= 0.0], np.ones(0, dtype=np.complex128)
    elif block.real and not block.frequency_dependent:
        gains = np.array([block.gain(x) for x in a.tolist()], dtype=np.complex128)
        result = [c for axis in real_axis for c in _with_amplitudes(axis, block, a, gains.real, sides)]
    else:
        pairs = intersections(block, part, f, value, a)
        result = [_complex_crossing(part, block, x, y) for x, y in pairs.tolist()]
        result += [sides.plain(c) for c in real_axis if c.gain >= 0.0]
        where = result[0].frequency_hz if result else float(np.sqrt(band[0] * band[1]))
        gains = np.array([block.gain(x, where) for x in a.tolist()], dtype=np.complex128)
    result = [c for c in result if c.gain or c.unstable_below != c.unstable_above]  # poles that L does not show
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = np.where(gains == 0.0, complex(np.nan), -1.0 / gains)
    return NyquistResult(
        name=name,
        block="" if block is None else block.name,
        frequency_hz=f,
        response=value,
        crossings=tuple(sorted(result, key=lambda c: c.frequency_hz)),
        amplitude=a if block is not None else np.ones(0),
        minus_inverse=inverse.astype(np.complex128),
        unstable_open=part.unstable(0j),
    )


def _checked(band: tuple[float, float]) -> tuple[float, float]:
    if not (0.0 < band[0] < band[1] < np.inf):
        raise InputError(f"band {band[0]:g}:{band[1]:g} Hz: both must be positive, the lower first")
    return band


def _grid(amplitudes: tuple[float, float] | Sequence[float] | Floats) -> Floats:
    a = np.asarray(amplitudes, dtype=np.float64)
    if len(a) < 2 or not (a[0] > 0.0 and np.all(np.diff(a) > 0.0) and np.isfinite(a).all()):
        raise InputError("amplitudes: give two or more positive rising numbers")
    if len(a) > 2:
        return a
    count = int(np.ceil(np.log10(a[1] / a[0]) * _PER_DECADE)) + 1
    return np.asarray(np.geomspace(a[0], a[1], max(count, 10)), dtype=np.float64)


class _LoopParts:
    """Counts poles on both sides of a crossing's gain, close enough that no other crossing lies between."""

    def __init__(self, part: LinearPart, crossings: Sequence[AxisCrossing]) -> None:
        self.part = part
        self._gains = np.unique(np.array([0.0, *(c.gain for c in crossings)]))

    def count(self, gain: float) -> tuple[int, int]:
        others = np.abs(self._gains - gain)
        others = others[others > 1e-9 * max(abs(gain), 1e-300)]
        nearest = float(others.min()) if len(others) else 1.0
        aside = min(_ASIDE * abs(gain), 0.5 * nearest) if gain else 0.01 * nearest
        return self.part.unstable(complex(gain - aside)), self.part.unstable(complex(gain + aside))

    def plain(self, c: AxisCrossing) -> Crossing:
        below, above = self.count(c.gain)
        return Crossing(
            frequency_hz=c.frequency, real=c.real if c.gain else -np.inf, gain=c.gain,
            unstable_below=below, unstable_above=above,
        )  # fmt: skip


def _with_amplitudes(
    axis: AxisCrossing, block: DescribedBlock, a: Floats, gains: Floats, sides: _LoopParts
) -> list[Crossing]:
    """Return a crossing of the real axis once for each amplitude at which N is its gain."""
    bare = sides.plain(axis)
    roots = _amplitudes(axis.gain, block, a, gains)
    if not roots:
        return [bare] if axis.gain > 0.0 else []
    result = []
    for amplitude in roots:
        rising = block.gain(amplitude * 1.001).real > block.gain(amplitude * 0.999).real
        smaller, greater = bare.unstable_below, bare.unstable_above
        if not rising:
            smaller, greater = greater, smaller
        fields = {
            **vars(bare),
            "amplitude": amplitude,
            "stable": greater == 0 and smaller > 0,
            "distortion": _distortion(sides.part, block, amplitude, axis.frequency),
        }
        result.append(Crossing(**fields))
    return result


def _amplitudes(gain: float, block: DescribedBlock, a: Floats, gains: Floats) -> list[float]:
    """Return the amplitudes at which N passes a gain."""
    distance = gains - gain

    known = dict(zip(a.tolist(), distance.tolist(), strict=True))  # evaluated again, rounding may be another

    def off(x: float) -> float:
        return known[x] if x in known else block.gain(x).real - gain

    apart = np.maximum(np.abs(distance[:-1]), np.abs(distance[1:])) > _STANDS * abs(gain)
    result = [
        float(brentq(off, a[i], a[i + 1], xtol=1e-15 * a[i], rtol=1e-14))
        for i in np.flatnonzero((distance[:-1] * distance[1:] < 0.0) & apart).tolist()
    ]
    exact = [float(a[i]) for i in np.flatnonzero(distance == 0.0).tolist()]
    # On a plateau of N, such as that of a saturation, every amplitude would do: none is a limit cycle.
    return sorted(result + (exact if len(exact) == 1 else []))


def _complex_crossing(part: LinearPart, block: DescribedBlock, amplitude: float, frequency: float) -> Crossing:
    value = part.at(frequency)
    less, more = (block.gain(amplitude * (1.0 + e), frequency) for e in (-_ASIDE, _ASIDE))
    if not (np.isfinite(less) and np.isfinite(more)):  # the last measured amplitude
        less = more = block.gain(amplitude, frequency)
    smaller, greater = part.unstable(less, frequency), part.unstable(more, frequency)
    below, above = (smaller, greater) if abs(more) >= abs(less) else (greater, smaller)
    return Crossing(
        frequency_hz=frequency,
        real=value.real,
        imag=value.imag,
        gain=1.0 / abs(value),
        amplitude=amplitude,
        stable=greater == 0 and smaller > 0,
        unstable_below=below,
        unstable_above=above,
        distortion=_distortion(part, block, amplitude, frequency),
    )


def _distortion(part: LinearPart, block: DescribedBlock, amplitude: float, frequency: float) -> float | None:
    """Return the largest harmonic at the block's input over the fundamental, the loop opened there."""
    if isinstance(block, MeasuredBlock):
        w = block.harmonic_sizes(amplitude, frequency) * abs(block.gain(amplitude, frequency)) * amplitude
    else:
        w = np.abs(block.harmonics(amplitude, frequency))
    back = np.abs(part.response(frequency * np.arange(2.0, HARMONICS + 1))) * w[2:]
    return float(np.max(back)) / amplitude if np.isfinite(back).all() else None

"""Frequencies dense enough that no crossing is missed, however lightly damped a mode is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.linear import LinearPart

__all__ = ["adaptive_grid"]

_PER_DECADE = 40
_TURN = np.radians(3.0)  # largest change of phase between neighbours
_CORNER = np.radians(10.0)  # largest angle between neighbouring chords
_SHORT = 5e-3  # of the distance from the origin: chords that may meet at any angle
_NARROWEST = 1e-10  # relative distance of neighbours
_ROUNDS = 40
_MOST = 200_000
_AROUND = np.array([-10.0, -3.0, -1.0, -0.3, 0.0, 0.3, 1.0, 3.0, 10.0])


def adaptive_grid(part: LinearPart, band: tuple[float, float]) -> tuple[Floats, Complex]:
    """Return frequencies [Hz] and L there.

    The grid begins around each pole, in units of its damping. Then it is halved wherever the phase turns by more than
    3°, and where the curve has a corner of more than 10°.

    Args:
        part: the linear part.
        band: lowest and highest frequency [Hz].
    """
    low, high = band
    count = max(2, int(np.ceil(np.log10(high / low) * _PER_DECADE)))
    f = np.concatenate([np.geomspace(low, high, count + 1), _landmarks(part)])
    f = np.unique(f[(f >= low) & (f <= high)])
    value = part.response(f)
    for _ in range(_ROUNDS):
        with np.errstate(all="ignore"):
            turn = np.abs(np.angle(value[1:] / value[:-1]))
        wide = (~(turn <= _TURN) | _cornered(value)) & (np.diff(f) > _NARROWEST * f[1:])
        if not wide.any() or len(f) > _MOST:
            break
        between = 0.5 * (f[:-1] + f[1:])[wide]
        f, value = _merged(f, value, between, part.response(between))
    return f, value


def _cornered(value: Complex) -> NDArray[np.bool_]:
    """Return which chords meet a neighbour at an angle, shape (k − 1,)."""
    with np.errstate(all="ignore"):
        chord = np.diff(value)
        angle = np.abs(np.angle(chord[1:] / chord[:-1]))
        long = np.abs(chord) > _SHORT * np.abs(value[:-1])
    corner = angle > _CORNER
    result = np.zeros(len(chord), dtype=bool)
    result[1:] |= corner
    result[:-1] |= corner
    return np.asarray(result & long)


def _merged(f: Floats, value: Complex, more: Floats, there: Complex) -> tuple[Floats, Complex]:
    every = np.concatenate([f, more])
    order = np.argsort(every, kind="stable")
    return every[order], np.concatenate([value, there])[order]


def _landmarks(part: LinearPart) -> Floats:
    """Return frequencies around poles [Hz]."""
    poles = part.continuous_poles
    width = np.maximum(np.abs(poles.real), 1e-9 * np.abs(poles))
    around: Floats = (np.abs(poles.imag)[:, None] + width[:, None] * _AROUND).ravel() / (2.0 * np.pi)
    return around

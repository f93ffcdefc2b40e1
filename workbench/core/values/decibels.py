"""Complex numbers as decibels and degrees, and phases followed along the frequency."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from workbench.core.values.arrays import Complex, Floats

__all__ = ["decibels", "degrees", "difference", "follow_phase", "known", "unwrapped"]

# A jump of the phase by more than this upwards is a turn of −360° (1.74533 rad in the source report).
_JUMP_DEG = 100.0


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
    phase, has = np.full(np.shape(value), np.nan), known(value)
    phase[has] = rule(degrees(value[has]))
    return phase


def known(value: Complex) -> NDArray[np.bool_]:
    """Return where there is a value that has a gain in decibels and a phase, same shape."""
    return np.asarray(np.isfinite(value) & (value != 0.0))


def difference(one: ArrayLike, other: ArrayLike) -> tuple[Floats, Floats]:
    """Return by how much gain [dB] and phase, within ±180 [deg], of two responses differ; NaN where one has none.

    Args:
        one: of any shape.
        other: what is taken off, of the same shape.
    """
    with np.errstate(all="ignore"):
        ratio = np.asarray(one, dtype=np.complex128) / np.asarray(other, dtype=np.complex128)
    ratio = np.where(known(ratio), ratio, np.nan)
    return decibels(ratio), degrees(ratio)

"""Frequency and damping of poles: the one convention of all commands, tables, pictures and JSON.

For a pole s [1/s] of a continuous model:

    natural frequency   |s| / 2π            [Hz]
    damping ratio       −Re s / |s|         [1]; 1 for a stable real pole, −1 for an unstable one, below 0 it grows
    damped frequency    |Im s| / 2π         [Hz], at which the free motion swings; 0 for a real pole

A pole z of a discrete model with period dt [s] is that of the continuous one that its samples show, s = ln(z)/dt; one
near z = 0 is over within a sample, a delay, and has none of the three. A pole at s = 0 has no damping ratio.

Source: K. Ogata, Modern Control Engineering, 5th ed., section 5-3; python-control's `damp` names the same numbers.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "ON_BORDER", "POLE_HEADINGS", "VANISHED", "PoleRow", "continuous", "damped_frequency_hz", "damping_ratio",
    "growth_rates", "natural_frequency_hz", "pole_keys", "pole_rows", "sides", "vanished",
]  # fmt: skip

VANISHED = 1e-6  # size of discrete poles that are over within a sample
POLE_HEADINGS = ("pole", "natural [Hz]", "damping", "damped [Hz]")  # of the columns of `pole_rows`
_AT_REST = 1e-9  # of the fastest pole: what rounding makes of an integrator
ON_BORDER = 1e-8  # of a pole's size (of 1 where sampled): what rounding, √ε, makes of a double pole on the border

_Complex = NDArray[np.complex128]
_Floats = NDArray[np.float64]


def vanished(poles: ArrayLike, dt: float) -> NDArray[np.bool_]:
    """Return which poles are over within a sample: delays of a discrete model.

    Args:
        poles: of any shape, [1/s] or, where dt is not 0, without unit.
        dt: period [s]; 0: continuous.
    """
    z = np.asarray(poles, dtype=np.complex128)
    return np.asarray(np.abs(z) <= VANISHED if dt > 0.0 else np.zeros(z.shape, dtype=np.bool_))


def continuous(poles: ArrayLike, dt: float) -> _Complex:
    """Return poles as those of a continuous model [1/s], same shape; vanished ones as if their size were 1e-6.

    Args:
        poles: of any shape, [1/s] or, where dt is not 0, without unit.
        dt: period [s]; 0: continuous.
    """
    z = np.asarray(poles, dtype=np.complex128)
    if dt == 0.0:
        return z
    return np.asarray(np.log(np.where(vanished(z, dt), VANISHED + 0.0j, z)) / dt, dtype=np.complex128)


def natural_frequency_hz(s: ArrayLike) -> _Floats:
    """Return |s|/2π [Hz], same shape.

    Args:
        s: poles of a continuous model [1/s].
    """
    return np.asarray(np.abs(np.asarray(s)) / (2.0 * np.pi), dtype=np.float64)


def damped_frequency_hz(s: ArrayLike) -> _Floats:
    """Return |Im s|/2π [Hz], same shape; 0 for a real pole.

    Args:
        s: poles of a continuous model [1/s].
    """
    return np.asarray(np.abs(np.asarray(s).imag) / (2.0 * np.pi), dtype=np.float64)


def damping_ratio(s: ArrayLike) -> _Floats:
    """Return −Re s/|s|, same shape; NaN for a pole at 0.

    Args:
        s: poles of a continuous model [1/s].
    """
    pole = np.asarray(s, dtype=np.complex128)
    size = np.abs(pole)
    ratio = np.divide(-pole.real, size, out=np.full(size.shape, np.nan), where=size > 0.0)
    return np.asarray(ratio + 0.0, dtype=np.float64)  # no −0


def sides(
    poles: ArrayLike, dt: float, *, relative: float, rounding: float = 0.0
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which poles lie beyond the border of stability, and which on it as far as they are known; same shape.

    Args:
        poles: of any shape, [1/s] or, where dt is not 0, without unit.
        dt: period [s]; 0: continuous.
        relative: what the distance from the border is known to, relative to a pole's size (to 1 for a discrete one).
        rounding: what it is known to besides, in units of the poles.
    """
    p = np.asarray(poles, dtype=np.complex128)
    distance, size = (np.abs(p) - 1.0, np.ones(p.shape)) if dt > 0.0 else (p.real, np.abs(p))
    known = relative * size + rounding
    return distance > known, np.abs(distance) <= known


def growth_rates(poles: ArrayLike, dt: float) -> _Floats:
    """Return how fast the motion of each pole grows [1/s], same shape; negative where it decays.

    Args:
        poles: of any shape, [1/s] or, where dt is not 0, without unit.
        dt: period [s]; 0: continuous.
    """
    p = np.asarray(poles, dtype=np.complex128)
    return np.asarray(np.log(np.maximum(np.abs(p), 1e-300)) / dt if dt > 0.0 else p.real, dtype=np.float64)


@dataclass(frozen=True)
class PoleRow:
    """One pole as tables show it.

    Attributes:
        pole: as it stands in the model.
        natural: frequency [Hz]; "delay" for a discrete pole that is over within a sample.
        damping: ratio; "-" where there is none.
        damped: frequency [Hz].
    """

    pole: complex
    natural: str
    damping: str
    damped: str


def pole_rows(poles: Iterable[complex], dt: float) -> list[PoleRow]:
    """Return poles as tables show them, slowest first, conjugates beside each other.

    Args:
        poles: of A.
        dt: period [s]; 0: continuous.
    """
    every = np.array(list(poles), dtype=np.complex128)
    order = np.lexsort((-every.imag, np.round(np.abs(continuous(every, dt)), 9), vanished(every, dt)))
    keys = pole_keys(every, dt)
    triples = list(zip(*keys.values(), strict=True))
    return [
        PoleRow(complex(every[i]), "delay", "-", "-") if triples[i][0] is None else _row(complex(every[i]), *triples[i])
        for i in order.tolist()
    ]


def _row(pole: complex, natural: float | None, damping: float | None, damped: float | None) -> PoleRow:
    ratio = "-" if damping is None else f"{damping:.4g}"
    return PoleRow(pole, f"{natural or 0.0:.5g}", ratio, f"{damped or 0.0:.5g}")


def pole_keys(poles: ArrayLike, dt: float) -> dict[str, list[float | None]]:
    """Return natural frequency, damping ratio and damped frequency of each pole, by the names they have in JSON.

    None stands for all three of a vanished pole, and for the damping ratio of a pole at rest.

    Args:
        poles: of A, shape (n,).
        dt: period [s]; 0: continuous.
    """
    z = np.asarray(poles, dtype=np.complex128)
    s, gone = continuous(z, dt), vanished(z, dt)
    rest = max(_AT_REST * float(np.abs(s[~gone]).max(initial=0.0)), ON_BORDER / dt if dt > 0.0 else 0.0)
    s = np.where(np.abs(s) <= rest, 0.0j, s)
    result = {
        "natural_frequency_hz": natural_frequency_hz(s),
        "damping": damping_ratio(s),
        "damped_frequency_hz": damped_frequency_hz(s),
    }
    return {
        name: [None if out or math.isnan(v) else v for v, out in zip(values.tolist(), gone.tolist(), strict=True)]
        for name, values in result.items()
    }

"""How far two linear systems differ in a band of frequencies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.core.records.record import RecordPart
from workbench.core.values.arrays import Floats
from workbench.core.values.linear import LinearPart
from workbench.errors import InputError

__all__ = ["BandError", "band_error", "dense_grid"]

_PER_DECADE = 300
_AROUND = np.array([-3.0, -1.0, -0.3, 0.0, 0.3, 1.0, 3.0])  # half widths of a resonance


@dataclass(frozen=True, kw_only=True)
class BandError(RecordPart):
    """Largest differences in a band.

    Attributes:
        band: lowest and highest frequency [Hz].
        absolute: largest |G − Gr|, in units of output over input.
        absolute_hz: where [Hz].
        relative: largest |Gr/G − 1|.
        relative_hz: where [Hz].
    """

    band: tuple[float, float]
    absolute: float
    absolute_hz: float
    relative: float
    relative_hz: float


def band_error(exact: LinearPart, reduced: LinearPart, band: tuple[float, float]) -> BandError:
    """Return the largest differences of two systems in a band.

    A balanced reduction bounds the error at all frequencies, and by its absolute size; what counts is often a band,
    and the relative error, which is large where |G| is small.

    Args:
        exact: the system.
        reduced: the one compared with it.
        band: lowest and highest frequency [Hz].

    Raises:
        InputError: a band out of order.
    """
    if not 0.0 < band[0] < band[1] < float("inf"):
        raise InputError(f"band: {band[0]:g}:{band[1]:g} Hz is not a band; write the lower frequency first, above 0")
    f = dense_grid(exact, reduced, *band)
    value = exact.response(f)
    apart = np.abs(value - reduced.response(f))
    with np.errstate(all="ignore"):
        part = apart / np.abs(value)
    part = np.where(np.isfinite(part), part, 0.0)
    i, j = int(np.argmax(apart)), int(np.argmax(part))
    return BandError(
        band=band,
        absolute=float(apart[i]),
        absolute_hz=float(f[i]),
        relative=float(part[j]),
        relative_hz=float(f[j]),
    )


def dense_grid(one: LinearPart, other: LinearPart, low: float, high: float) -> Floats:
    """Return frequencies from `low` to `high`, denser at resonances of both systems [Hz].

    Args:
        one: a system.
        other: another.
        low: [Hz].
        high: [Hz].
    """
    count = max(2, round(_PER_DECADE * np.log10(high / low)))
    poles = np.concatenate([one.poles, other.poles])
    around = (poles.imag[:, None] + np.abs(poles.real)[:, None] * _AROUND).ravel()
    extra = around / (2.0 * np.pi)
    every = np.concatenate([np.geomspace(low, high, count), extra[(extra > low) & (extra < high)]])
    return np.asarray(np.unique(every), dtype=np.float64)

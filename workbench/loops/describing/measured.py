"""The describing function of a black box, from a measured frequency response."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from workbench.core.values.arrays import Complex, Floats
from workbench.errors import InputError
from workbench.loops.describing.base import HARMONICS, DescribedBlock
from workbench.response.nfr.result import NfrResult

__all__ = ["MeasuredBlock"]


class MeasuredBlock(DescribedBlock):
    """N(A, f) interpolated in a measured frequency response; outside the grid it has no value.

    Gain (its logarithm where it is nowhere zero) and phase are interpolated linearly over log A and log f. Of the
    harmonics the sizes are known, which is what the filter hypothesis is judged by; their phases are not, and what a
    block answers to a motion that is not a sine cannot be put together from sines: harmonic balance drives the block
    itself (`workbench.limit_cycles.limit_cycle.driven`).

    Args:
        response: over a grid of amplitudes and frequencies.
        name: for tables and pictures.

    Raises:
        InputError: a point of the grid failed.
    """

    real = False
    frequency_dependent = True

    def __init__(self, response: NfrResult, *, name: str = "block") -> None:
        if not np.isfinite(response.response).all():
            failed = response.failed[0] if response.failed else None
            where = f" at {failed.frequency_hz:g} Hz, amplitude {failed.amplitude:g}" if failed else ""
            raise InputError(f"block {name}: its response could not be measured{where}; choose another range")
        self.name = name
        self.response = response
        gain = np.abs(response.response)
        self._logarithmic = bool(np.all(gain > 0.0))
        values = [np.log(gain) if self._logarithmic else gain, np.unwrap(np.radians(response.phase_deg), axis=1)]
        self._tables = [self._table(v) for v in values]
        sizes = _sizes(response)
        self._harmonics = [self._table(sizes[:, :, k]) for k in range(HARMONICS + 1)]

    def _table(self, values: Floats) -> RegularGridInterpolator:
        axes = [np.log(self.response.amplitude), np.log(self.response.frequency_hz)]
        # One amplitude or one frequency alone counts everywhere.
        for k, axis in enumerate(axes):
            if len(axis) == 1:
                axes[k] = np.array([axis[0] - 50.0, axis[0] + 50.0])
                values = np.repeat(values, 2, axis=k)
        return RegularGridInterpolator(axes, values, bounds_error=False, fill_value=np.nan)

    def gain(self, amplitude: float, frequency: float = 1.0) -> complex:
        return complex(self.gains(np.array([amplitude]), np.array([frequency]))[0])

    def gains(self, amplitudes: Floats, frequencies: Floats) -> Complex:
        with np.errstate(divide="ignore"):
            where = np.stack(np.broadcast_arrays(np.log(amplitudes), np.log(frequencies)), axis=-1)
        size, phase = (t(where) for t in self._tables)
        return np.asarray((np.exp(size) if self._logarithmic else size) * np.exp(1j * phase), dtype=np.complex128)

    def harmonic_sizes(self, amplitude: float, frequency: float) -> Floats:
        """Return the sizes of harmonics 0 … 7 of the output over that of its fundamental, shape (8,); NaN: not known.

        Args:
            amplitude: of the sine.
            frequency: [Hz].
        """
        where = np.log(amplitude), np.log(frequency)
        return np.array([float(t(where)) for t in self._harmonics])

    def answer(self, v: Complex, frequency: float, count: int) -> Complex:
        """Return the fundamental alone; the other harmonics are not known and count as zero."""
        result: Complex = np.zeros(count + 1, dtype=np.complex128)
        result[1] = v[1] * self.gain(float(abs(v[1])), frequency)
        return result


def _sizes(response: NfrResult) -> Floats:
    """Return the sizes of the harmonics at each point, shape (amplitudes, frequencies, 8)."""
    result = np.full((*response.response.shape, HARMONICS + 1), np.nan)
    fundamental = np.abs(response.response) * response.amplitude[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        result[:, :, 0] = np.abs(response.offset) / fundamental
    result[:, :, 1] = 1.0
    for i, row in enumerate(response.certificates):
        for j, certificate in enumerate(row):
            if certificate is not None:
                known = certificate.harmonics[: HARMONICS - 1]
                result[i, j, 2 : 2 + len(known)] = [np.nan if h is None else h for h in known]
    return result

"""One step on the way from H/G to a filter, compared with H/G."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.core.records.record import RecordPart
from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.decibels import difference

__all__ = ["FilterComparison", "FilterStep"]


@dataclass(frozen=True, eq=False, kw_only=True)
class FilterStep(RecordPart):
    """The filter after one step.

    Attributes:
        name: "reduced", "joined", "cancelled", "mirrored", "sign" or "low-pass".
        order: number of poles.
        response: shape (n,), F at the frequencies of the result.
        gain_error_db: largest |20 log |F G/H|| in the band [dB].
        gain_error_hz: where [Hz].
        phase_error_deg: largest phase error in the band [deg].
        phase_error_hz: where [Hz].
        residual: largest |G F − H| in the band over the largest |H| there: 0 is full compensation, 1 as bad as none.
        unstable_poles: shape (k,), right of the imaginary axis [1/s].
        remark: what the step did, in words.
    """

    name: str
    order: int
    response: Complex
    gain_error_db: float
    gain_error_hz: float
    phase_error_deg: float
    phase_error_hz: float
    residual: float
    unstable_poles: Complex
    remark: str


@dataclass(frozen=True, eq=False)
class FilterComparison:
    """Holds filters against H/G.

    Attributes:
        frequency: shape (n,), rising [Hz].
        band: lowest and highest frequency that counts [Hz].
        g: G there.
        h: H there.
    """

    frequency: Floats
    band: tuple[float, float]
    g: Complex
    h: Complex

    def step(self, name: str, response: Complex, order: int, unstable: Complex, remark: str) -> FilterStep:
        """Return the step with its errors.

        Args:
            name: name of the step.
            response: response of the filter.
            order: order of the filter.
            unstable: its poles right of the axis.
            remark: what was done.
        """
        inside = (self.frequency >= self.band[0]) & (self.frequency <= self.band[1])
        f = self.frequency[inside]
        gain, phase = (np.abs(d) for d in difference((response * self.g)[inside], self.h[inside]))
        i, j = _peak(gain), _peak(phase)
        left = np.abs(self.g * response - self.h)[inside]
        return FilterStep(
            name=name,
            order=order,
            response=response,
            gain_error_db=float(gain[i]),
            gain_error_hz=float(f[i]),
            phase_error_deg=float(phase[j]),
            phase_error_hz=float(f[j]),
            residual=float(np.max(left) / np.max(np.abs(self.h[inside]))),
            unstable_poles=unstable,
            remark=remark,
        )


def _peak(values: Floats) -> int:
    return int(np.argmax(np.where(np.isfinite(values), values, -1.0)))

"""Poles right of the imaginary axis, mirrored to the left."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.analysis.describing.base import Complex
from workbench.analysis.reduction.factored import Factored, right_of_axis

__all__ = ["Mirrored", "mirror"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Mirrored:
    """A stable transfer function of the same gain.

    Attributes:
        factored: with the poles mirrored.
        poles: shape (k,), those that were mirrored, where they were [1/s].
        on_axis: shape (j,), poles on the imaginary axis, which stay: an integrator cannot be mirrored.
        dc_sign: +1 or −1: what mirroring does to the sign at frequency 0, (−1) to the number of real poles mirrored.
    """

    factored: Factored
    poles: Complex
    on_axis: Complex
    dc_sign: int


def mirror(found: Factored) -> Mirrored:
    """Mirror the poles of the right half plane in the imaginary axis: p becomes −conj(p).

    F is multiplied by the all-pass Π (s − p)/(s + conj(p)), so |F(jω)| stays exactly, and the phase falls by 2·atan
    terms: that of a real pole by 180° at frequency 0, less and less above; that of a complex pair by 360° below its
    frequency and nothing far above it. What was exact before is wrong in phase around the poles mirrored: the price of
    a filter that is causal and stable.

    Source: K. J. Åström, Introduction to Stochastic Control Theory, chapter 4 (spectral factors).

    Args:
        found: zeros, poles and gain.
    """
    right = right_of_axis(found.poles)
    on = ~right & ~right_of_axis(-found.poles)
    poles = np.where(right, -found.poles.conj(), found.poles)
    moved = found.poles[right]
    return Mirrored(
        factored=Factored(zeros=found.zeros, poles=poles, gain=found.gain),
        poles=moved,
        on_axis=found.poles[on],
        dc_sign=-1 if int(np.sum(moved.imag == 0.0)) % 2 else 1,
    )

"""Butterworth low-pass filters as factored transfer functions."""

from __future__ import annotations

import numpy as np

from workbench.analysis.reduction.factored import Factored, by_size
from workbench.errors import InputError

__all__ = ["low_pass"]


def low_pass(frequency_hz: float, *, order: int = 1) -> Factored:
    """Return a Butterworth low-pass: gain 1 at frequency 0, 1/√2 at its corner, falling by 20·order dB per decade.

    It shifts the phase far below the corner, too: by order 1 at a tenth of the corner 5.7°, at half of it 27°.

    Source: A. V. Oppenheim, R. W. Schafer, Discrete-Time Signal Processing, appendix B.

    Args:
        frequency_hz: its corner [Hz].
        order: number of poles.

    Raises:
        InputError: a corner that is not positive, an order below 1 or above 8.
    """
    if not 0.0 < frequency_hz < float("inf"):
        raise InputError(f"the low-pass frequency must be positive, not {frequency_hz:g} Hz")
    if not 1 <= order <= 8:
        raise InputError(f"the order of the low-pass must be between 1 and 8, not {order}")
    omega = 2.0 * np.pi * frequency_hz
    angles = np.pi * (2 * np.arange(1, order + 1) + order - 1) / (2 * order)
    poles = omega * np.exp(1j * angles)
    poles = np.where(np.abs(poles.imag) < 1e-9 * omega, poles.real, poles)
    return Factored(zeros=np.zeros(0, dtype=np.complex128), poles=by_size(poles), gain=float(omega**order))

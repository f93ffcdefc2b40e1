"""A transfer function by its zeros, poles and gain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from workbench.core.records.record import RecordPart
from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.linear import LinearPart
from workbench.core.values.poles import natural_frequency_hz
from workbench.errors import InputError, SimulationError

__all__ = ["Factored", "factored", "low_pass", "right_of_axis"]

_AXIS = 1e-9  # poles so near the axis, relative to their size or 1/s, count as on it

_PLACES = 9  # where the gain is measured


@dataclass(frozen=True, eq=False, kw_only=True)
class Factored(RecordPart):
    """F(s) = gain · Π (s − zeros) / Π (s − poles).

    Attributes:
        zeros: shape (m,) [1/s], complex ones in conjugate pairs.
        poles: shape (n,) [1/s], likewise.
        gain: the factor, real.
    """

    zeros: Complex
    poles: Complex
    gain: float

    @property
    def order(self) -> int:
        """Number of poles."""
        return len(self.poles)

    @property
    def unstable_poles(self) -> Complex:
        """Poles right of the imaginary axis [1/s]."""
        return self.poles[right_of_axis(self.poles)]

    def at(self, s: Complex) -> Complex:
        """Return F(s), shape (k,); computed factor by factor, so that no power of s overflows.

        Args:
            s: shape (k,) [1/s].
        """
        value = np.full(len(s), self.gain, dtype=np.complex128)
        with np.errstate(all="ignore"):
            for k in range(max(len(self.zeros), len(self.poles))):
                value *= s - self.zeros[k] if k < len(self.zeros) else 1.0
                value /= s - self.poles[k] if k < len(self.poles) else 1.0
        return value

    def response(self, frequency_hz: Floats) -> Complex:
        """Return F(j2πf), shape (k,).

        Args:
            frequency_hz: shape (k,) [Hz].
        """
        return self.at(2j * np.pi * np.asarray(frequency_hz, dtype=np.complex128))

    def over(self, other: Factored) -> Factored:
        """Return F / other; nothing is cancelled."""
        return Factored(
            zeros=by_size(np.concatenate([self.zeros, other.poles])),
            poles=by_size(np.concatenate([self.poles, other.zeros])),
            gain=self.gain / other.gain,
        )

    def times(self, other: Factored) -> Factored:
        """Return F · other; nothing is cancelled."""
        return Factored(
            zeros=by_size(np.concatenate([self.zeros, other.zeros])),
            poles=by_size(np.concatenate([self.poles, other.poles])),
            gain=self.gain * other.gain,
        )

    def negated(self) -> Factored:
        """Return −F."""
        return Factored(zeros=self.zeros, poles=self.poles, gain=-self.gain)


def factored(part: LinearPart) -> Factored:
    """Return zeros, poles and gain of a state-space system.

    The zeros are those of `Linear.invariant_zeros`. The gain is the median over several frequencies.

    Args:
        part: the system.

    Raises:
        SimulationError: the zeros could not be computed, or the system is zero.
    """
    zeros, poles = by_size(part.invariant_zeros), by_size(part.poles)
    unit = Factored(zeros=zeros, poles=poles, gain=1.0)
    f = _places(zeros, poles)
    with np.errstate(all="ignore"):
        ratio = part.response(f) / unit.response(f)
    usable = ratio[np.isfinite(ratio)]
    gain = float(np.median(usable.real)) if len(usable) else 0.0
    if gain == 0.0:
        raise SimulationError("the transfer function is zero: the output does not depend on the input")
    return Factored(zeros=zeros, poles=poles, gain=gain)


def right_of_axis(poles: Complex) -> NDArray[np.bool_]:
    """Return which poles lie right of the imaginary axis, shape of the poles; integrators that rounding moved do not.

    Args:
        poles: shape (n,) [1/s].
    """
    return np.asarray(poles.real > _AXIS * np.maximum(1.0, np.abs(poles)))


def by_size(roots: Complex) -> Complex:
    """Return roots by magnitude, conjugates beside each other."""
    order = np.lexsort((roots.imag, roots.real, np.round(np.abs(roots), 12)))
    return np.asarray(roots[order], dtype=np.complex128)


def _places(zeros: Complex, poles: Complex) -> Floats:
    """Return frequencies between the smallest and the largest root [Hz]."""
    sizes = natural_frequency_hz(np.concatenate([zeros, poles]))
    sizes = sizes[sizes > 1e-9]
    low, high = (sizes.min(), sizes.max()) if len(sizes) else (0.1, 10.0)
    return np.asarray(np.geomspace(max(low, 1e-6 * high), 2.0 * high, _PLACES), dtype=np.float64)


# -- butterworth low-pass filters as factored transfer functions -----------------------------------


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
    poles = np.asarray(omega * np.exp(1j * angles), dtype=np.complex128)
    poles.imag[np.abs(poles.imag) < 1e-9 * omega] = 0.0
    return Factored(zeros=np.zeros(0, dtype=np.complex128), poles=by_size(poles), gain=float(omega**order))

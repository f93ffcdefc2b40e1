"""Cancellation of poles and zeros that nearly meet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.core.values.arrays import Complex
from workbench.errors import InputError
from workbench.point.reduction.factored import Factored, right_of_axis

__all__ = ["Mirrored", "cancel", "mirror"]


def cancel(factors: Factored, *, tolerance: float = 1e-5) -> tuple[Factored, Complex]:
    """Take out pairs of a pole p and a zero z with |p − z| ≤ tolerance · max(|p|, 1/s); return what is left, and the p.

    Nearest pairs go first; complex pairs go with their conjugates, real poles with real zeros, so that what is left
    is real. The gain is corrected so that the product of the factors left out is 1 at frequency 0; for slow pairs,
    which are near each other only because both are near 0, at infinity. A cancelled pair right of the axis hides an
    instability: in an open-loop filter such a pair must not be taken out if pole and zero are those of two different
    physical systems.

    Args:
        factors: zeros, poles and gain.
        tolerance: relative distance, absolute below 1 rad/s.

    Raises:
        InputError: a tolerance that is negative or 1 and more.
    """
    if not 0.0 <= tolerance < 1.0:
        raise InputError(f"the tolerance of cancellation must be between 0 and 1, not {tolerance:g}")
    poles, zeros = list(factors.poles.tolist()), list(factors.zeros.tolist())
    gone, gain = list[complex](), factors.gain
    for p, z in [(p, z) for d, p, z in _pairs(factors) if d <= tolerance]:
        for a, b in ((p, z),) if p.imag == 0.0 else ((p, z), (p.conjugate(), z.conjugate())):
            poles.remove(_nearest(poles, a))
            zeros.remove(_nearest(zeros, b))
            gone.append(a)
        gain *= _factor(p, z, tolerance)
    left = Factored(zeros=np.array(zeros, dtype=complex), poles=np.array(poles, dtype=complex), gain=gain)
    return left, np.array(gone, dtype=complex)


def _pairs(factors: Factored) -> list[tuple[float, complex, complex]]:
    """Return distance, pole and zero of all pairs, nearest first; of conjugates those above the real axis."""
    pairs: list[tuple[float, complex, complex]] = []
    for real in (True, False):
        poles, zeros = _half(factors.poles, real=real), _half(factors.zeros, real=real)
        while poles and zeros:
            apart = np.abs(np.subtract.outer(poles, zeros)) / np.maximum(1.0, np.abs(poles))[:, None]
            i, j = np.unravel_index(int(np.argmin(apart)), apart.shape)
            pairs.append((float(apart[i, j]), poles.pop(int(i)), zeros.pop(int(j))))
    return sorted(pairs, key=lambda pair: pair[0])


def _half(roots: Complex, *, real: bool) -> list[complex]:
    chosen = roots.imag == 0.0 if real else roots.imag > 0.0
    return list(roots[chosen].tolist())


def _nearest(roots: list[complex], wanted: complex) -> complex:
    return min(roots, key=lambda r: abs(r - wanted))


def _factor(p: complex, z: complex, tolerance: float) -> float:
    """Return (s − z)/(s − p) at s = 0, of a complex pair with its conjugate; of a slow pair its value far above."""
    if p == z or abs(p - z) > tolerance * max(abs(p), abs(z)):
        return 1.0
    return (z / p).real if p.imag == 0.0 else abs(z / p) ** 2


# -- poles right of the imaginary axis, mirrored to the left ---------------------------------------


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


def mirror(factors: Factored) -> Mirrored:
    """Mirror the poles of the right half plane in the imaginary axis: p becomes −conj(p).

    F is multiplied by the all-pass Π (s − p)/(s + conj(p)), so |F(jω)| stays exactly, and the phase falls by 2·atan
    terms: that of a real pole by 180° at frequency 0, less and less above; that of a complex pair by 360° below its
    frequency and nothing far above it. What was exact before is wrong in phase around the poles mirrored: the price of
    a filter that is causal and stable.

    Source: K. J. Åström, Introduction to Stochastic Control Theory, chapter 4 (spectral factors).

    Args:
        factors: zeros, poles and gain.
    """
    right = right_of_axis(factors.poles)
    on = ~right & ~right_of_axis(-factors.poles)
    poles = np.where(right, -factors.poles.conj(), factors.poles)
    moved = factors.poles[right]
    return Mirrored(
        factored=Factored(zeros=factors.zeros, poles=poles, gain=factors.gain),
        poles=moved,
        on_axis=factors.poles[on],
        dc_sign=-1 if int(np.sum(moved.imag == 0.0)) % 2 else 1,
    )

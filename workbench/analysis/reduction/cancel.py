"""Cancellation of poles and zeros that nearly meet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.analysis.describing.base import Complex, Floats
from workbench.analysis.reduction.factored import Factored
from workbench.errors import InputError

__all__ = ["Cancellation", "cancel", "pair_distances"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Cancellation:
    """A transfer function without its nearly equal poles and zeros.

    Attributes:
        factored: what is left.
        poles: shape (k,), the poles taken out [1/s].
        zeros: shape (k,), the zero that went with each.
        tolerance: as given.
    """

    factored: Factored
    poles: Complex
    zeros: Complex
    tolerance: float


def cancel(found: Factored, *, tolerance: float = 1e-5, keep_unstable: bool = False) -> Cancellation:
    """Take out pairs of a pole p and a zero z with |p − z| ≤ tolerance · max(|p|, 1/s).

    Nearest pairs go first; complex pairs go with their conjugates, real poles with real zeros, so that what is left
    is real. The gain is corrected so that the product of the factors left out is 1 at frequency 0; for slow pairs,
    which are near each other only because both are near 0, at infinity. A cancelled pair right of the axis hides an
    instability: in an open-loop filter such a pair must not be taken out if pole and zero are those of two different
    physical systems; `keep_unstable` leaves them.

    Args:
        found: zeros, poles and gain.
        tolerance: relative distance, absolute below 1 rad/s.
        keep_unstable: leave pairs whose pole lies right of the axis.

    Raises:
        InputError: a tolerance that is negative or 1 and more.
    """
    if not 0.0 <= tolerance < 1.0:
        raise InputError(f"the tolerance of cancellation must be between 0 and 1, not {tolerance:g}")
    pairs = [(p, z) for d, p, z in _pairs(found) if d <= tolerance and not (keep_unstable and p.real > 0.0)]
    poles, zeros = list(found.poles.tolist()), list(found.zeros.tolist())
    gone_poles, gone_zeros, gain = [], [], found.gain
    for p, z in pairs:
        for a, b in ((p, z),) if p.imag == 0.0 else ((p, z), (p.conjugate(), z.conjugate())):
            poles.remove(_nearest(poles, a))
            zeros.remove(_nearest(zeros, b))
            gone_poles.append(a)
            gone_zeros.append(b)
        gain *= _factor(p, z, tolerance)
    left = Factored(zeros=np.array(zeros, dtype=complex), poles=np.array(poles, dtype=complex), gain=gain)
    return Cancellation(
        factored=left,
        poles=np.array(gone_poles, dtype=complex),
        zeros=np.array(gone_zeros, dtype=complex),
        tolerance=tolerance,
    )


def pair_distances(found: Factored) -> tuple[Floats, Floats]:
    """Return the tolerances at which pairs go, rising, and the order that is left from each on.

    Args:
        found: zeros, poles and gain.
    """
    pairs = _pairs(found)
    distances = np.array([d for d, _, _ in pairs])
    gone = np.cumsum([1 if p.imag == 0.0 else 2 for _, p, _ in pairs])
    return distances, np.asarray(found.order - gone, dtype=np.float64)


def _pairs(found: Factored) -> list[tuple[float, complex, complex]]:
    """Return distance, pole and zero of all pairs, nearest first; of conjugates those above the real axis."""
    pairs: list[tuple[float, complex, complex]] = []
    for real in (True, False):
        poles, zeros = _half(found.poles, real=real), _half(found.zeros, real=real)
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

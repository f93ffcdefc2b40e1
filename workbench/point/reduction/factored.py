"""A transfer function by its zeros, poles and gain, and as a state-space system."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from workbench.core.records.record import RecordPart
from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.linear import LinearPart
from workbench.core.values.poles import natural_frequency_hz
from workbench.errors import InputError, SimulationError

__all__ = ["Factored", "factored", "low_pass", "right_of_axis", "to_state_space"]

_AXIS = 1e-9  # poles so near the axis, relative to their size or 1/s, count as on it

_PLACES = 9  # where the gain is measured
_LEAST = 1e-6  # [1/s] smaller roots count as this in the pairing and the scaling


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


# -- sections of first and second order in a row ---------------------------------------------------


@dataclass
class _Group:
    """One or two poles (a complex pair, or two real ones), and the zeros that go with them."""

    poles: list[complex]
    zeros: list[complex] = field(default_factory=list)

    @property
    def room(self) -> int:
        return len(self.poles) - len(self.zeros)


def to_state_space(factors: Factored) -> LinearPart:
    """Return a realisation; poles and zeros keep their digits, unlike in one polynomial of all of them.

    Each pole pair gets zeros near it; the states are scaled so that the matrix is balanced.

    Source: L. B. Jackson, Digital Filters and Signal Processing, chapter 11 (pairing and ordering of sections).

    Args:
        factors: at least as many poles as zeros, complex ones in conjugate pairs.

    Raises:
        InputError: more zeros than poles: no system that can be simulated.
    """
    if len(factors.zeros) > len(factors.poles):
        raise InputError(
            f"{len(factors.zeros)} zeros and {len(factors.poles)} poles: differentiators cannot be realised; "
            "add a low-pass"
        )
    groups = _paired(factors)
    sections = [_section(g) for g in groups]
    scale = factors.gain * float(np.prod([k for _, k in sections]))
    return _cascade([s for s, _ in sections], scale)


def _grouped(roots: Complex) -> list[list[complex]]:
    """Return complex pairs, real roots two by two, and the one that may be left."""
    pairs = [[complex(r), complex(r).conjugate()] for r in roots[roots.imag > 0.0].tolist()]
    real = sorted((complex(r) for r in roots[roots.imag == 0.0].tolist()), key=abs)
    return pairs + [real[k : k + 2] for k in range(0, len(real), 2)]


def _paired(factors: Factored) -> list[_Group]:
    """Give each group of poles zeros near it, so that the sum of distances on a logarithmic scale is least."""
    groups = [_Group(p) for p in _grouped(factors.poles)]
    zeros = _grouped(factors.zeros)
    split = [z for z in zeros if len(z) == 1]
    for some in ([z for z in zeros if len(z) == 2], split):
        open_ = [g for g in groups if some and g.room >= len(some[0])]
        cost = [[_distance(g.poles, z) for g in open_] for z in some]
        if not cost:
            continue
        rows, columns = linear_sum_assignment(np.array(cost).reshape(len(some), len(open_)))
        for i, j in zip(rows.tolist(), columns.tolist(), strict=True):
            open_[j].zeros += some[i]
    return groups


def _distance(poles: list[complex], zeros: list[complex]) -> float:
    """Return how far the upper members lie apart: ratio of their sizes, and their angles."""
    p, z = (max(roots, key=lambda r: r.imag) for roots in (poles, zeros))
    sizes = math.log(max(abs(p), _LEAST) / max(abs(z), _LEAST))
    return abs(complex(sizes, np.angle(p) - np.angle(z)))


def _section(group: _Group) -> tuple[LinearPart, float]:
    """Return one section of unit size, and the factor it must be multiplied by."""
    w = max(*(abs(p) for p in group.poles), _LEAST)
    a = np.real(np.poly([p / w for p in group.poles]))
    b = np.real(np.poly([z / w for z in group.zeros])) if group.zeros else np.ones(1)
    n = len(group.poles)
    b = np.concatenate([np.zeros(n + 1 - len(b)), b])
    D = float(b[0])
    rest = (b - D * a)[1:]
    A = w * np.vstack([np.eye(n, k=1)[: n - 1], -a[:0:-1]])
    B = np.zeros(n)
    B[-1] = w
    return LinearPart(A, B, rest[::-1].copy(), D), w ** (len(group.zeros) - n)


def _cascade(sections: list[LinearPart], gain: float) -> LinearPart:
    """Return the sections one behind the other."""
    whole = LinearPart(np.zeros((0, 0)), np.zeros(0), np.zeros(0), 1.0)
    for section in sections:
        whole = section.behind(whole)
    return _balanced(replace(whole, C=gain * whole.C, D=gain * whole.D))


def _balanced(part: LinearPart) -> LinearPart:
    """Return the system in states of such units that rows and columns of A, and B and C, are alike in size."""
    even = part.balanced()
    b, c = float(np.linalg.norm(even.B)), float(np.linalg.norm(even.C))
    unit = math.sqrt(c / b) if b and c else 1.0
    return replace(even, A=even.A + 0.0, B=even.B * unit + 0.0, C=even.C / unit + 0.0)  # no zeros with a sign

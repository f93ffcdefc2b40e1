"""The linear part of a loop with negative feedback: its response, and the poles that a gain gives it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import eig, schur

from workbench.analysis.describing.base import Complex, Floats
from workbench.analysis.lin.result import LinResult
from workbench.analysis.modes.poles import poles_of
from workbench.errors import InputError

__all__ = ["LinearPart"]

# Poles so near the imaginary axis, relative to their size (or to 1 rad/s), count as on it.
_ON_AXIS = 1e-7
_INFINITE = 1e12  # generalised eigenvalues beyond the largest pole times this are none


@dataclass(frozen=True, eq=False)
class LinearPart:
    """dx/dt = A x + B w, v = C x + D w; the loop is closed by w = −N v, so that 1 + N·L = 0 on its border.

    Attributes:
        A: shape (n, n).
        B: shape (n,).
        C: shape (n,).
        D: direct feed-through.
        state_names: of the n states; empty: not known.
    """

    A: Floats
    B: Floats
    C: Floats
    D: float = 0.0
    state_names: tuple[str, ...] = ()

    @classmethod
    def from_lin(cls, found: LinResult, *, sign: float = 1.0) -> LinearPart:
        """Return one input and one output of a linear model as a linear part.

        Args:
            found: continuous, with one input and one output.
            sign: −1 where positive feedback closes the loop.

        Raises:
            InputError: discrete, or several inputs or outputs.
        """
        if found.dt > 0.0:
            raise InputError(f"{found.model}: the linear part is sampled ({found.dt:g} s), but must be continuous")
        if found.D.shape != (1, 1):
            raise InputError(
                f"{found.model}: {found.D.shape[1]} inputs and {found.D.shape[0]} outputs; one of each is needed"
            )
        return cls(found.A, sign * found.B[:, 0], found.C[0], sign * float(found.D[0, 0]), found.state_names)

    @cached_property
    def poles(self) -> Complex:
        """Eigenvalues of A, shape (n,) [1/s]."""
        return np.linalg.eigvals(self.A).astype(np.complex128)

    @cached_property
    def _schur(self) -> tuple[Complex, Complex, Complex, Complex]:
        """T and Z of A = Z T Zᴴ, Zᴴ B and C Z."""
        t, z = schur(self.A.astype(np.complex128), output="complex")
        b, c = (np.asarray(x, dtype=np.complex128) for x in (z.conj().T @ self.B, self.C @ z))
        return t, z, b, c

    def _solve(self, frequency_hz: Floats) -> Complex:
        """Return Zᴴ (jω − A)⁻¹ B, shape (k, n), Z from Schur's form."""
        s = np.asarray(2j * np.pi * np.atleast_1d(frequency_hz), dtype=np.complex128)
        if not len(self.A):
            return np.zeros((len(s), 0), dtype=np.complex128)
        t, _, b, _ = self._schur
        with np.errstate(all="ignore"):
            return _back_substitution(t, b, s)

    def states_at(self, frequency_hz: Floats) -> Complex:
        """Return the response of the states, (jω − A)⁻¹ B, shape (k, n).

        Args:
            frequency_hz: shape (k,) [Hz].
        """
        x = self._solve(frequency_hz)
        return np.asarray(x @ self._schur[1].T, dtype=np.complex128) if len(self.A) else x

    def response(self, frequency_hz: Floats) -> Complex:
        """Return L(j2πf), shape (k,); not finite on a pole.

        Args:
            frequency_hz: shape (k,) [Hz].
        """
        x = self._solve(frequency_hz)
        through = self._schur[3] if len(self.A) else np.zeros(0)
        with np.errstate(all="ignore"):
            return np.asarray(x @ through + self.D, dtype=np.complex128)

    def closed_poles(self, gain: complex, frequency: float = 1.0) -> Complex:
        """Return the poles with w = −N v, a complex N realised as Re N + (Im N/ω) d/dt, which is N at ±jω.

        Args:
            gain: N.
            frequency: at which a complex N holds [Hz].
        """
        closed = self._closed(gain)
        if closed is not None:
            return np.linalg.eigvals(closed).astype(np.complex128)
        n, lead = len(self.A), gain.imag / (2.0 * math.pi * frequency)
        # Unknowns x, v, w: v = Cx + Dw, lead·dv/dt = −w − Re(N) v.
        a, e = np.zeros((n + 2, n + 2)), np.zeros((n + 2, n + 2))
        a[:n, :n], a[:n, n + 1], e[:n, :n] = self.A, self.B, np.eye(n)
        a[n, :n], a[n, n], a[n, n + 1] = self.C, -1.0, self.D
        a[n + 1, n], a[n + 1, n + 1], e[n + 1, n] = -gain.real, -1.0, lead
        alpha, beta = eig(a, e, right=False, homogeneous_eigvals=True)
        bound = _INFINITE * max(1.0, float(np.abs(self.A).max(initial=0.0)))
        finite = np.abs(beta) * bound > np.abs(alpha)
        return np.asarray(alpha[finite] / beta[finite], dtype=np.complex128)

    def unstable(self, gain: complex, frequency: float = 1.0) -> int:
        """Return how many poles lie right of the imaginary axis with w = −N v.

        Those that rounding may have moved there from the axis do not count: several integrators in a chain, whose poles
        it moves by the root of its size.

        Args:
            gain: N.
            frequency: at which a complex N holds [Hz].
        """
        closed = self._closed(gain)
        if closed is None:
            found = self.closed_poles(gain, frequency)
            return int(np.sum(found.real > _ON_AXIS * np.maximum(1.0, np.abs(found))))
        poles = poles_of(closed)
        right = poles.value.real > np.maximum(poles.uncertain, _ON_AXIS * np.maximum(1.0, np.abs(poles.value)))
        return int(np.sum(np.where(poles.real, 1, 2)[right]))

    def _closed(self, gain: complex) -> Floats | None:
        """Return A with w = −N v, N real; None for a complex one, and where the loop has no solution, 1 + N D = 0."""
        if gain.imag != 0.0 or abs(1.0 + gain.real * self.D) <= 1e-12:
            return None
        closed: Floats = self.A - gain.real / (1.0 + gain.real * self.D) * np.outer(self.B, self.C)
        return closed

    def negated(self) -> LinearPart:
        """Return −L."""
        return LinearPart(self.A, -self.B, self.C, -self.D, self.state_names)


def _back_substitution(t: Complex, b: Complex, s: Complex) -> Complex:
    """Return (s − T)⁻¹ b for upper triangular T, shape (k, n); many frequencies in one pass."""
    n = len(b)
    x: Complex = np.zeros((len(s), n), dtype=np.complex128)
    for i in range(n - 1, -1, -1):
        x[:, i] = (b[i] + x[:, i + 1 :] @ t[i, i + 1 :]) / (s - t[i, i])
    return x

"""A loop transfer function as a state space, and what feedback makes of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from workbench.core.poles import continuous, vanished
from workbench.errors import InputError
from workbench.session.base import Floats

__all__ = ["Complex", "Transfer"]

Complex = NDArray[np.complex128]

_NEAR = 1e-12  # 1 + D below this: the loop gain at high frequency is -1


@dataclass(frozen=True, eq=False)
class Transfer:
    """F(s) = C (sI - A)⁻¹ B + D with one input and one output, or F(z) likewise.

    Attributes:
        A: shape (n, n).
        B: shape (n, 1).
        C: shape (1, n).
        D: direct part.
        dt: sample period [s]; 0: continuous.
    """

    A: Floats
    B: Floats
    C: Floats
    D: float
    dt: float = 0.0

    @property
    def highest_hz(self) -> float:
        """The Nyquist frequency; infinite for a continuous system [Hz]."""
        return 0.5 / self.dt if self.dt > 0.0 else np.inf

    @property
    def poles(self) -> Complex:
        """Eigenvalues of A, shape (n,) [1/s], of a sampled system without unit."""
        return np.linalg.eigvals(self.A).astype(np.complex128)

    @property
    def rates(self) -> Complex:
        """Poles [1/s]; of a sampled system those that its samples show, without the ones at 0."""
        if self.dt == 0.0:
            return self.poles
        poles = self.poles
        return continuous(poles[~vanished(poles, self.dt)], self.dt)

    def response(self, frequency_hz: Floats) -> Complex:
        """Return F at frequencies [Hz], shape (k,); NaN on a pole.

        Args:
            frequency_hz: shape (k,) [Hz]; infinity gives D.
        """
        return np.array([self.at(f) for f in np.atleast_1d(frequency_hz)], dtype=np.complex128)

    def at(self, frequency_hz: float) -> complex:
        """Return F at one frequency [Hz]."""
        if np.isinf(frequency_hz):
            return complex(self.D)
        s = 2j * np.pi * frequency_hz
        if self.dt > 0.0:
            # Exactly real where it is: rounding there would look like a crossing of the real axis.
            s = -1.0 if frequency_hz == self.highest_hz else np.exp(s * self.dt)
        try:
            with np.errstate(all="ignore"):
                state = np.linalg.solve(s * np.eye(len(self.A)) - self.A, self.B)
        except np.linalg.LinAlgError:
            return complex(np.nan, np.nan)
        return complex((self.C @ state)[0, 0] + self.D)

    def scaled(self, factor: float) -> Transfer:
        """Return factor · F."""
        return Transfer(self.A, self.B, factor * self.C, factor * self.D, self.dt)

    def sensitivity(self) -> Transfer:
        """Return S = 1/(1 + F).

        Raises:
            InputError: 1 + D is 0, so that the closed loop has no solution.
        """
        e = 1.0 + self.D
        if abs(e) < _NEAR:
            raise InputError("the loop gain is -1 at once (without any dynamics): closed, the loop has no solution")
        return Transfer(self.A - self.B @ self.C / e, self.B / e, -self.C / e, 1.0 / e, self.dt)

    def complementary(self) -> Transfer:
        """Return T = F/(1 + F) = 1 - S."""
        s = self.sensitivity()
        return Transfer(s.A, s.B, -s.C, 1.0 - s.D, self.dt)

    def to_bilinear(self) -> Transfer:
        """Return the continuous system that has at w the value of this sampled one at z = (1 + w)/(1 - w).

        Raises:
            numpy.linalg.LinAlgError: there is a pole at z = -1.
        """
        n = len(self.A)
        inverse = np.linalg.inv(np.eye(n) + self.A)
        return Transfer(
            inverse @ (self.A - np.eye(n)),
            np.sqrt(2.0) * inverse @ self.B,
            np.sqrt(2.0) * self.C @ inverse,
            self.D - float((self.C @ inverse @ self.B)[0, 0]),
        )

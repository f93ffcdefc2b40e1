"""What a scalar feedback u = g·y sees of a system, and the poles that it gives it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import matrix_balance

from workbench.analysis.lin.result import LinResult
from workbench.analysis.loop.transfer import Transfer
from workbench.session.base import Floats

__all__ = ["Complex", "Plant"]

Complex = NDArray[np.complex128]

# A pole so near the border, relative to its size (to 1 where sampled), counts as on it.
_ON_BORDER = 1e-8
_SINGULAR = 1e-12


@dataclass(frozen=True, eq=False)
class Plant:
    """dx/dt = A x + B u, y = C x + D u, or x(k+1) = A x(k) + B u(k), with one input and one output.

    Attributes:
        A: shape (n, n).
        B: shape (n,).
        C: shape (n,).
        D: direct feed-through.
        dt: sample period [s]; 0: continuous.
    """

    A: Floats
    B: Floats
    C: Floats
    D: float = 0.0
    dt: float = 0.0

    @classmethod
    def of(cls, linear: LinResult, *, input: int = 0, output: int = 0) -> Plant:
        """Return one input and one output of a linear model, its states scaled so that none dwarfs the others.

        Args:
            linear: the model.
            input: position of the input.
            output: position of the output.
        """
        n = len(linear.A)
        if not n:
            return cls(linear.A, np.zeros(0), np.zeros(0), float(linear.D[output, input]), linear.dt)
        balanced, (scale, _) = matrix_balance(linear.A, permute=False, separate=True)
        return cls(
            np.asarray(balanced, dtype=np.float64),
            linear.B[:, input] / scale,
            linear.C[output] * scale,
            float(linear.D[output, input]),
            linear.dt,
        )

    @cached_property
    def transfer(self) -> Transfer:
        """G, from u to y."""
        return Transfer(self.A, self.B[:, None], self.C[None, :], self.D, self.dt)

    @cached_property
    def poles(self) -> Complex:
        """Open loop, shape (n,) [1/s]; of a sampled system in z."""
        return np.linalg.eigvals(self.A).astype(np.complex128)

    def closed(self, gain: float) -> Floats:
        """Return A + B g (1 − g D)⁻¹ C, the state matrix with u = g·y, shape (n, n).

        Args:
            gain: g; 1 − g·D must not be 0.
        """
        return np.asarray(self.A + gain / (1.0 - gain * self.D) * np.outer(self.B, self.C), dtype=np.float64)

    def solvable(self, gain: float) -> bool:
        """Whether y = C x + D g y has a solution.

        Args:
            gain: g.
        """
        return abs(1.0 - gain * self.D) > _SINGULAR

    def poles_at(self, gain: float) -> Complex:
        """Return the poles with u = g·y, shape (n,) [1/s]; of a sampled system in z.

        Args:
            gain: g.
        """
        return np.linalg.eigvals(self.closed(gain)).astype(np.complex128)

    def beyond(self, poles: Complex) -> Floats:
        """Return how far poles lie beyond the border: real parts [1/s], or ln|z|/dt of sampled ones.

        Args:
            poles: shape (n,).
        """
        if self.dt > 0.0:
            return np.asarray(np.log(np.maximum(np.abs(poles), 1e-300)) / self.dt, dtype=np.float64)
        return np.asarray(poles.real, dtype=np.float64)

    def growth(self, gain: float) -> float:
        """Return the growth rate of the slowest pole with u = g·y [1/s]; −inf without states.

        Args:
            gain: g.
        """
        return float(self.beyond(self.poles_at(gain)).max(initial=-np.inf))

    def count(self, gain: float) -> tuple[int, int]:
        """Return how many poles lie beyond the border of stability with u = g·y, and how many on it.

        Args:
            gain: g.
        """
        closed = self.closed(gain)
        poles = np.linalg.eigvals(closed)
        rounding = 10.0 * np.finfo(float).eps * float(np.linalg.norm(closed)) if len(closed) else 0.0
        distance = np.abs(poles) - 1.0 if self.dt > 0.0 else poles.real
        near = _ON_BORDER * (1.0 if self.dt > 0.0 else np.abs(poles)) + rounding
        return int(np.sum(distance > near)), int(np.sum(np.abs(distance) <= near))

    def frequency(self, pole: complex) -> float:
        """Return the frequency at which a pole oscillates [Hz].

        Args:
            pole: [1/s]; of a sampled system in z.
        """
        turn = abs(np.angle(pole)) / self.dt if self.dt > 0.0 else abs(pole.imag)
        return float(turn / (2.0 * np.pi))

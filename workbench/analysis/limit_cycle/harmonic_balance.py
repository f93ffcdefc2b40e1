"""Harmonic balance of a linear part and one block: V(k) + L(jkω) W(k) = 0 for k = 0 … K."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import root

from workbench.analysis.describing.base import HARMONICS, Block, Complex, Floats
from workbench.analysis.describing.fourier import series
from workbench.analysis.passes import told_mean
from workbench.core.linear import LinearPart

__all__ = ["Cycle", "HarmonicBalance", "balance", "states_of"]

_CLOSE = 1e-9
_SAMPLES = 2000


@dataclass(frozen=True, eq=False)
class Cycle:
    """A periodic motion of the block's input, x(θ) = v[0] + Re Σ v[k] e^{jkθ}, θ = 2πft.

    Attributes:
        frequency: f [Hz].
        v: coefficients of the block's input, shape (K + 1,); v[1] = −j · fundamental.
        w: coefficients of the block's output, shape (K + 1,).
        residual: of the balance, relative to the fundamental.
    """

    frequency: float
    v: Complex
    w: Complex
    residual: float = 0.0

    @property
    def fundamental(self) -> float:
        """Amplitude of the fundamental."""
        return float(abs(self.v[1]))

    @property
    def amplitude(self) -> float:
        """Half the peak-to-peak value."""
        x = series(self.v, np.linspace(0.0, 2.0 * np.pi, _SAMPLES))
        return 0.5 * float(np.ptp(x))


class HarmonicBalance:
    """The equations of harmonic balance, for a solver.

    Unknowns: mean, fundamental, real and imaginary parts of harmonics 2 … K, all over `scale`; log of the frequency.

    Args:
        part: L.
        block: static, or with a memory that it runs through by itself.
        count: K.
        scale: size of the motion.
    """

    def __init__(self, part: LinearPart, block: Block, *, count: int, scale: float) -> None:
        self.part, self.block, self.count, self.scale = part, block, count, scale

    def pack(self, v: Complex, frequency: float) -> Floats:
        """Return the unknowns of a motion, its harmonics padded with zeros or cut."""
        full = np.zeros(self.count + 1, dtype=np.complex128)
        full[: len(v)] = v[: self.count + 1]
        real = [full[0].real, -full[1].imag, *full[2:].real, *full[2:].imag]
        return np.append(np.array(real) / self.scale, np.log(frequency))

    def unpack(self, z: Floats) -> tuple[Complex, float]:
        """Return coefficients and frequency [Hz] of unknowns."""
        k = self.count - 1
        v = np.concatenate([[z[0], -1j * z[1]], z[2 : 2 + k] + 1j * z[2 + k : 2 + 2 * k]]) * self.scale
        return np.asarray(v, dtype=np.complex128), float(np.exp(np.clip(z[-1], -50.0, 50.0)))

    def __call__(self, z: Floats) -> Floats:
        """Return the residuals, shape (2K + 1,), as many as unknowns.

        Each equation is divided by 1 + |L(jkω)|, so that a pole of L (k = 0 of an integrator) asks for W(k) = 0.
        """
        v, f = self.unpack(z)
        w = self.block.answer(v, f, self.count)
        r = _weighted(v, w, self.part.response(f * np.arange(self.count + 1.0))) / self.scale
        return np.array([r[0].real, *r[1:].real, *r[1:].imag])

    def cycle(self, z: Floats) -> Cycle:
        """Return the motion that unknowns stand for."""
        v, f = self.unpack(z)
        residual = float(np.abs(self(z)).max())
        v[0] = told_mean(float(v[0].real), amplitude=float(abs(v[1])), residual=residual)
        return Cycle(f, v, self.block.answer(v, f, self.count), residual)


def _weighted(v: Complex, w: Complex, response: Complex) -> Complex:
    finite = np.isfinite(response)
    safe = np.where(finite, response, 0.0)
    return np.where(finite, (v + safe * w) / (1.0 + np.abs(safe)), w)


def balance(
    part: LinearPart, block: Block, *, frequency: float, amplitude: float, count: int = HARMONICS
) -> Cycle | None:
    """Return the periodic motion near a predicted one; None: the search did not arrive.

    All harmonics from the mean to the K-th are balanced, even ones included.

    Args:
        part: L.
        block: the nonlinear block.
        frequency: predicted [Hz].
        amplitude: predicted, of the block's input.
        count: K.

    Source: Khalil, Nonlinear Systems, 7.2; Krack & Gross, Harmonic Balance for Nonlinear Vibration Problems, chapter 2.
    """
    equations = HarmonicBalance(part, block, count=count, scale=amplitude)
    begin = equations.pack(np.array([0.0, -1j * amplitude]), frequency)
    # The harmonics that the describing function leaves out are a good first guess.
    w = block.answer(np.array([0.0, -1j * amplitude]), frequency, count)
    guess = -part.response(frequency * np.arange(count + 1.0)) * w
    guess[:2] = 0.0, -1j * amplitude
    starts = [equations.pack(guess, frequency), begin] if np.isfinite(guess).all() else [begin]
    for start in starts:
        # The differences of the Jacobian are wide enough for what a measured answer leaves uncertain.
        options = {"xtol": max(1e-12, 1e-2 * block.accuracy), **({"eps": block.accuracy} if block.accuracy else {})}
        solved = root(equations, start, method="hybr", options=options)
        z = np.asarray(solved.x, dtype=np.float64)
        if float(np.abs(equations(z)).max()) < max(_CLOSE, 10.0 * block.accuracy) and z[1] > 1e-3:
            return equations.cycle(z)
    return None


def states_of(part: LinearPart, cycle: Cycle, theta: Floats) -> Floats:
    """Return the states of the linear part along a motion, about the operating point, shape (k, n).

    Args:
        part: L.
        cycle: the motion.
        theta: phases, shape (k,) [rad].
    """
    k = np.arange(1.0, len(cycle.w))
    x = -part.states_at(cycle.frequency * k) * cycle.w[1:, None]
    moving = (np.exp(1j * np.multiply.outer(theta, k)) @ x).real
    mean = np.linalg.lstsq(part.A, part.b * cycle.w[0].real, rcond=None)[0] if abs(cycle.w[0]) else 0.0
    return np.asarray(moving + mean, dtype=np.float64)

"""Harmonic balance of a linear part and its blocks: V(k) + L(jkω) W(k) = 0 for k = 0 … K."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import root

from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.linear import Linear
from workbench.loops.describing.base import HARMONICS, DescribedBlock
from workbench.loops.describing.fourier import series
from workbench.response.simulate.zero_crossings import told_mean

__all__ = ["Cycle", "HarmonicBalance", "balance", "responses", "states_of"]

_CLOSE = 1e-9
_SAMPLES = 2000
_OFF_POLE = 1e-9  # of 2πf: where L has a pole on the imaginary axis it is taken so far to the right of it


@dataclass(frozen=True, eq=False)
class Cycle:
    """A periodic motion of the inputs of m blocks, x(θ) = v[0] + Re Σ v[k] e^{jkθ}, θ = 2πft.

    Attributes:
        frequency: f [Hz].
        v: coefficients of the blocks' inputs, shape (m, K + 1); that of the first block has v[0, 1] = −j · fundamental.
        w: coefficients of the blocks' outputs, shape (m, K + 1).
        residual: of the balance, relative to the fundamentals.
    """

    frequency: float
    v: Complex
    w: Complex
    residual: float = 0.0

    @property
    def fundamental(self) -> float:
        """Amplitude of the fundamental of the first block's input."""
        return float(abs(self.v[0, 1]))

    @property
    def amplitude(self) -> float:
        """Half the peak-to-peak value of the first block's input."""
        return float(self.amplitudes[0])

    @property
    def amplitudes(self) -> Floats:
        """Half the peak-to-peak values of the blocks' inputs, shape (m,)."""
        theta = np.linspace(0.0, 2.0 * np.pi, _SAMPLES)
        return np.array([0.5 * float(np.ptp(series(v, theta))) for v in self.v])


class HarmonicBalance:
    """The equations of harmonic balance, for a solver.

    Unknowns: for each block the mean and the real and imaginary parts of harmonics 1 … K of its input, over `scales`,
    without the real part of the first block's fundamental, whose phase is fixed; last the log of the frequency.

    Args:
        part: L, from the outputs of the blocks to their inputs, m of each.
        blocks: static, or with a memory that they run through by themselves.
        count: K.
        scales: sizes of their inputs, shape (m,).
    """

    def __init__(self, part: Linear, blocks: Sequence[DescribedBlock], *, count: int, scales: Floats) -> None:
        self.part, self.blocks, self.count, self.scales = part, tuple(blocks), count, scales

    def pack(self, v: Complex, frequency: float) -> Floats:
        """Return the unknowns of a motion, shape (m, any), its harmonics padded with zeros or cut."""
        full = np.zeros((len(self.blocks), self.count + 1), dtype=np.complex128)
        full[:, : v.shape[1]] = v[:, : self.count + 1]
        real = np.hstack([full.real, full[:, 1:].imag]) / self.scales[:, None]
        return np.append(np.delete(real.ravel(), 1), np.log(frequency))

    def unpack(self, z: Floats) -> tuple[Complex, float]:
        """Return coefficients, shape (m, K + 1), and frequency [Hz] of unknowns."""
        real = np.insert(z[:-1], 1, 0.0).reshape(len(self.blocks), -1)
        v = real[:, : self.count + 1].astype(np.complex128)
        v[:, 1:] += 1j * real[:, self.count + 1 :]
        return v * self.scales[:, None], float(np.exp(np.clip(z[-1], -50.0, 50.0)))

    def answers(self, v: Complex, frequency: float) -> Complex:
        """Return the coefficients of the blocks' outputs, shape (m, K + 1)."""
        return np.array([b.answer(row, frequency, self.count) for b, row in zip(self.blocks, v, strict=True)])

    def __call__(self, z: Floats) -> Floats:
        """Return the residuals, shape (m(2K + 1),), as many as unknowns.

        Each equation is divided by 1 + Σ|L(jkω)|, so that a pole of L (k = 0 of an integrator) asks for W(k) = 0.
        """
        v, f = self.unpack(z)
        L = responses(self.part, f * np.arange(self.count + 1.0), f)
        r = v + np.einsum("kij,jk->ik", L, self.answers(v, f))
        r /= (1.0 + np.abs(L).sum(axis=2)).T * self.scales[:, None]
        return np.asarray(np.hstack([r.real, r[:, 1:].imag]).ravel(), dtype=np.float64)

    def cycle(self, z: Floats) -> Cycle:
        """Return the motion that unknowns stand for."""
        v, f = self.unpack(z)
        residual = float(np.abs(self(z)).max())
        for row in v:
            row[0] = told_mean(float(row[0].real), amplitude=float(abs(row[1])), residual=residual)
        return Cycle(f, v, self.answers(v, f), residual)


def responses(part: Linear, frequency_hz: Floats, unit: float) -> Complex:
    """Return L at some frequencies, shape (k, m, m); on a pole a little to its right, where it is finite.

    Args:
        part: L.
        frequency_hz: shape (k,) [Hz].
        unit: frequency that tells what is little [Hz].
    """
    m = part.D.shape[1]
    result = part.response(frequency_hz).reshape(-1, m, m)
    for k in np.flatnonzero(~np.isfinite(result).all(axis=(1, 2))).tolist():
        s = 2.0 * np.pi * (1j * frequency_hz[k] + _OFF_POLE * unit)
        result[k] = part.C @ np.linalg.solve(s * np.eye(len(part.A)) - part.A, part.B.astype(np.complex128)) + part.D
    return result


def balance(
    part: Linear,
    blocks: Sequence[DescribedBlock],
    *,
    frequency: float,
    amplitude: float,
    others: Sequence[complex] = (),
    count: int = HARMONICS,
) -> Cycle | None:
    """Return the periodic motion near a predicted one; None: the search did not arrive.

    All harmonics from the mean to the K-th are balanced, even ones included.

    Args:
        part: L, from the outputs of the blocks to their inputs.
        blocks: the nonlinear blocks.
        frequency: predicted [Hz].
        amplitude: predicted, of the first block's input, whose fundamental is −j times that.
        others: predicted fundamentals of the other blocks' inputs.
        count: K.

    Source: Khalil, Nonlinear Systems, 7.2; Krack & Gross, Harmonic Balance for Nonlinear Vibration Problems, chapter 2.
    """
    first = np.array([-1j * amplitude, *others], dtype=np.complex128)
    sine = np.column_stack([np.zeros(len(first)), first])
    equations = HarmonicBalance(part, blocks, count=count, scales=np.maximum(np.abs(first), 1e-9 * amplitude))
    begin = equations.pack(sine, frequency)
    # The harmonics that the describing function leaves out are a good first guess.
    with np.errstate(all="ignore"):
        L = responses(part, frequency * np.arange(count + 1.0), frequency)
        guess = -np.einsum("kij,jk->ik", L, equations.answers(sine, frequency))
    guess[:, :2] = sine
    starts = [equations.pack(guess, frequency), begin] if np.isfinite(guess).all() else [begin]
    accuracy = max(b.accuracy for b in equations.blocks)
    for start in starts:
        # The differences of the Jacobian are wide enough for what a measured answer leaves uncertain.
        options = {"xtol": max(1e-12, 1e-2 * accuracy), **({"eps": accuracy} if accuracy else {})}
        solved = root(equations, start, method="hybr", options=options)
        z = np.asarray(solved.x, dtype=np.float64)
        size = -equations.unpack(z)[0][0, 1].imag
        if float(np.abs(equations(z)).max()) < max(_CLOSE, 10.0 * accuracy) and size > 1e-3 * amplitude:
            return equations.cycle(z)
    return None


def states_of(part: Linear, cycle: Cycle, theta: Floats) -> Floats:
    """Return the states of the linear part along a motion, about the operating point, shape (k, n).

    Args:
        part: L.
        cycle: the motion.
        theta: phases, shape (k,) [rad].
    """
    n, m = part.B.shape
    k = np.arange(1.0, cycle.w.shape[1])
    x = -np.einsum("knm,mk->kn", part.states_at(cycle.frequency * k).reshape(-1, n, m), cycle.w[:, 1:])
    moving = (np.exp(1j * np.multiply.outer(theta, k)) @ x).real
    mean = cycle.w[:, 0].real
    held = np.linalg.lstsq(part.A, part.B @ mean, rcond=None)[0] if np.abs(mean).any() else 0.0
    return np.asarray(moving + held, dtype=np.float64)

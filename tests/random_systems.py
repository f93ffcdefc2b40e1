"""Random stable systems of which every mode can be seen, and records of them.

Like MATLAB's and python-control's `drss`: real poles and pairs at random places, B, C and D from the normal
distribution. Such a system may have a mode that hardly reaches the output or is hardly reached by the input; no data
can show it, so no method can be asked for its pole. What can be seen is what the Hankel singular values say
(Glover 1984): they bound the error of leaving a state out. A system is drawn again until the smallest of them is
above `VISIBLE` times the largest. Nothing else is chosen.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linear_sum_assignment

import workbench as wb
from workbench.core.values.arrays import Floats
from workbench.data.bla.design import RandomPhase, lines_of
from workbench.identification.identified.recursion import march_one
from workbench.identification.prediction.innovations import Innovations, normal_equations
from workbench.identification.prediction.model import parameter_spread
from workbench.identification.prediction.refine import Refined

__all__ = [
    "Modes", "Plant", "pole_error", "random_modes", "random_plant", "random_response", "scattered",
    "truth_spread",
]  # fmt: skip


VISIBLE = 1e-3
RADIUS = (0.3, 0.95)


@dataclass(frozen=True, eq=False)
class Plant:
    """x(k + 1) = A x(k) + B u(k), y(k) = C x(k) + D u(k)."""

    A: Floats
    B: Floats
    C: Floats
    D: Floats

    @property
    def poles(self) -> NDArray[np.complex128]:
        """Eigenvalues of A."""
        return np.linalg.eigvals(self.A).astype(np.complex128)

    def output(self, u: Floats, x0: Floats | None = None) -> Floats:
        """Return the output without noise, shape (N, p)."""
        states, _ = march_one(u @ self.B.T, self.A, np.zeros(len(self.A)) if x0 is None else x0)
        y: Floats = states @ self.C.T + u @ self.D.T
        return y

    def hankel_values(self) -> Floats:
        """Return the Hankel singular values, rising."""
        reach = scipy.linalg.solve_discrete_lyapunov(self.A, self.B @ self.B.T)
        observe = scipy.linalg.solve_discrete_lyapunov(self.A.T, self.C.T @ self.C)
        return np.sort(np.sqrt(np.abs(np.linalg.eigvals(reach @ observe))))


def random_plant(rng: np.random.Generator, order: int, inputs: int, outputs: int) -> Plant:
    """Return a random system whose modes can all be seen."""
    while True:
        A = scipy.linalg.block_diag(*_modes(rng, order))
        turn = np.linalg.qr(rng.standard_normal((order, order)))[0]
        B, C = rng.standard_normal((order, inputs)), rng.standard_normal((outputs, order))
        plant = Plant(turn @ A @ turn.T, B, C, rng.standard_normal((outputs, inputs)))
        values = plant.hankel_values()
        if values[0] > VISIBLE * values[-1]:
            return plant


def _modes(rng: np.random.Generator, order: int) -> list[Floats]:
    modes: list[Floats] = []
    while order > 0:
        radius = rng.uniform(*RADIUS)
        if order >= 2 and rng.random() < 0.6:
            angle = rng.uniform(0.05, 0.9 * np.pi)
            c, s = radius * np.cos(angle), radius * np.sin(angle)
            modes.append(np.array([[c, s], [-s, c]]))
            order -= 2
        else:
            modes.append(np.array([[radius * rng.choice([-1.0, 1.0])]]))
            order -= 1
    return modes


@dataclass(frozen=True, eq=False)
class Modes:
    """Lightly damped modes side by side, with an integrator or without: gain/(1 + 2ζ s/ω + s²/ω²) each, and k/s.

    Attributes:
        modes: frequency [Hz], damping ratio and gain of each.
        integrator: k; 0: there is none.
    """

    modes: tuple[tuple[float, float, float], ...]
    integrator: float = 0.0

    @property
    def linear(self) -> wb.Linear:
        """The state space, with input u and output y."""
        blocks, B, C = [], list[float](), list[float]()
        for frequency, damping, gain in self.modes:
            w = 2.0 * np.pi * frequency
            blocks.append(np.array([[0.0, w], [-w, -2.0 * damping * w]]))
            B, C = [*B, 0.0, w], [*C, gain, 0.0]
        if self.integrator:
            blocks, B, C = [*blocks, np.zeros((1, 1))], [*B, self.integrator], [*C, 1.0]
        names = tuple(f"x{k + 1}" for k in range(len(B)))
        return wb.Linear(
            scipy.linalg.block_diag(*blocks), np.array(B)[:, None], np.array(C)[None], np.zeros((1, 1)),
            state_names=names, input_names=("u",), output_names=("y",),
        )  # fmt: skip

    def held(self, dt: float) -> tuple[Floats, Floats]:
        """Return A and B of the sampled model with a held input."""
        A, B = self.linear.A, self.linear.B
        n = len(A)
        whole = scipy.linalg.expm(dt * np.block([[A, B], [np.zeros((1, n + 1))]]))
        return whole[:n, :n], whole[:n, n:]

    def sampled(self, frequency_hz: Floats, dt: float) -> NDArray[np.complex128]:
        """Return the response of the sampled model with a held input, shape (k,)."""
        A, B = self.held(dt)
        z = np.exp(2j * np.pi * frequency_hz * dt)
        return np.array([(self.linear.C @ np.linalg.solve(v * np.eye(len(A)) - A, B)).item() for v in z])

    def records(
        self, dt: float, band: tuple[float, float], *, realisations: int, periods: int
    ) -> Iterator[tuple[Floats, Floats]]:
        """Yield input and output of random-odd multisines, from rest, the first period left out.

        Args:
            dt: sampling interval [s].
            band: lowest and highest frequency [Hz].
            realisations: of the phases.
            periods: of each.
        """
        length = round(1.0 / (band[0] * dt))
        excited = tuple(lines_of("random-odd", 1, round(band[1] * length * dt), 1).excited.tolist())
        A, B = self.held(dt)
        for seed in range(realisations):
            one = RandomPhase(
                rms=1.0, length=length, excited=excited, periods=periods, transient=1, seed=1000 + seed
            ).period()
            u = np.tile(one, periods + 1)
            states, _ = march_one(u[:, None] @ B.T, A, np.zeros(len(A)))
            yield u[length:], (states @ self.linear.C.T)[length:, 0]


def random_modes(random: np.random.Generator, *, integrates: bool) -> Modes:
    """Return one to three modes of 0.5 to 5 Hz, damping ratios of 1e-3 to 0.5 (logarithmic)."""
    count = int(random.integers(1, 4))
    frequency, damping = 10.0 ** random.uniform(-0.3, 0.7, count), 10.0 ** random.uniform(-3.0, np.log10(0.5), count)
    gain = random.uniform(0.2, 2.0, count) * random.choice([-1.0, 1.0], count)
    modes = tuple(zip(frequency.tolist(), damping.tolist(), gain.tolist(), strict=True))
    return Modes(modes, float(random.uniform(0.3, 3.0)) if integrates else 0.0)


def pole_error(found: ArrayLike, true: ArrayLike) -> float:
    """Return the largest distance between poles matched one to one (least sum of distances); infinite if some are left.

    Sorted ones would fall apart where the real parts of a pair differ by a rounding.
    """
    one, other = (np.asarray(poles, dtype=np.complex128) for poles in (found, true))
    if len(one) != len(other):
        return float("inf")
    distance = np.abs(one[:, None] - other[None])
    rows, columns = linear_sum_assignment(distance)
    return float(np.max(distance[rows, columns], initial=0.0))


def random_response(random: np.random.Generator, order: int, frequency_hz: Floats) -> NDArray[np.complex128]:
    """Return the response of a random stable system with poles of 0.1 to 10 Hz, damping ratios from 0.01, shape (k,).

    Args:
        random: draws it.
        order: number of poles.
        frequency_hz: shape (k,).
    """
    s, found, left = 2j * np.pi * frequency_hz, np.zeros(len(frequency_hz), dtype=np.complex128), order
    while left > 0:
        w = 2.0 * np.pi * 10.0 ** random.uniform(-1.0, 1.0)
        if left >= 2 and random.random() < 0.6:
            z = 10.0 ** random.uniform(-2.0, -0.1)
            pole = w * (-z + 1j * np.sqrt(1.0 - z * z))
            residue = (random.normal() + 1j * random.normal()) * w * np.sqrt(z)
            found += residue / (s - pole) + np.conj(residue) / (s - np.conj(pole))
            left -= 2
        else:
            found += w * (1.0 + abs(random.normal())) * random.choice([-1.0, 1.0]) / (s + w)
            left -= 1
    return found + (random.normal() if random.random() < 0.3 else 0.0)


def scattered(
    random: np.random.Generator, response: NDArray[np.complex128], size: float, *, level: bool
) -> NDArray[np.complex128]:
    """Return a response with complex normal noise, in proportion to the gain or of one level over frequency.

    Args:
        random: draws it.
        response: shape (k,).
        size: of the noise, over the gain or the largest gain.
        level: one level.
    """
    e = (random.standard_normal(len(response)) + 1j * random.standard_normal(len(response))) / np.sqrt(2.0)
    return np.asarray(response + size * e * (np.abs(response).max() if level else np.abs(response)))


def truth_spread(model: Innovations, u: Floats, y: Floats, sizes: Floats) -> Floats:
    """Return a factor of the Cramér–Rao bound of A, B, C, D of a known model: to judge estimates by.

    Args:
        model: the truth.
        u: shape (N, m).
        y: shape (N, p).
        sizes: shape (p,), standard deviations of its innovations, which are independent.

    Raises:
        ValueError: the record leaves a direction open.
    """
    entries = model.free()
    Q = model.coordinates(entries)
    matrix, _ = normal_equations(model, (u, y), np.diag(1.0 / sizes), entries, Q)
    truth = Refined(model, np.diag(sizes**2), 0.0, matrix, Q, entries, 10**9, 0, settled=True)
    result = parameter_spread(truth, np.ones(u.shape[1]), np.ones(y.shape[1]))
    if result is None:
        raise ValueError("the record does not determine all parameters")
    return result

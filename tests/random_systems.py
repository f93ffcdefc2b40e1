"""Random stable systems of which every mode can be seen, and records of them.

Like MATLAB's and python-control's `drss`: real poles and pairs at random places, B, C and D from the normal
distribution. Such a system may have a mode that hardly reaches the output or is hardly reached by the input; no data
can show it, so no method can be asked for its pole. What can be seen is what the Hankel singular values say
(Glover 1984): they bound the error of leaving a state out. A system is drawn again until the smallest of them is
above `VISIBLE` times the largest. Nothing else is chosen.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linear_sum_assignment

from workbench.analysis.identified.march import march_one

__all__ = ["Plant", "pole_error", "random_plant"]

Floats = NDArray[np.float64]

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

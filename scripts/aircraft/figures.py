"""The published figures of a linear model and of a recorded limit cycle."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import brentq

from workbench.core.values.arrays import Complex, Floats

Transfer = Callable[[Floats], Complex]


def transfer(A: Floats, b: Floats, c: Floats) -> Transfer:
    """Return c (j2πf − A)⁻¹ b as a function of frequencies [Hz], from the residues."""
    values, right = np.linalg.eig(A)
    residues = (c @ right) * np.linalg.solve(right, b)

    def response(hertz: Floats) -> Complex:
        found: Complex = (residues / (2j * np.pi * np.atleast_1d(hertz)[:, None] - values)).sum(axis=1)
        return found

    return response


def crossings(response: Transfer, low: float, high: float, points: int = 40000) -> list[tuple[float, float]]:
    """Return (frequency [Hz], value) of every crossing of the negative real axis."""
    hertz = np.geomspace(low, high, points)
    imaginary = response(hertz).imag
    found = []
    for i in np.flatnonzero(imaginary[:-1] * imaginary[1:] < 0.0):
        at = float(brentq(lambda f: float(response(np.array([f])).imag[0]), hertz[i], hertz[i + 1]))
        value = float(response(np.array([at])).real[0])
        if value < 0.0:
            found.append((at, value))
    return found


def unstable(A: Floats) -> int:
    """Return how many eigenvalues have a positive real part."""
    return int((np.linalg.eigvals(A).real > 0.0).sum())


def switches(A: Floats, b: Floats, c: Floats, low: float, high: float) -> list[tuple[float, int, int]]:
    """Return (k, count below, count above) where A − k b c changes its number of unstable poles, by bisection."""

    def count(k: float) -> int:
        return unstable(A - k * np.outer(b, c))

    grid = np.geomspace(low, high, 200)
    counts = [count(k) for k in grid]
    found = []
    for i in range(len(grid) - 1):
        if counts[i] != counts[i + 1]:
            below, above = grid[i], grid[i + 1]
            for _ in range(30):
                middle = (below + above) / 2.0
                below, above = (middle, above) if count(middle) == counts[i] else (below, middle)
            found.append((float(above), counts[i], counts[i + 1]))
    return found


def edges(A: Floats, b: Floats, c: Floats, inside: float, outside: float) -> float:
    """Return the gain g between a stable and an unstable one at which A + g b c loses its stability."""
    for _ in range(45):
        middle = (inside + outside) / 2.0
        if unstable(A + middle * np.outer(b, c)) == 0:
            inside = middle
        else:
            outside = middle
    return inside


def peak(values: Floats) -> float:
    """Return half the range."""
    return float(values.max() - values.min()) / 2.0


def frequency(time: Floats, values: Floats) -> float:
    """Return the mean frequency [Hz] by the rising zero crossings about the mean."""
    moved = values - (values.max() + values.min()) / 2.0
    i = np.flatnonzero((moved[:-1] < 0.0) & (moved[1:] >= 0.0))
    at = time[i] - moved[i] * (time[i + 1] - time[i]) / (moved[i + 1] - moved[i])
    return float((len(at) - 1) / (at[-1] - at[0]))

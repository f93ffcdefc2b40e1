"""Fourier coefficients of f(v(θ)), v a trigonometric polynomial, f smooth between given levels of v."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from workbench.core.values.arrays import Complex, Floats

__all__ = ["coefficients", "series"]

_SCAN = 720  # points of a period in which levels are looked for
_PANELS = 12  # of a period, at least
_NODES = 14  # of each panel
_BISECTIONS = 46
_X, _W = np.polynomial.legendre.leggauss(_NODES)


def series(v: Complex, theta: Floats) -> Floats:
    """Return v[0] + Re Σ v[k] e^{jkθ}.

    Args:
        v: coefficients, shape (m,).
        theta: angles [rad].
    """
    powers = np.exp(1j * np.multiply.outer(theta, np.arange(len(v))))
    return np.asarray((powers @ v).real, dtype=np.float64)


def coefficients(function: Callable[[Floats], Floats], v: Complex, levels: Floats, count: int) -> Complex:
    """Return the coefficients 0 … count of function(v(θ)), shape (count + 1,).

    The period is cut where v passes a level; between the cuts Gauss-Legendre quadrature converges at the rate of a
    smooth function, so that relays and quantisers are as exact as polynomials. Not for functions with memory.

    Args:
        function: static, takes and returns shape (n,).
        v: coefficients of the input.
        levels: inputs at which the function or its slope jumps.
        count: highest harmonic.
    """
    edges = _edges(v, levels)
    half = 0.5 * np.diff(edges)
    theta = (edges[:-1] + half)[:, None] + half[:, None] * _X
    weight = (half[:, None] * _W).ravel()
    angle = theta.ravel()
    w = function(series(v, angle)) * weight
    result = np.exp(-1j * np.multiply.outer(np.arange(count + 1), angle)) @ w / np.pi
    result[0] = 0.5 * result[0].real
    return np.asarray(result, dtype=np.complex128)


def _edges(v: Complex, levels: Floats) -> Floats:
    """Return the ends of the panels, from 0 to 2π."""
    cuts = np.concatenate([[0.0], _passes(v, levels), [2.0 * np.pi]])
    cuts = cuts[np.append(True, np.diff(cuts) > 1e-13)]
    cuts[-1] = 2.0 * np.pi
    pieces = np.maximum(1, np.ceil(np.diff(cuts) / (2.0 * np.pi / _PANELS)).astype(int))
    parts = [np.linspace(a, b, n, endpoint=False) for a, b, n in zip(cuts[:-1], cuts[1:], pieces, strict=True)]
    return np.concatenate([*parts, [2.0 * np.pi]])


def _passes(v: Complex, levels: Floats) -> Floats:
    """Return the angles at which v(θ) passes one of the levels, rising."""
    grid = np.linspace(0.0, 2.0 * np.pi, _SCAN + 1)
    values = series(v, grid)
    inside = levels[(levels > values.min()) & (levels < values.max())]
    if not len(inside):
        return np.zeros(0)
    over = values[None, :] > inside[:, None]
    row, column = np.nonzero(over[:, 1:] != over[:, :-1])
    low, high, level, rising = grid[column], grid[column + 1], inside[row], over[row, column + 1]
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        right = (series(v, middle) > level) == rising
        low, high = np.where(right, low, middle), np.where(right, middle, high)
    return np.sort(high)

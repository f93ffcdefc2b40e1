"""Frequencies at which a transfer function has gain 1, or is real: found from eigenvalues, none overlooked."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from scipy.linalg import eigvals
from scipy.optimize import brentq

from workbench.core.values.arrays import Floats
from workbench.core.values.linear import LinearPart
from workbench.core.values.poles import damped_frequency_hz, natural_frequency_hz

__all__ = ["gain_crossings", "level_frequencies", "real_crossings", "scan"]

# |Im F| / |F| at a crossing of the real axis: rounding of the frequency leaves 1e-14/ζ of it where a mode of damping ζ
# makes the curve cross; at a pole on the axis it is 1.
_REAL = 1e-3
_ROUNDING = 1e-13  # of |F|: an imaginary part below this has no sign


def gain_crossings(f: LinearPart) -> list[float]:
    """Return the frequencies at which |F| = 1, rising [Hz].

    The zeros of 1 - F(-s) F(s) on the imaginary axis are eigenvalues of a Hamiltonian matrix (S. Boyd, V. Balakrishnan,
    P. Kabamba, A bisection method for computing the H∞ norm, 1989). Between neighbouring eigenvalues |F| - 1 keeps
    its sign, so that one value in each gap shows every crossing; the root itself is found in F.

    Args:
        f: transfer function, continuous or sampled.
    """

    def level(frequency: Floats) -> Floats:
        with np.errstate(divide="ignore"):
            return np.log(np.abs(f.response(frequency)))

    return _roots(level, level_frequencies(f, _gain_pencil), f.highest_hz)


def real_crossings(f: LinearPart) -> list[float]:
    """Return the frequencies at which F is real, rising [Hz]; without 0 and the Nyquist frequency, where it always is.

    As for the gain, with the zeros of F(s) - F(-s).

    Args:
        f: transfer function, continuous or sampled.
    """

    def imaginary(frequency: Floats) -> Floats:
        value = f.response(frequency)
        size = np.abs(value)
        there = ~(np.abs(value.imag) <= _ROUNDING * size)  # NaN stays NaN
        return np.divide(value.imag, size, out=np.zeros(len(size)), where=there)

    result = np.array(_roots(imaginary, level_frequencies(f, _odd_pencil), f.highest_hz))
    return [] if not len(result) else result[np.abs(imaginary(result)) < _REAL].tolist()


def scan(f: LinearPart, candidates: Floats | None = None) -> Floats:
    """Return frequencies that cover the poles of F and the candidates with five decades around them, rising [Hz]."""
    poles = f.continuous_poles
    sizes = np.concatenate([natural_frequency_hz(poles), damped_frequency_hz(poles)])
    own = sizes[(sizes > 1e-9 * sizes.max(initial=0.0)) & (sizes > 0.0)]
    every = np.concatenate([own, [] if candidates is None else candidates])
    if not len(every):
        every = np.array([0.1 / f.dt if f.dt > 0.0 else 1.0])
    broad = np.geomspace(every.min() * 1e-3, every.max() * 1e2, 60)
    grid = np.unique(np.concatenate([broad, *(every * factor for factor in (0.9, 0.99, 1.0, 1.01, 1.1))]))
    return grid[grid < f.highest_hz]


def _roots(g: Callable[[Floats], Floats], candidates: Floats, highest: float) -> list[float]:
    """Return where g, a function of frequencies, changes its sign."""
    if not len(candidates):
        return []
    ends = [candidates[0] * 0.5, min(candidates[-1] * 2.0, _below(highest))]
    samples = np.log(np.unique(np.concatenate([np.sqrt(candidates[1:] * candidates[:-1]), ends])))

    def at(t: float) -> float:
        return float(g(np.exp([t]))[0])

    values = g(np.exp(samples))
    signs = [(t, v) for t, v in zip(samples.tolist(), values.tolist(), strict=True) if not np.isnan(v) and v != 0.0]
    steps = [(a, b) for (a, u), (b, v) in pairwise(signs) if (u < 0.0) != (v < 0.0)]
    return [float(np.exp(brentq(at, a, b, xtol=1e-14, rtol=1e-14))) for a, b in steps]


def _below(highest: float) -> float:
    return float(highest * (1.0 - 1e-9))


def level_frequencies(f: LinearPart, pencil: Callable[[LinearPart], tuple[Floats, Floats]]) -> Floats:
    """Return frequencies between which the function cannot change its sign, and others, rising [Hz].

    Args:
        f: transfer function, continuous or sampled.
        pencil: of a continuous one → (a, b) whose generalised eigenvalues are the zeros of the function.
    """
    try:
        plane = _bilinear(f) if f.dt > 0.0 else f
        a, b = pencil(plane)
        with np.errstate(all="ignore"):
            w = eigvals(a, b)
    except (np.linalg.LinAlgError, ValueError):
        w = np.zeros(0, dtype=np.complex128)
    nu = np.abs(w[np.isfinite(w)].imag)
    nu = nu[(nu > 0.0) & (nu < 1e15)]
    hz = (2.0 * np.arctan(nu) / f.dt if f.dt > 0.0 else nu) / (2.0 * np.pi)
    hz = hz[(hz > 0.0) & (hz < f.highest_hz)]
    return np.unique(np.concatenate([hz, scan(f, hz)]))


def _bilinear(f: LinearPart) -> LinearPart:
    """Return the continuous system that has at w the value of this sampled one at z = (1 + w)/(1 - w).

    Raises:
        numpy.linalg.LinAlgError: there is a pole at z = -1.
    """
    inverse = np.linalg.inv(np.eye(len(f.A)) + f.A)
    B, C = np.sqrt(2.0) * inverse @ f.B, np.sqrt(2.0) * f.C @ inverse
    return LinearPart(inverse @ (f.A - np.eye(len(f.A))), B, C, f.D - f.C @ inverse @ f.B)


def _gain_pencil(f: LinearPart) -> tuple[Floats, Floats]:
    """Return (a, b) whose generalised eigenvalues are the zeros of 1 - F(-s) F(s)."""
    n, d = len(f.A), f.d
    a = np.block([
        [f.A, np.zeros((n, n)), f.B],
        [-f.C.T @ f.C, -f.A.T, -f.C.T * d],
        [-d * f.C, -f.B.T, np.array([[1.0 - d * d]])],
    ])  # fmt: skip
    return a, _descriptor(n)


def _odd_pencil(f: LinearPart) -> tuple[Floats, Floats]:
    """Return (a, b) whose generalised eigenvalues are the zeros of F(s) - F(-s), among them all crossings of the axis.

    Args:
        f: continuous.
    """
    n = len(f.A)
    B, C = (x / max(float(np.abs(x).max(initial=0.0)), 1e-300) for x in (f.B, f.C))
    a = np.block([
        [f.A, np.zeros((n, n)), B],
        [np.zeros((n, n)), -f.A, B],
        [C, C, np.zeros((1, 1))],
    ])  # fmt: skip
    return a, _descriptor(n)


def _descriptor(n: int) -> Floats:
    b = np.eye(2 * n + 1)
    b[-1, -1] = 0.0
    return b

"""Frequencies at which a transfer function has gain 1, or is real: found from eigenvalues, none overlooked."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from scipy.linalg import eigvals
from scipy.optimize import brentq

from workbench.core.values.arrays import Floats
from workbench.core.values.linear import LinearPart
from workbench.core.values.matrices import balance
from workbench.core.values.poles import continuous, damped_frequency_hz, natural_frequency_hz, vanished

__all__ = ["gain_crossings", "level_frequencies", "real_crossings", "scan", "sign_changes"]

# |Im F| / |F| at a crossing of the real axis: rounding of the frequency leaves 1e-14/ζ of it where a mode of damping ζ
# makes the curve cross; at a pole on the axis it is 1.
_REAL = 1e-3
_ONE = 1e-9  # relative: candidates that are nearer to each other are one
_ROUNDING = 1e-13  # of |F|: an imaginary part below this has no sign
_BESIDE = np.array([-4.0, -1.0, 0.0, 1.0, 4.0])  # times its damping: around a pole or zero, where F turns
_PARTS = 8  # of the stretch around a value that is nearest to 0; each round leaves two of them
_ZOOMS = 26  # rounds: 4 to that power is the reciprocal of rounding


def gain_crossings(f: LinearPart) -> list[float]:
    """Return the frequencies at which |F| = 1, rising [Hz].

    The zeros of 1 - F(-s) F(s) on the imaginary axis are eigenvalues of a Hamiltonian matrix (S. Boyd, V. Balakrishnan,
    P. Kabamba, A bisection method for computing the H∞ norm, 1989). Between neighbouring eigenvalues |F| - 1 keeps
    its sign, so that one value in each gap shows every crossing; the root itself is found in F. Rounding may lose
    eigenvalues: the gaps are also parted around each pole and zero, and where |F| comes nearest to 1 without a change
    of sign, the place is looked at closely.

    Args:
        f: transfer function, continuous or sampled.
    """

    def level(frequency: Floats) -> Floats:
        with np.errstate(divide="ignore"):
            return np.log(np.abs(f.response(frequency)))

    turning = _turning(f)
    turning = turning[(turning > 0.0) & (turning < f.highest_hz)]
    return _roots(level, np.union1d(level_frequencies(f, _gain_pencil), scan(f, turning)), f.highest_hz)


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

    result = np.array(_roots(imaginary, level_frequencies(f, _odd_pencil), f.highest_hz, closely=False))
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


def _roots(g: Callable[[Floats], Floats], candidates: Floats, highest: float, *, closely: bool = True) -> list[float]:
    """Return where g, a function of frequencies, changes its sign."""
    if not len(candidates):
        return []
    # One eigenvalue that rounding makes two: between these lies the crossing itself, where the sign is rounding.
    candidates = candidates[np.append(True, np.diff(candidates) > _ONE * candidates[1:])]
    ends = [candidates[0] * 0.5, min(candidates[-1] * 2.0, _below(highest))]
    middles = np.log(np.unique(np.concatenate([np.sqrt(candidates[1:] * candidates[:-1]), ends])))
    return sign_changes(g, middles, closely=closely)


def sign_changes(g: Callable[[Floats], Floats], samples: Floats, *, closely: bool = True) -> list[float]:
    """Return the frequencies where g changes its sign, rising [Hz].

    Args:
        g: of frequencies [Hz]; where it is NaN or 0 it tells nothing.
        samples: logarithms of frequencies, rising, close enough that g has no more than one extreme between three.
        closely: whether to look where g is nearest to 0, too; not where rounding alone makes it change its sign.
    """

    def at(t: float) -> float:
        return float(g(np.exp([t]))[0])

    t, v = samples, g(np.exp(samples))
    if closely:
        t, v = _nearest_to_zero(g, t, v)
    signs = [(x, y) for x, y in zip(t.tolist(), v.tolist(), strict=True) if not np.isnan(y) and y != 0.0]
    steps = [(a, b) for (a, u), (b, w) in pairwise(signs) if (u < 0.0) != (w < 0.0)]
    roots = (_root(at, a, b) for a, b in steps)
    return [float(np.exp(root)) for root in roots if root is not None]


def _root(at: Callable[[float], float], a: float, b: float) -> float | None:
    """Return where a function changes its sign that has two at a and b among many; None: that was rounding."""
    ends = {a: at(a), b: at(b)}
    if (ends[a] < 0.0) != (ends[b] < 0.0):
        return float(brentq(at, a, b, xtol=1e-14, rtol=1e-14))
    small, large = sorted((a, b), key=lambda t: abs(ends[t]))
    return small if abs(ends[small]) <= _ROUNDING < abs(ends[large]) else None  # it is at an end


def _nearest_to_zero(g: Callable[[Floats], Floats], t: Floats, v: Floats) -> tuple[Floats, Floats]:
    """Return samples and values of g, those added where it comes nearest to 0 between three of one sign."""
    size, sign = np.abs(v), np.sign(v)
    same = (sign[:-2] == sign[1:-1]) & (sign[1:-1] == sign[2:])
    inner = np.flatnonzero(same & (size[1:-1] <= size[:-2]) & (size[1:-1] <= size[2:]) & np.isfinite(size[1:-1])) + 1
    if not len(inner):
        return t, v
    low, high, own = t[inner - 1], t[inner + 1], sign[inner]
    added, values = [t], [v]
    for _ in range(_ZOOMS):
        grid = low[:, None] + (high - low)[:, None] * np.linspace(0.0, 1.0, _PARTS + 1)
        here = g(np.exp(grid.ravel())).reshape(grid.shape)
        best = np.argmin(np.where(np.isnan(here), np.inf, here * own[:, None]), axis=1)
        row = np.arange(len(grid))
        added, values = [*added, grid[row, best]], [*values, here[row, best]]
        low, high = grid[row, np.maximum(best - 1, 0)], grid[row, np.minimum(best + 1, _PARTS)]
        searched = (here[row, best] * own > 0.0) & (high - low > 1e-15 * np.maximum(1.0, np.abs(low)))
        low, high, own = low[searched], high[searched], own[searched]
        if not len(low):
            break
    every, first = np.unique(np.concatenate(added), return_index=True)
    return every, np.concatenate(values)[first]


def _below(highest: float) -> float:
    return float(highest * (1.0 - 1e-9))


def level_frequencies(f: LinearPart, pencil: Callable[[LinearPart], tuple[Floats, Floats]]) -> Floats:
    """Return frequencies between which the function cannot change its sign, and others, rising [Hz].

    Args:
        f: transfer function, continuous or sampled.
        pencil: of a continuous one → (a, b) whose generalised eigenvalues are the zeros of the function.
    """
    try:
        plane = _balanced(_bilinear(f) if f.dt > 0.0 else f)
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


def _turning(f: LinearPart) -> Floats:
    """Return frequencies around each pole and zero [Hz]."""
    n = len(f.A)
    mass = np.eye(n + 1)
    mass[-1, -1] = 0.0
    with np.errstate(all="ignore"):
        zeros = eigvals(np.block([[f.A, f.B], [f.C, f.D]]), mass)
    zeros = zeros[np.isfinite(zeros) & (np.abs(zeros) < 1e15)]
    s = np.concatenate([f.continuous_poles, continuous(zeros[~vanished(zeros, f.dt)], f.dt)])
    return np.asarray((np.abs(s.imag)[:, None] + np.abs(s.real)[:, None] * _BESIDE).ravel() / (2.0 * np.pi))


def _balanced(f: LinearPart) -> LinearPart:
    """Return the system in states whose sizes are alike: a companion form has coefficients of all sizes."""
    n = len(f.A)
    whole, _ = balance(np.block([[f.A, f.B], [f.C, f.D]]))
    return LinearPart(whole[:n, :n], whole[:n, n:], whole[n:, :n], whole[n:, n:])


def _bilinear(f: LinearPart) -> LinearPart:
    """Return the continuous system that has at w the value of this sampled one at z = (1 + w)/(1 - w).

    Raises:
        numpy.linalg.LinAlgError: there is a pole at z = -1.
    """
    inverse = np.linalg.inv(np.eye(len(f.A)) + f.A)
    B, C = np.sqrt(2.0) * inverse @ f.B, np.sqrt(2.0) * f.C @ inverse
    return LinearPart(inverse @ (f.A - np.eye(len(f.A))), B, C, f.D - f.C @ inverse @ f.B)


def _gain_pencil(f: LinearPart) -> tuple[Floats, Floats]:
    """Return (a, b) whose generalised eigenvalues are the zeros of 1 - F(-s) F(s).

    A direct part above 1 makes F, where its gain is 1, a small difference of large numbers, and the eigenvalues lose
    it: those of 1/F, which has gain 1 where F has, do not.
    """
    if abs(f.d) > 1.0:
        f = LinearPart(f.A - f.B @ f.C / f.d, f.B / f.d, -f.C / f.d, 1.0 / f.d)
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

"""Intersections of L(jω) with −1/N(A) where N is complex: zeros of 1 + N(A, f) L(f) over amplitude and frequency."""

from __future__ import annotations

import numpy as np
from scipy.optimize import root

from workbench.analysis.describing.base import Block, Complex, Floats
from workbench.core.linear import LinearPart

__all__ = ["intersections"]

_MOST_FREQUENCIES = 4000
_CLOSE = 1e-8
_LIMITS = 60.0  # of the logarithms, so that a search that runs away ends


def intersections(block: Block, part: LinearPart, f: Floats, value: Complex, amplitudes: Floats) -> Floats:
    """Return amplitude and frequency [Hz] of each solution of 1 + N(A, f) L(f) = 0, shape (k, 2).

    Cells of the grid in which real and imaginary part change sign are searched by Powell's hybrid method.

    Args:
        block: its N may depend on the frequency.
        part: the linear part.
        f: frequencies [Hz], close enough that L turns little from one to the next.
        value: L there.
        amplitudes: rising.
    """
    keep = np.isfinite(value)
    f, value = f[keep], value[keep]
    stride = max(1, len(f) // _MOST_FREQUENCIES)
    f, value = f[::stride], value[::stride]
    f = np.asarray(f, dtype=np.float64)
    sheet = 1.0 + _gains(block, amplitudes, f) * value[None, :]
    found: list[tuple[float, float]] = []
    for i, j in zip(*np.nonzero(_mixed(sheet.real) & _mixed(sheet.imag)), strict=True):
        begin = (float(np.sqrt(amplitudes[i] * amplitudes[i + 1])), float(np.sqrt(f[j] * f[j + 1])))
        spread = (amplitudes[i + 1] / amplitudes[i], f[j + 1] / f[j])
        solution = _refined(block, part, begin, spread)
        if solution is not None and not any(np.allclose(solution, other, rtol=1e-5) for other in found):
            found.append(solution)
    return np.array(sorted(found, key=lambda s: s[1]), dtype=np.float64).reshape(-1, 2)


def _gains(block: Block, amplitudes: Floats, f: Floats) -> Complex:
    if not block.frequency_dependent:
        column = np.array([block.gain(a) for a in amplitudes.tolist()], dtype=np.complex128)
        return np.repeat(column[:, None], len(f), axis=1)
    return np.array([[block.gain(a, x) for x in f.tolist()] for a in amplitudes.tolist()], dtype=np.complex128)


def _mixed(values: Floats) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Return which cells have corners on both sides of zero."""
    corners = np.stack([values[:-1, :-1], values[:-1, 1:], values[1:, :-1], values[1:, 1:]])
    return np.asarray((corners.min(axis=0) <= 0.0) & (corners.max(axis=0) >= 0.0))


def _refined(
    block: Block, part: LinearPart, begin: tuple[float, float], spread: tuple[float, float]
) -> tuple[float, float] | None:
    def distance(z: Floats) -> Floats:
        a, x = np.exp(np.clip(z, -_LIMITS, _LIMITS)).tolist()
        r = 1.0 + block.gain(a, x) * part.at(x)
        return np.array([r.real, r.imag]) if np.isfinite(r) else np.array([10.0, 10.0])

    solved = root(distance, np.log(begin), method="hybr", options={"xtol": 1e-13})
    amplitude, frequency = np.exp(np.clip(solved.x, -_LIMITS, _LIMITS)).tolist()
    near = abs(np.log(amplitude / begin[0])) < 4.0 * np.log(spread[0]) and abs(np.log(frequency / begin[1])) < max(
        4.0 * np.log(spread[1]), 1e-3
    )
    return (amplitude, frequency) if near and float(np.abs(solved.fun).max()) < _CLOSE else None

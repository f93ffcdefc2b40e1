"""Several blocks in one loop, seen from the input of the first: what they predict for the fundamental."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.linear import Linear, LinearPart
from workbench.limit_cycles.limit_cycle.harmonic_balance import responses
from workbench.loops.describing.base import DescribedBlock

__all__ = ["Gain", "ManyBlocks", "tabulated"]

# (amplitudes, frequencies [Hz]) → N, all of shape (k,); NaN: not known.
Gain = Callable[[Floats, Floats], Complex]

_TABLE = (1e-6, 1e6)
_PER_DECADE = 40
_ROUNDS, _UNDAMPED = 60, 4
_SAME = 1e-9


def tabulated(block: DescribedBlock) -> Gain:
    """Return N(A) of a static block, interpolated over log A; NaN outside 1e-6 … 1e6.

    Args:
        block: its N does not depend on the frequency.
    """
    a = np.geomspace(*_TABLE, round(np.log10(_TABLE[1] / _TABLE[0]) * _PER_DECADE) + 1)
    known = np.array([block.gain(x) for x in a.tolist()], dtype=np.complex128)

    def gain(amplitudes: Floats, _: Floats) -> Complex:
        at = np.log(np.maximum(amplitudes, 1e-300))
        parts = (np.interp(at, np.log(a), x, left=np.nan, right=np.nan) for x in (known.real, known.imag))
        real, imaginary = parts
        return np.asarray(real + 1j * imaginary, dtype=np.complex128)

    return gain


class ManyBlocks(DescribedBlock):
    """All blocks of a loop as one around `part`, so that 1 + N·L = 0 where the fundamentals of all of them balance.

    For an amplitude of the first block's input the fundamentals of the others' inputs solve

        V(i) + Σ L(i, j) N(j, |V(j)|) V(j) = 0,   i = 2 … m,

    by iteration over their gains; then N = −F/(V(1)·L), F being what returns to the first block's input. Means and
    higher harmonics are left out. Of several solutions at the same amplitude that one is found which small gains of
    the others lead to; where none is found N is NaN.

    Args:
        whole: from the outputs of the blocks to their inputs, V + L W = 0.
        gains: N of each block.
        name: for tables and pictures.

    Attributes:
        part: L as the first block sees it, the others being gains of the middle size of theirs.

    Source: A. Gelb, W. Vander Velde, Multiple-Input Describing Functions and Nonlinear System Design, chapter 3.
    """

    real = False
    frequency_dependent = True

    def __init__(self, whole: Linear, gains: Sequence[Gain], *, name: str) -> None:
        self.name = name
        self._whole, self._gains = whole, tuple(gains)
        self.middle = np.array([_middle(g) for g in gains[1:]])
        closed = whole
        for j, g in enumerate(self.middle.tolist(), start=1):
            closed = closed.with_feedback(-g, input=j, output=j)
        self.part: LinearPart = closed.part()

    def motions(self, amplitudes: Floats, frequencies: Floats) -> tuple[Complex, Complex]:
        """Return the fundamentals of the blocks' inputs and outputs, shapes (k, m); NaN where there are none.

        Args:
            amplitudes: of the first block's input, shape (k,).
            frequencies: shape (k,) [Hz].
        """
        k, m = len(amplitudes), len(self._gains)
        v, w = np.full((k, m), np.nan + 0j), np.full((k, m), np.nan + 0j)
        v[:, 0] = -1j * amplitudes
        w[:, 0] = self._gains[0](amplitudes, frequencies) * v[:, 0]
        L = responses(self._whole, frequencies, float(np.median(frequencies)))
        n = np.tile(self.middle.astype(np.complex128), (k, 1))
        left = np.flatnonzero(np.isfinite(w[:, 0]))
        for turn in range(_ROUNDS):
            if not len(left):
                break
            drive = -L[left][:, 1:, :1] * w[left, :1, None]
            closed = np.eye(m - 1) + L[left][:, 1:, 1:] * n[left][:, None, :]
            result = np.linalg.solve(closed, drive)[:, :, 0]
            columns = (g(np.abs(result[:, j]), frequencies[left]) for j, g in enumerate(self._gains[1:]))
            fresh = np.column_stack(list(columns))
            there = (np.abs(fresh - n[left]) <= _SAME * np.abs(fresh)).all(axis=1)
            v[left[there], 1:], w[left[there], 1:] = result[there], (fresh * result)[there]
            n[left] = fresh if turn < _UNDAMPED else 0.5 * (n[left] + fresh)
            left = left[~there & np.isfinite(fresh).all(axis=1)]
        return v, w

    def gains(self, amplitudes: Floats, frequencies: Floats) -> Complex:
        a, f = (x.ravel() for x in np.broadcast_arrays(amplitudes, frequencies))
        v, w = self.motions(a, f)
        L = responses(self._whole, f, float(np.median(f)))
        returned = -(L[:, 0, :] * w).sum(axis=1)
        with np.errstate(all="ignore"):
            result = -returned / (v[:, 0] * self.part.response(f))
        return np.asarray(result.reshape(np.broadcast_shapes(amplitudes.shape, frequencies.shape)), dtype=np.complex128)

    def gain(self, amplitude: float, frequency: float = 1.0) -> complex:
        return complex(self.gains(np.array([amplitude]), np.array([frequency]))[0])

    def answer(self, v: Complex, frequency: float, count: int) -> Complex:
        """Return the fundamental alone; the harmonics that the others add are not known here and are NaN."""
        result = np.full(count + 1, np.nan + 0j)
        result[1:2] = self.gain(float(abs(v[1])), frequency) * v[1]
        return np.asarray(result, dtype=np.complex128)


def _middle(gain: Gain) -> float:
    """Return a gain that a block has at some amplitude, neither at the smallest nor at the largest."""
    a = np.geomspace(*_TABLE, 241)
    known = gain(a, np.ones(len(a))).real
    known = known[np.isfinite(known) & (known != 0.0)]
    return float(np.median(known)) if len(known) else 1.0

"""Is a two-level signal the sequence of a shift register?

Such a sequence is fixed by its first few values: it can react to nothing. The Berlekamp-Massey algorithm finds the
shortest linear recurrence modulo 2 that gives the whole of it; its order is about half the length of what chance or
a controller makes, and small for a pseudo-random binary sequence, also one that is held or sampled at another rate.
A limit cycle of a relay repeats itself too, but not by a recurrence that is short against its period: with two
switches a period the order is half the period or more.

Source: J. L. Massey, Shift-register synthesis and BCH decoding, IEEE Trans. Inf. Theory 15 (1969).
"""

from __future__ import annotations

import numpy as np

from workbench.session.base import Floats

__all__ = ["from_shift_register", "linear_complexity"]

_SAME = 1e-6  # of the range: levels closer than that are one
_CONFIRMED = 64  # samples beyond those that fix the recurrence; chance confirms them once in 2⁶⁴
_PER_PERIOD = 1 / 3  # of the period: most that the order of the recurrence may be


def from_shift_register(u: Floats) -> bool:
    """Return whether a signal is a sequence of two levels that a short recurrence gives as a whole.

    Args:
        u: shape (n,).
    """
    low, high = float(np.min(u)), float(np.max(u))
    upper = np.abs(u - high) <= _SAME * (high - low)
    if not high > low or not np.all(upper | (np.abs(u - low) <= _SAME * (high - low))):
        return False
    bits = upper.astype(np.uint8)
    order = linear_complexity(bits.tolist())
    return 2 * order + _CONFIRMED <= len(bits) and order <= _PER_PERIOD * _period(bits)


def linear_complexity(bits: list[int]) -> int:
    """Return the order of the shortest linear recurrence modulo 2 that gives a sequence of 0 and 1.

    Args:
        bits: the sequence.
    """
    recurrence, earlier, order, since, past = 1, 1, 0, 1, 0  # polynomials as integers, one bit a coefficient
    for count, bit in enumerate(bits):
        past = past << 1 | bit
        if not (recurrence & past).bit_count() & 1:
            since += 1
            continue
        corrected = recurrence ^ earlier << since
        if 2 * order <= count:
            order, earlier, since = count + 1 - order, recurrence, 1
        else:
            since += 1
        recurrence = corrected
    return order


def _period(bits: np.ndarray[tuple[int], np.dtype[np.uint8]]) -> int:
    """Return after how many samples the sequence repeats itself; its length if it does not."""
    for shift in range(1, len(bits) - _CONFIRMED):
        if np.array_equal(bits[shift:], bits[:-shift]):
            return shift
    return len(bits)

"""Maximum-length shift registers: the bits of pseudo-random binary sequences."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

__all__ = ["TAPS", "jump", "register_bits"]

Bits = NDArray[np.uint8]

# Feedback taps of maximum-length shift registers (P. Alfke, Xilinx XAPP 052, 1996, table 3).
TAPS: Mapping[int, tuple[int, ...]] = {
    2: (2, 1), 3: (3, 2), 4: (4, 3), 5: (5, 3), 6: (6, 5), 7: (7, 6), 8: (8, 6, 5, 4),
    9: (9, 5), 10: (10, 7), 11: (11, 9), 12: (12, 6, 4, 1), 13: (13, 4, 3, 1),
    14: (14, 5, 3, 1), 15: (15, 14), 16: (16, 15, 13, 4), 17: (17, 14), 18: (18, 11),
    19: (19, 6, 2, 1), 20: (20, 17), 21: (21, 19), 22: (22, 21), 23: (23, 18),
    24: (24, 23, 22, 17), 25: (25, 22), 26: (26, 6, 2, 1), 27: (27, 5, 2, 1), 28: (28, 25),
    29: (29, 27), 30: (30, 6, 4, 1), 31: (31, 28), 32: (32, 22, 2, 1), 33: (33, 20),
    34: (34, 27, 2, 1), 35: (35, 33), 36: (36, 25), 37: (37, 5, 4, 3, 2, 1), 38: (38, 6, 5, 1),
    39: (39, 35), 40: (40, 38, 21, 19),
}  # fmt: skip


def register_bits(order: int, count: int, *, state: int = 1) -> Bits:
    """Return the first bits that a register puts out; the sequence repeats after 2^order − 1 of them.

    Args:
        order: length of the register, a key of `TAPS`.
        count: how many bits.
        state: start value of the register; its lowest `order` bits are put out first, the lowest ahead.

    Returns:
        Zeros and ones, shape (count,). Bit j is the sum modulo 2 of the bits j − tap.
    """
    bits = np.zeros(max(count, order), dtype=np.uint8)
    bits[:order] = [(state >> i) & 1 for i in range(order)]
    # As many bits at a time as the shortest tap reaches back.
    block = min(TAPS[order])
    for begin in range(order, len(bits), block):
        end = min(begin + block, len(bits))
        for tap in TAPS[order]:
            bits[begin:end] ^= bits[begin - tap : end - tap]
    return bits[:count]


def jump(order: int, state: int, steps: int) -> int:
    """Return the state after `steps` bits without making them.

    The sequence obeys x^order = Σ x^(order − tap) over GF(2); x^steps modulo that polynomial says which
    of the bits from here on add up to the bit `steps` later.

    Args:
        order: length of the register.
        state: where it stands.
        steps: how far, any size.
    """
    chosen = _power(order, steps)
    bits = register_bits(order, 2 * order, state=state)
    after = 0
    for i in range(order):
        picked = sum(int(bits[i + j]) for j in range(order) if (chosen >> j) & 1)
        after |= (picked & 1) << i
    return after


def _power(order: int, exponent: int) -> int:
    """Return x^exponent modulo the register's polynomial, as the bits of an integer."""
    modulus = 1 << order
    for tap in TAPS[order]:
        modulus ^= 1 << (order - tap)
    result, base = 1, 2
    while exponent:
        if exponent & 1:
            result = _product(result, base, modulus, order)
        base = _product(base, base, modulus, order)
        exponent >>= 1
    return result


def _product(a: int, b: int, modulus: int, order: int) -> int:
    result = 0
    while b:
        if b & 1:
            result ^= a
        b >>= 1
        a <<= 1
        if (a >> order) & 1:
            a ^= modulus
    return result

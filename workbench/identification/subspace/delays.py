"""Known delays of the inputs: taken out of the data before identification, put into the model afterwards."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.errors import InputError

__all__ = ["advance", "as_tuple", "with_chains"]


Matrices = tuple[Floats, Floats, Floats, Floats]


def as_tuple(delay: int | Sequence[int], inputs: int) -> tuple[int, ...]:
    """Return the delay of every input [samples].

    Args:
        delay: one for all inputs, or one each.
        inputs: m.

    Raises:
        InputError: negative, or another number than inputs.
    """
    delays = (delay,) * inputs if isinstance(delay, int) else tuple(int(d) for d in delay)
    if len(delays) != inputs:
        raise InputError(f"delay: one number or one for each of the {inputs} inputs is needed, not {len(delays)}")
    if min(delays) < 0:
        raise InputError(f"delay must not be negative, not {min(delays)}")
    return delays


def advance(u: Floats, y: Floats, delays: tuple[int, ...]) -> tuple[Floats, Floats]:
    """Return the record without its delays: u(k − d) beside y(k), the first samples of y left out.

    Args:
        u: shape (N, m).
        y: shape (N, p).
        delays: of the inputs [samples].

    Raises:
        InputError: nothing is left.
    """
    longest = max(delays)
    if longest >= len(u):
        raise InputError(f"delay {longest} is as long as the record of {len(u)} samples")
    shifted = [u[longest - d : len(u) - d, j] for j, d in enumerate(delays)]
    return np.stack(shifted, axis=1), y[longest:]


def with_chains(model: Matrices, delays: tuple[int, ...]) -> Matrices:
    """Return the model with a chain of states z⁻ᵈ before each delayed input.

    Args:
        model: A, B, C, D from the delayed inputs.
        delays: of the inputs [samples].
    """
    A, B, C, D = model
    n, (p, m) = len(A), D.shape
    size = n + sum(delays)
    big = np.zeros((size, size)), np.zeros((size, m)), np.zeros((p, size)), np.zeros((p, m))
    big[0][:n, :n], big[2][:, :n] = A, C
    first = n
    for j, d in enumerate(delays):
        if d == 0:
            big[1][:n, j], big[3][:, j] = B[:, j], D[:, j]
            continue
        last = first + d - 1  # holds u(k − d)
        big[1][first, j] = 1.0
        big[0][range(first + 1, last + 1), range(first, last)] = 1.0
        big[0][:n, last], big[2][:, last] = B[:, j], D[:, j]
        first += d
    return big

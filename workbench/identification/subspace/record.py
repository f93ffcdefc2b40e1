"""A record, checked, scaled and without known delays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from workbench.core.values.arrays import Floats
from workbench.errors import InputError

__all__ = ["ScaledData", "advance", "as_tuple", "prepare", "with_chains"]


@dataclass(frozen=True, eq=False)
class ScaledData:
    """A record whose channels are of size one.

    Attributes:
        u: shape (N, m).
        y: shape (N, p).
        u_scale: shape (m,), size of the inputs (root mean square).
        y_scale: shape (p,), of the outputs.
        notes: doubts about the data.
    """

    u: Floats
    y: Floats
    u_scale: Floats
    y_scale: Floats
    notes: tuple[str, ...]


def prepare(u: ArrayLike, y: ArrayLike) -> ScaledData:
    """Return the record, checked and scaled.

    Args:
        u: shape (N, m) or (N,).
        y: shape (N, p) or (N,).

    Raises:
        InputError: not numbers, not finite, unequal lengths, a channel that never differs from zero.
    """
    inputs, outputs = _columns(u, "u"), _columns(y, "y")
    if len(inputs) != len(outputs):
        raise InputError(f"u has {len(inputs)} samples, y {len(outputs)}: the lengths must be equal")
    u_scale, y_scale = _scale(inputs, "u"), _scale(outputs, "y")
    notes = tuple(_offsets(inputs, "u") + _offsets(outputs, "y"))
    return ScaledData(inputs / u_scale, outputs / y_scale, u_scale, y_scale, notes)


def _columns(values: ArrayLike, what: str) -> Floats:
    try:
        given = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{what} must hold numbers") from None
    columns = given[:, None] if given.ndim == 1 else given
    if columns.ndim != 2 or 0 in columns.shape:
        raise InputError(f"{what} must have shape (samples, channels), not {given.shape}")
    bad = np.argwhere(~np.isfinite(columns))
    if len(bad):
        sample, channel = bad[0]
        raise InputError(
            f"{what}: column {channel + 1} holds {columns[sample, channel]} at sample {sample}; cut or repair it first"
        )
    return columns


def _scale(columns: Floats, what: str) -> Floats:
    largest = np.max(np.abs(columns), axis=0)
    dead = np.flatnonzero(largest == 0.0)
    if dead.size:
        raise InputError(f"{what}: column {dead[0] + 1} is always zero; leave it out")
    size: Floats = largest * np.sqrt(np.mean((columns / largest) ** 2, axis=0))
    return size


def _offsets(columns: Floats, what: str) -> list[str]:
    mean, spread = np.mean(columns, axis=0), np.std(columns, axis=0)
    return [
        f"{what}: column {k + 1} has a mean of {mean[k]:.3g} at a standard deviation of {spread[k]:.3g}: take off the "
        "operating point first, or the model may get a pole at 1 for it"
        for k in np.flatnonzero(np.abs(mean) > 3.0 * spread)
    ]


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

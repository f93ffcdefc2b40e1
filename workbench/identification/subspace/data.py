"""Checks and scaling of the record before identification."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from workbench.core.values.arrays import Floats
from workbench.errors import InputError

__all__ = ["ScaledData", "prepare"]


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

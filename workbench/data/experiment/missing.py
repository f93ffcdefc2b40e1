"""Missing samples: short gaps are filled, long ones divide the data."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from workbench.core.values.arrays import Floats
from workbench.errors import InputError

__all__ = ["filled", "regular"]

_SHORT = 5  # samples: longer gaps divide the data
_LEAST = 20  # samples that a piece must have
_EVEN = 1e-3  # of the interval


def regular(time: Floats, columns: Floats) -> tuple[Floats, Floats, int]:
    """Return times and columns with rows of NaN where rows are missing, and how many were.

    Args:
        time: shape (n,), rising [s]; steps are whole multiples of the smallest usual one, else nothing is changed.
        columns: shape (n, c).
    """
    steps = np.diff(time)
    if len(steps) == 0 or not np.all(steps > 0.0):
        return time, columns, 0
    dt = float(np.median(steps))
    whole = np.rint(steps / dt)
    if np.all(whole == 1.0) or np.any(np.abs(steps - whole * dt) > _EVEN * dt * np.maximum(whole, 1.0)):
        return time, columns, 0
    place = np.concatenate([[0], np.cumsum(whole)]).astype(int)
    every = np.full((place[-1] + 1, columns.shape[1]), np.nan)
    every[place] = columns
    return time[0] + dt * np.arange(len(every)), every, len(every) - len(time)


def filled(name: str, u: Floats, y: Floats) -> tuple[list[tuple[slice, Floats, Floats]], list[str]]:
    """Return the pieces between long gaps, short gaps filled: where they lie, inputs and outputs; and what was done.

    Outputs are interpolated linearly, inputs held.

    Args:
        name: of the data.
        u: shape (n, m), NaN where samples are missing.
        y: shape (n, p), likewise.

    Raises:
        InputError: no piece is long enough.
    """
    gone = np.asarray(~np.isfinite(np.hstack([u, y])).all(axis=1))
    if not gone.any():
        return [(slice(0, len(u)), u, y)], []
    keep: list[tuple[slice, Floats, Floats]] = []
    count = cut = 0
    for part in _pieces(gone):
        length = part.stop - part.start
        if length < _LEAST:
            cut += length
            continue
        here = gone[part]
        count += int(here.sum())
        keep.append((part, _held(u[part]), np.column_stack([_linear(column) for column in y[part].T])))
    if not keep:
        raise InputError(f"{name}: no piece of {_LEAST} samples is without long gaps")
    notes = [f"{name}: {count} missing samples filled, outputs linear, inputs held"] if count else []
    if len(keep) > 1:
        notes.append(f"{name}: gaps of more than {_SHORT} samples divide the data in {len(keep)} pieces")
    if cut:
        notes.append(f"{name}: {cut} samples in pieces shorter than {_LEAST} left out")
    return keep, notes


def _pieces(gone: NDArray[np.bool_]) -> list[slice]:
    """Return the stretches without a long gap; they begin and end with a sample that is there."""
    there = np.flatnonzero(~gone)
    if not len(there):
        return []
    breaks = np.flatnonzero(np.diff(there) > _SHORT + 1)
    starts = [there[0], *there[breaks + 1]]
    ends = [*there[breaks], there[-1]]
    return [slice(int(a), int(b) + 1) for a, b in zip(starts, ends, strict=True)]


def _linear(column: Floats) -> Floats:
    good = np.flatnonzero(np.isfinite(column))
    return np.asarray(np.interp(np.arange(len(column)), good, column[good]))


def _held(columns: Floats) -> Floats:
    held = columns.copy()
    for column in held.T:
        good = np.isfinite(column)
        last = np.maximum.accumulate(np.where(good, np.arange(len(column)), 0))
        column[:] = column[last]
    return held

"""What numbers, names and times must satisfy to be an experiment, and what becomes of missing samples."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from workbench.core.values.arrays import Floats
from workbench.errors import InputError, suggest

__all__ = ["EXACT", "check_choice", "check_finite", "columns", "filled", "names_of", "regular", "times", "units_of"]

EXACT = 1e-6  # of an interval: how far a time may lie off the grid without a word
_ROUNDED = 0.02  # likewise, with a note: times that were rounded when they were written


def columns(what: str, values: ArrayLike) -> Floats:
    """Return a copy of shape (n, columns).

    Raises:
        InputError: no array of numbers, or another shape.
    """
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{what} must be an array of numbers, one column per signal") from None
    if array.ndim == 1:
        array = array[:, None]
    if array.ndim != 2 or array.shape[1] == 0:
        raise InputError(f"{what} must have the shape (samples, columns), not {array.shape}")
    return array


def names_of(letter: str, given: Sequence[str] | None, count: int) -> tuple[str, ...]:
    """Return one name for each column.

    Raises:
        InputError: not as many as columns.
    """
    if given is None:
        return (letter,) if count == 1 else tuple(f"{letter}{i + 1}" for i in range(count))
    names = (given,) if isinstance(given, str) else tuple(given)
    if len(names) != count:
        raise InputError(f"{letter} has {count} columns, but {len(names)} names are given")
    return names


def units_of(kind: str, given: Sequence[str | None] | None, count: int) -> tuple[str | None, ...]:
    """Return one unit, or None, for each column.

    Raises:
        InputError: not as many as columns.
    """
    if given is None:
        return (None,) * count
    units = (given,) if isinstance(given, str) else tuple(given)
    if len(units) != count:
        raise InputError(f"{kind}s: {count} columns, but {len(units)} units are given")
    return units


def times(name: str, given: ArrayLike | float, count: int) -> tuple[Floats, tuple[str, ...]]:
    """Return the times, and a note where they had to be put on a grid.

    Raises:
        InputError: not as many as samples, not finite, not rising, not equidistant.
    """
    time = np.array(given, dtype=np.float64)
    if time.ndim == 0:
        dt = float(time)
        if not (math.isfinite(dt) and dt > 0.0):
            raise InputError(f"{name}: the sampling interval must be positive, not {dt:g} s")
        return np.asarray(dt * np.arange(count), dtype=np.float64), ()
    if time.shape != (count,):
        raise InputError(f"{name}: {time.size} times and {count} samples; the numbers must be equal")
    return _equidistant(name, time)


def _equidistant(name: str, time: Floats) -> tuple[Floats, tuple[str, ...]]:
    if not np.all(np.isfinite(time)):
        raise InputError(f"{name}: time is not finite at sample {int(np.argmin(np.isfinite(time)))}")
    steps = np.diff(time)
    if np.any(steps <= 0.0):
        k = int(np.argmax(steps <= 0.0))
        raise InputError(f"{name}: time does not rise at sample {k + 1}: {time[k]:.9g} s, then {time[k + 1]:.9g} s")
    grid: Floats = np.linspace(time[0], time[-1], len(time), dtype=np.float64)
    dt = grid[1] - grid[0]
    worst = float(np.max(np.abs(time - grid))) / dt
    if worst <= EXACT:
        return time, ()
    if worst <= _ROUNDED:
        note = f"times lie up to {100.0 * worst:.2g} % of an interval off the grid of {dt:.6g} s; put on it"
        return grid, (f"{name}: {note}",)
    usual = float(np.median(steps))
    k = int(np.argmax(np.abs(steps - usual)))
    raise InputError(
        f"{name}: time is not equidistant: {steps[k]:.6g} s after sample {k} (t = {time[k]:.6g} s), "
        f"{usual:.6g} s elsewhere; give dt to have the data put on a grid"
    )


def check_finite(name: str, kind: str, names: Sequence[str], values: Floats, time: Floats) -> None:
    """Refuse what is not a number, and say where it is.

    Raises:
        InputError: a value is not finite.
    """
    bad = ~np.isfinite(values)
    if not bad.any():
        return
    column = int(np.argmax(bad.any(axis=0)))
    k = int(np.argmax(bad[:, column]))
    many = int(bad[:, column].sum())
    more = f" and {many - 1} times more" if many > 1 else ""
    raise InputError(
        f"{name}: {kind} '{names[column]}' is {values[k, column]} at sample {k} (t = {time[k]:.6g} s){more}; "
        "cut these samples off, or let identify fill them (`repair`)"
    )


def check_choice(name: str, inputs: Sequence[str], outputs: Sequence[str], known: Sequence[str]) -> None:
    """Refuse an impossible choice of columns.

    Raises:
        InputError: no such column, none at all, one named twice.
    """
    for kind, chosen in (("input", inputs), ("output", outputs)):
        if not chosen:
            raise InputError(f"{name}: no {kind} is named; {suggest('', known)}")
        for column in chosen:
            if column not in known:
                raise InputError(f"{name}: there is no column '{column}'; {suggest(column, known)}")
    every = (*inputs, *outputs)
    twice = [column for column in every if every.count(column) > 1]
    if twice:
        raise InputError(f"{name}: column '{twice[0]}' is named twice; a column is either an input or an output, once")


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

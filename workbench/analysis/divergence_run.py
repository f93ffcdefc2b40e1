"""Why a simulation failed: run once more, recorded ever more densely towards the failure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from workbench.analysis.divergence import Divergence, DivergenceError, divergence
from workbench.errors import InputError, SimulationError
from workbench.model.base import Model
from workbench.session.base import Floats, Record, Session
from workbench.signals import Signal

__all__ = ["explained"]

_EVENLY = 400  # points over the run
_PER_HALVING = 4  # points in each half of the time that is left
_HALVINGS = 46
_CHUNK = 4  # points of one advance: what fails costs the last ones only
_NEAREST = 64.0  # times the spacing of numbers at the time of failure
_FIRST = ("finite escape", "exponential", "growing")


def explained(
    model: Model, error: SimulationError, *, start: float, signals: Mapping[str, Signal], names: Sequence[str]
) -> SimulationError:
    """Return the error that says what grew without bound, or `error` itself where nothing did.

    Args:
        model: that failed; a new session of it is run up to the failure.
        error: how it failed.
        start: session time at which it began [s].
        signals: forced inputs, as in the run that failed.
        names: variables that were recorded; states are looked at besides.
    """
    if error.time is None or not error.time > start:
        return error
    states = [v.name for v in model.states if v.is_number]
    every = list(dict.fromkeys([*names, *states]))
    try:
        with model.open_session(start_time=start, signals=dict(signals)) as session:
            seen = _followed(session, _points(start, error.time, session), signals, every)
    except (SimulationError, InputError):
        return error
    if seen is None or len(seen.time) < _EVENLY // 2:
        return error
    units = {v.name: v.unit for v in (*model.outputs, *model.states)}
    kinds = [divergence(seen.time, seen.values[n], variable=n, unit=units.get(n)) for n in every]
    found = [d for d in kinds if d is not None]
    worst = _worst([d for d in found if d.variable in names] or found)
    return error if worst is None else DivergenceError.of(worst, error, seen)


def _worst(found: Sequence[Divergence]) -> Divergence | None:
    """Return the growth that tells most: finite escape before exponential growth, then the variable named first."""
    return min(found, key=lambda d: _FIRST.index(d.kind), default=None)


def _points(start: float, end: float, session: Session) -> list[Floats]:
    """Return the points to record, in chunks, the last ones ever nearer to the end."""
    span = end - start
    evenly = start + span * np.arange(1, _EVENLY) / _EVENLY
    if session.communication_step is not None:
        return [evenly]
    left = span * 2.0 ** (-np.arange(_PER_HALVING * 3, _PER_HALVING * _HALVINGS) / _PER_HALVING)
    left = left[left > _NEAREST * np.spacing(abs(end))]
    every = np.unique(np.concatenate([evenly, end - left]))
    near = every > end - span / _EVENLY
    return [every[~near], *np.array_split(every[near], max(1, int(near.sum()) // _CHUNK))]


def _followed(
    session: Session, chunks: Sequence[Floats], signals: Mapping[str, Signal], names: Sequence[str]
) -> Record | None:
    """Advance as far as it goes; return what was recorded; None: nothing."""
    records: list[Record] = []
    for chunk in chunks:
        try:
            records.append(session.advance(float(chunk[-1]), signals=signals, record=names, points=chunk))
        except SimulationError:
            break
    if not records:
        return None
    return Record(
        time=np.concatenate([r.time for r in records]),
        values={n: np.concatenate([r.values[n] for r in records]) for n in names},
        inputs={n: np.concatenate([r.inputs[n] for r in records]) for n in signals},
    )

"""Time histories as requirements read them: rows where the signals bend, and what coarser rows leave out."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from workbench.core.records.option import recast
from workbench.core.values.arrays import Floats
from workbench.errors import WorkbenchError
from workbench.jobs.job import Job
from workbench.model.described_model import DescribedModel
from workbench.response.simulate.request import Simulate
from workbench.response.simulate.result import SimulationResult

__all__ = ["left_out", "with_rows_between"]

# Of a signal's range: how far it may be from the straight line between two rows. What is read of the record says what
# this leaves of its own error, so that a larger one makes more verdicts unknown, and no wrong one.
_STRAIGHT = 1e-3
_MOST = 100_000  # rows
_GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
_SAME = 1e-6  # of a communication step


def with_rows_between(request: Simulate, model: object, record: SimulationResult) -> tuple[SimulationResult, str]:
    """Return a record with rows between its own where a signal is not straight there, and what cannot be said of it.

    The run is repeated with a row more between any two, at places that no period fits to, so that an oscillation which
    each of the first rows meets at the same phase is seen; then with more rows beside those that a straight line does
    not meet, until all do.

    Args:
        request: what was run.
        model: that it was run on, open.
        record: of that run.
    """
    step = None
    if isinstance(model, DescribedModel) and model.interface == "cs":
        step = model.shortest_step
        if step is None:
            return record, ""  # it shows nothing between its communication points
    kept = _own(record)
    looked_at: NDArray[np.bool_] = np.ones(max(len(record.time) - 1, 0), dtype=np.bool_)
    found = record
    while len(kept) < _MOST:
        new = _between(found.time, looked_at, step)
        if not len(new):
            return found, ""
        kept = np.union1d(kept, new)
        try:
            asked = recast(
                Simulate, request, points=kept, interval=None, stop=float(record.time[-1]), verify_step=False
            )
            finer = asked.run(model, Job())  # type: ignore[arg-type]
        except WorkbenchError as error:
            return found, f"what lies between the rows is not known: {error}"
        looked_at = _bent(found, finer)
        found = replace(finer, notes=record.notes, step_change=_at_rows(record, finer.time))
        if not looked_at.any():
            return found, ""
    return found, f"the signals are not straight between {len(kept)} rows"


def _at_rows(record: SimulationResult, time: Floats) -> dict[str, Floats]:
    """Return what the communication step changes at other times: the larger change of the rows on both sides."""
    left = np.clip(np.searchsorted(record.time, time, side="left"), 0, len(record.time) - 1)
    right = np.clip(np.searchsorted(record.time, time, side="right") - 1, 0, len(record.time) - 1)
    return {name: np.maximum(change[left], change[right]) for name, change in record.step_change.items()}


def _own(record: SimulationResult) -> Floats:
    """Return the times of a record that are not the start's or those of events, which have rows in any case."""
    time = record.time
    twice = np.zeros(len(time), dtype=np.bool_)
    same = time[1:] == time[:-1]
    twice[1:] |= same
    twice[:-1] |= same
    twice[:1] = True
    return np.asarray(time[~twice])


def _between(time: Floats, looked_at: NDArray[np.bool_], step: float | None) -> Floats:
    """Return a time inside of each interval that is looked at [s]; where a step is given, a multiple of it."""
    width = np.diff(time)
    part = 0.2 + 0.6 * np.mod(_GOLDEN * np.arange(1, len(width) + 1), 1.0)
    chosen = np.flatnonzero(looked_at & (width > 0.0))
    new = time[chosen] + part[chosen] * width[chosen]
    if step is not None:
        new = time[0] + step * np.round((new - time[0]) / step)
        apart = np.minimum(new - time[chosen], time[chosen + 1] - new)
        new = new[apart > _SAME * step]
    inside = np.asarray(new[np.isfinite(new)])
    return np.asarray(inside[~np.isin(inside, time)])


def _bent(coarse: SimulationResult, fine: SimulationResult) -> NDArray[np.bool_]:
    """Return which intervals of a finer record, or their neighbours, no straight line of the coarser one meets."""
    bent: NDArray[np.bool_] = np.zeros(max(len(fine.time) - 1, 0), dtype=np.bool_)
    for name, values in fine.signals.items():
        if name in coarse.signals:
            span = float(np.ptp(values[np.isfinite(values)])) if np.isfinite(values).any() else 0.0
            off = np.flatnonzero(_off(coarse, fine, name) > _STRAIGHT * span)
            for beside in (-2, -1, 0, 1):
                bent[np.clip(off + beside, 0, len(bent) - 1)] = True
    return bent


def _off(coarse: SimulationResult, fine: SimulationResult, name: str) -> Floats:
    """Return how far each row of a finer record is from the straight line of the coarser one, shape (n,)."""
    time, values = coarse.time, coarse.signals[name]
    k = np.clip(np.searchsorted(time, fine.time, side="right") - 1, 0, max(len(time) - 2, 0))
    width = time[k + 1] - time[k]
    inside = (fine.time > time[k]) & (fine.time < time[k + 1])
    with np.errstate(all="ignore"):
        line = values[k] + (fine.time - time[k]) / np.where(width > 0.0, width, 1.0) * (values[k + 1] - values[k])
        return np.nan_to_num(np.where(inside, np.abs(fine.signals[name] - line), 0.0), nan=0.0, posinf=np.inf)


def left_out(record: SimulationResult, finer: SimulationResult) -> dict[str, list[float]]:
    """Return signal → how far it is, at most, from the straight line behind each row of a record; 0 behind the last.

    Args:
        record: that is kept.
        finer: of the same run, see `with_rows_between`.
    """
    result = {}
    for name in record.signals:
        most = np.zeros(len(record.time))
        k = np.clip(np.searchsorted(record.time, finer.time, side="right") - 1, 0, len(record.time) - 1)
        np.maximum.at(most, k, _off(record, finer, name))
        result[name] = most.tolist()
    return result

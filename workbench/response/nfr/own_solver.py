"""What a co-simulation shows of its own solver: what that gets wrong, and steps longer than those it is asked for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.errors import WorkbenchError
from workbench.model import Model
from workbench.response.nfr.communication_step import OF_HALVING
from workbench.response.nfr.point import PointTask

__all__ = ["hidden", "own_step"]

_STEPS = 64  # communication steps that are watched
_PERIODS = 2  # of a sine, for steps of the FMU's own
_FEWEST = 3  # jumps between stretches at rest that make a step of its own
_UNEVEN = 2  # communication steps: both ends of such a stretch are rounded to them


def hidden(model: Model, task: PointTask) -> str:
    """Return that nothing shows what the solver of a co-simulation leaves; empty where something does.

    From a step of the input, which both runs see alike, the output of a model with states is watched at the same
    instants with a communication step and with half of it and an eighth of the tolerance. A solver that makes the same
    steps inside gives the same numbers, to the last bit, whatever they are worth: its error cannot be known from
    outside. One that is good to rounding differs in that.

    Args:
        model: stays open.
        task: names, rows, and the lowest frequency, whose communication steps are the longest; the size of the step.
    """
    if model.interface != "cs" or not model.states or model.recipe is None or model.controls_step():
        return ""
    step = 1.0 / (task.frequency * task.rows)
    try:
        once = _watched(model, task, step, 1)
        with model.recipe.tighter(OF_HALVING).open() as other:
            again = _watched(other, task, step, 2)
    except WorkbenchError:  # the points tell
        return ""
    if np.ptp(once) == 0.0 or not np.array_equal(once, again):
        return ""
    return (
        "the error of the FMU's own solver is unknown and not included: neither half of a communication step of "
        f"{step:.3g} s nor a smaller tolerance changes {task.output}; a `step` below its own would show it"
    )


def _watched(model: Model, task: PointTask, step: float, parts: int) -> Floats:
    """Return the output at multiples of a step, each made in so many parts, after the input has jumped."""
    stepped = replace(task, amplitude=0.0, centre=task.centre + task.amplitude).sine(model.start_time)
    points = (model.start_time + step * np.arange(1, _STEPS + 1)).astype(np.float64)
    with model.open_session(signals={task.input: stepped}, step=step / parts) as session:
        record = session.advance(float(points[-1]), signals={task.input: stepped}, record=(task.output,), points=points)
        at = np.searchsorted(record.time, points - 0.25 * step / parts)
        return record.values[task.output][at]


def own_step(model: Model, task: PointTask) -> float:
    """Return how long the output stands still between two jumps while the input moves all the time [s].

    An FMU whose solver makes steps of its own that are longer than the communication step moves at some of the
    communication points only, each time after as many, and so does one that samples: from outside they are alike. An
    output that stands still now and then (a dead zone, a coarse converter) moves at other times, too, or irregularly.

    Args:
        model: stays open.
        task: names, rows, and the highest frequency, whose communication steps are the shortest; the size of the sine.

    Returns:
        That time; 0: there is no such time, or it is less than two steps of a run with twice the rows.
    """
    if model.interface != "cs" or model.controls_step() or task.rates:
        return 0.0
    step = 1.0 / (2 * task.rows * task.frequency)
    sine = task.sine(model.start_time)
    points = (model.start_time + step * np.arange(1, 2 * _PERIODS * task.rows + 1)).astype(np.float64)
    try:
        with model.open_session(signals={task.input: sine}, step=step) as session:
            rows = session.advance(float(points[-1]), signals={task.input: sine}, record=(task.output,), points=points)
    except WorkbenchError:  # the points tell
        return 0.0
    record = rows.right_limits()
    jumps = np.flatnonzero(np.diff(record.values[task.output]))
    gaps = np.diff(jumps)
    if len(jumps) < _FEWEST or gaps.min() < 2 or np.ptp(gaps) > _UNEVEN:
        return 0.0
    return float(record.time[jumps[-1]] - record.time[jumps[0]]) / len(gaps)

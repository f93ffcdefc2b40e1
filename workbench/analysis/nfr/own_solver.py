"""Whether a co-simulation shows what its own solver gets wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from workbench.analysis.nfr.point import PointTask
from workbench.analysis.nfr.step import OF_HALVING
from workbench.errors import WorkbenchError
from workbench.model import Model
from workbench.session.base import Floats

__all__ = ["hidden"]

_STEPS = 64  # communication steps that are watched


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
        f"{step:.3g} s nor a smaller tolerance changes {task.output}; a --step below its own would show it"
    )


def _watched(model: Model, task: PointTask, step: float, parts: int) -> Floats:
    """Return the output at multiples of a step, each made in so many parts, after the input has jumped."""
    stepped = replace(task, amplitude=0.0, centre=task.centre + task.amplitude).sine(model.start_time)
    points = (model.start_time + step * np.arange(1, _STEPS + 1)).astype(np.float64)
    with model.open_session(signals={task.input: stepped}, step=step / parts) as session:
        record = session.advance(float(points[-1]), signals={task.input: stepped}, record=(task.output,), points=points)
        at = np.searchsorted(record.time, points - 0.25 * step / parts)
        return record.values[task.output][at]

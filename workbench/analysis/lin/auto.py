"""Choose a method and say why."""

from __future__ import annotations

import numpy as np

from workbench.analysis.lin.task import LinTask, open_base
from workbench.errors import InputError

__all__ = ["choose"]


def choose(task: LinTask) -> tuple[str, str]:
    """Return the name of the method for a task, and the reason in one line.

    Co-simulation shows no states: response. Time events and discrete states: kalman-bertram. Given widths:
    difference. Directional derivatives: exact. Else difference.

    Args:
        task: the linearisation.

    Raises:
        InputError, SimulationError: the model cannot be evaluated at the point.
    """
    if task.model.interface == "cs":
        return "response", "auto: a co-simulation interface provides neither states nor derivatives"
    try:
        point = open_base(task)
    except InputError:
        if task.model.states:
            raise
        return "response", "auto: the model provides no states"
    with point:
        if len(point.ticks(1, np.inf)) and (point.memory or not point.states):
            return "kalman-bertram", "auto: the model has time events and discrete states"
        if task.dx is not None or task.du is not None:
            return "difference", "auto: widths are given"
        if why := point.why_not_exact():
            return "difference", f"auto: {why}"
    return "exact", "auto: the FMU offers directional derivatives"

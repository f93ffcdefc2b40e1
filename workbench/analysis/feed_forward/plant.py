"""The linear part of the system: from the control input, and from the block's output, to the block's input."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.analysis.describing.base import Complex
from workbench.analysis.feed_forward.wiring import COMMAND, OPENED, Loops, opened, reopen
from workbench.analysis.opened import linear_between
from workbench.core.linear import LinearPart
from workbench.core.operating_point import OperatingPoint
from workbench.errors import InputError
from workbench.model.described import DescribedModel

__all__ = ["Plant", "linear_plant"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Plant:
    """v = G u − H w with the feedback closed: v the block's input, w its output, u what is added to the control.

    Attributes:
        G: from the control input.
        H: from the block's output, with the sign turned.
        open_poles: shape (n,), without the feedback [1/s].
        poles: shape (n,), with it [1/s].
        notes: what the user should know.
    """

    G: LinearPart
    H: LinearPart
    open_poles: Complex
    poles: Complex
    notes: tuple[str, ...]


def linear_plant(model: DescribedModel, loops: Loops, *, at: OperatingPoint | None, time: float) -> Plant:
    """Linearise a system without its block and close the scalar feedback.

    Args:
        model: the system; it stays open.
        loops: block, target, feedback.
        at: operating point; None: the start values.
        time: session time [s].

    Raises:
        InputError: the target is driven already, no effect on the block, a feedback without solution.
        FmuError, SimulationError: the model cannot be opened or evaluated.
    """
    held = {} if at is None else {**at.x, **at.u}
    with model.open_at(time=time, values=held) as session:
        w = session.values([loops.ports.w])[loops.ports.w]
    with reopen(model, opened(model, loops)) as rest:
        found = linear_between(
            rest,
            {OPENED: w, COMMAND: None},
            ["seen", *(["fed_back"] if loops.source else [])],
            x={} if at is None else at.x,
            u={} if at is None else at.u,
            time=time,
        )
    if found.dt > 0.0:
        raise InputError(f"{model.name}: the linear part is sampled ({found.dt:g} s), but must be continuous")
    whole = found.with_feedback(loops.gain, input=1, output=1) if loops.source and loops.gain else found
    G = whole.part(1, 0)
    if not np.any(G.response(np.geomspace(1e-3, 1e3, 7))):
        raise InputError(f"{model.name}: {loops.target} has no effect on {loops.ports.v}")
    return Plant(
        G=G,
        H=whole.part(0, 0, sign=-1.0),
        open_poles=found.poles,
        poles=whole.poles,
        notes=tuple(f"linear part: {note}" for note in found.notes),
    )

"""The linear part of the system: from the control input, and from the block's output, to the block's input."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.core.values.arrays import Complex
from workbench.core.values.linear import LinearPart
from workbench.core.values.operating_point import OperatingPoint
from workbench.errors import InputError
from workbench.limit_cycles.feed_forward.weighting import Weighting, weighted
from workbench.limit_cycles.feed_forward.wiring import COMMAND, OPENED, SECOND, Loops, opened, reopen
from workbench.loops.opened_system import linear_between
from workbench.model.described_model import DescribedModel

__all__ = ["Plant", "linear_plant"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Plant:
    """v = G u − H w with the feedback closed: v the block's input, w its output, u what is added to the control.

    Attributes:
        G: from the control input, or from both by their weights.
        H: from the block's output, with the sign turned.
        open_poles: shape (n,), without the feedback [1/s].
        poles: shape (n,), with it [1/s].
        notes: what the user should know.
        weighting: how two control inputs share the filter's output; None: there is one.
    """

    G: LinearPart
    H: LinearPart
    open_poles: Complex
    poles: Complex
    notes: tuple[str, ...]
    weighting: Weighting | None = None


_PER_DECADE = 300  # frequencies at which two inputs are weighed


def linear_plant(
    model: DescribedModel,
    loops: Loops,
    *,
    at: OperatingPoint | None,
    time: float,
    band: tuple[float, float] = (0.1, 5.0),
    weighting: str = "absolute",
) -> Plant:
    """Linearise a system without its block and close the scalar feedback.

    Args:
        model: the system; it stays open.
        loops: block, target, feedback; the weights of a second input are found here.
        at: operating point; None: the start values.
        time: session time [s].
        band: frequencies at which two inputs are weighed [Hz].
        weighting: method of `weighted`.

    Raises:
        InputError: the target is driven already, no effect on the block, a feedback without solution.
        FmuError, SimulationError: the model cannot be opened or evaluated.
    """
    held = {} if at is None else {**at.x, **at.u}
    with model.open_at(time=time, values=held) as session:
        w = session.values([loops.ports.w])[loops.ports.w]
    with reopen(model, opened(model, loops)) as rest:
        result = linear_between(
            rest,
            {OPENED: w, COMMAND: None, **({SECOND: None} if loops.second is not None else {})},
            ["seen", *(["fed_back"] if loops.source else [])],
            x={} if at is None else at.x,
            u={} if at is None else at.u,
            time=time,
        )
    if result.dt > 0.0:
        raise InputError(f"{model.name}: the linear part is sampled ({result.dt:g} s), but must be continuous")
    whole = result.with_feedback(loops.gain, input=1, output=1) if loops.source and loops.gain else result
    G = whole.part(1, 0)
    if not np.any(G.response(np.geomspace(1e-3, 1e3, 7))):
        raise InputError(f"{model.name}: {loops.target} has no effect on {loops.ports.v}")
    H, shared = whole.part(0, 0, sign=-1.0), None
    if loops.second is not None:
        other = whole.part(2, 0)
        low, high = band
        f = np.geomspace(low, high, max(2, round(_PER_DECADE * np.log10(high / low))))
        shared = weighted(G.response(f), other.response(f), H.response(f), method=weighting)
        x, y = shared.weights
        G = LinearPart(G.A, x * G.B + y * other.B, G.C, x * G.D + y * other.D)
    return Plant(
        G=G,
        H=H,
        weighting=shared,
        open_poles=result.poles,
        poles=whole.poles,
        notes=tuple(f"linear part: {note}" for note in result.notes),
    )

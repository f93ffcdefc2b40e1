"""The linear part of the system: from the control input, and from the block's output, to the block's input."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.core.values.arrays import Complex
from workbench.core.values.linear import LinearPart
from workbench.core.values.operating_point import OperatingPoint
from workbench.errors import InputError
from workbench.limit_cycles.feed_forward.weighting import Weighting, weighted
from workbench.limit_cycles.feedback.closed_system import FeedbackPath
from workbench.loops.opened_system import Ports

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
    place: FeedbackPath,
    ports: Ports,
    gain: float,
    *,
    at: OperatingPoint | None = None,
    time: float = 0.0,
    band: tuple[float, float] = (0.1, 5.0),
    weighting: str = "absolute",
) -> Plant:
    """Linearise a system without its block and close the scalar feedback.

    Args:
        place: from the variable that is fed back to the target; the weights of its second target are found here.
        ports: of the block.
        gain: of the feedback; 0: there is none.
        at: operating point; None: the start values.
        time: session time [s].
        band: frequencies at which two inputs are weighed [Hz].
        weighting: method of `weighted`.

    Raises:
        InputError: no effect on the block, a feedback without solution.
        FmuError, SimulationError: the model cannot be opened or evaluated.
    """
    result = place.two_ports(ports, at or OperatingPoint(x={}, u={}), time=time)
    if result.dt > 0.0:
        raise InputError(f"{place.model.name}: the linear part is sampled ({result.dt:g} s), but must be continuous")
    whole = result.with_feedback(gain, input=1, output=1)
    G = whole.part(1, 0)
    if not np.any(G.response(np.geomspace(1e-3, 1e3, 7))):
        raise InputError(f"{place.model.name}: {place.target} has no effect on {ports.v}")
    H, shared = whole.part(0, 0, sign=-1.0), None
    if place.second is not None:
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

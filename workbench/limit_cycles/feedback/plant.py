"""Where a model stands, and its linear model between a feedback's target and source there."""

from __future__ import annotations

from dataclasses import dataclass

from workbench.core.values.operating_point import OperatingPoint
from workbench.limit_cycles.equilibrium import rest_of
from workbench.limit_cycles.feedback.actuator import Actuator
from workbench.limit_cycles.feedback.closed_system import DRIVE, SEEN, FeedbackPath
from workbench.loops.opened_system import linear_between
from workbench.model.described_model import DescribedModel
from workbench.point.lin.result import LinResult
from workbench.system.description import SystemDescription

__all__ = ["Standing", "linear", "standing"]

_SHIFT = 1e-4  # relative


@dataclass(frozen=True, eq=False)
class Standing:
    """An operating point.

    Attributes:
        point: states and inputs; empty where the model shows none.
        hidden: a session cannot be begun where another one stands: the model keeps more than its continuous states
            (discrete states, clocks, co-simulation), or does not take them.
        notes: one line each.
    """

    point: OperatingPoint
    hidden: bool
    notes: tuple[str, ...]


def standing(place: FeedbackPath, *, at: OperatingPoint | None, time: float) -> Standing:
    """Return where the model stands: at a given point, at its start if that is at rest, else where trim finds rest.

    Args:
        place: of the feedback.
        at: operating point; None: see above.
        time: session time [s].
    """
    model = place.model
    hidden = True
    notes: list[str] = []
    point = at or OperatingPoint(x={}, u={}, time=time)
    if model.interface == "me":
        hidden = _hides(model, time) or not _takes_states(model, time)
        if at is None:
            point, notes = rest_of(model, time=time, what="the gains are looked for at")
    return Standing(point, hidden, tuple(notes))


def _hides(model: DescribedModel, time: float) -> bool:
    with model.open_point(time=time) as point:
        return bool(point.memory) or len(point.ticks(1, 1e300)) > 0


def _takes_states(model: DescribedModel, time: float) -> bool:
    """Whether a session begins with the states that it is told."""
    names = [v.name for v in model.states]
    with model.open_session(start_time=time) as session:
        own = session.values(names)
    wanted = {n: x + _SHIFT * (1.0 + abs(x)) for n, x in own.items()}
    with model.open_at(time=time, values=wanted) as session:
        result = session.values(names)
    return all(abs(result[n] - x) <= _SHIFT**2 * (1.0 + abs(x)) for n, x in wanted.items())


def linear(
    place: FeedbackPath,
    where: Standing,
    *,
    time: float,
    actuator: Actuator | None = None,
    system: SystemDescription | None = None,
    more: tuple[dict[str, float], tuple[str, ...]] = ({}, ()),
    method: str = "auto",
) -> LinResult:
    """Linearise between the target and the source; further inputs come before, further outputs too.

    Args:
        place: of the feedback.
        where: operating point.
        time: session time [s].
        actuator: before the target.
        system: a changed one; None: as it is.
        more: further inputs with their values, further outputs.
        method: of `lin`.

    Raises:
        InputError: `lin` refuses.
        FmuError, SimulationError: a part cannot be opened or evaluated.
    """
    with place.opened(place.driven(system, actuator=actuator)) as opened:
        values = {**where.point.x, **where.point.discrete}
        return linear_between(
            opened,
            {**more[0], DRIVE: 0.0},
            [*more[1], SEEN],
            x={place.full(n): v for n, v in values.items()},
            u=place.inputs(where.point.u),
            time=time,
            method=method,
        )

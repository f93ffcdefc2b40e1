"""Where a model stands, and its linear model between a feedback's target and source there."""

from __future__ import annotations

from dataclasses import dataclass

from workbench.analysis.feedback.actuator import Actuator
from workbench.analysis.feedback.place import DRIVE, SEEN, Place
from workbench.analysis.lin.linearise import lin
from workbench.analysis.lin.result import LinResult
from workbench.analysis.operating_point import OperatingPoint
from workbench.analysis.trim import trim
from workbench.errors import WorkbenchError
from workbench.model.described import DescribedModel
from workbench.system.description import SystemDescription

__all__ = ["Standing", "linear", "standing"]

_AT_REST = 1e-9
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


def standing(place: Place, *, at: OperatingPoint | None, time: float) -> Standing:
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
            point, notes = _rest(model, time)
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
        found = session.values(names)
    return all(abs(found[n] - x) <= _SHIFT**2 * (1.0 + abs(x)) for n, x in wanted.items())


def _rest(model: DescribedModel, time: float) -> tuple[OperatingPoint, list[str]]:
    start = _start(model, time)
    if all(abs(v) <= _AT_REST for v in start.dx.values()):
        return start, []
    try:
        found = trim(model, time=time)
    except WorkbenchError as error:
        return start, [f"trim failed ({error}); the start values are taken, which are not at rest"]
    if found.converged:
        return found.point, ["the start is not at rest; the point that trim finds is taken"]
    return start, ["neither the start nor what trim finds is at rest; the start values are taken"]


def _start(model: DescribedModel, time: float) -> OperatingPoint:
    with model.open_point(time=time) as point:
        dx = point.at(point.x0, point.u0).dx
        return OperatingPoint(
            x={v.name: x for v, x in zip(point.states, point.x0.tolist(), strict=True)},
            u={v.name: u for v, u in zip(point.inputs, point.u0.tolist(), strict=True)},
            dx={v.name: d for v, d in zip(point.states, dx.tolist(), strict=True)},
            time=time,
        )


def linear(
    place: Place,
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
        states = {v.name for v in opened.states}
        inputs = {v.name for v in opened.inputs}
        full = {place.full(n): v for n, v in where.point.x.items()}
        return lin(
            opened,
            x0={**{n: x for n, x in full.items() if n in states}, **_discrete(place, where)},
            u0={**{n: u for n, u in place.inputs(where.point.u).items() if n in inputs}, **more[0], DRIVE: 0.0},
            inputs=[*more[0], DRIVE],
            outputs=[*more[1], SEEN],
            time=time,
            method=method,
        ).result


def _discrete(place: Place, where: Standing) -> dict[str, float]:
    return {place.full(n): v for n, v in where.point.discrete.items()}

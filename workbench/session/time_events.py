"""When a session's model wants its next time event."""

from __future__ import annotations

import math

from workbench.session.base import Session
from workbench.session.compiled import CompiledMeSession
from workbench.session.me import MeSession

__all__ = ["next_time_event", "to_next_event"]


def next_time_event(session: Session) -> float:
    """Return the time of the next time event [s]; infinite if there is none, or none that is shown.

    Co-simulation FMUs keep their events to themselves.
    """
    if isinstance(session, CompiledMeSession):
        return float(session._native.next_time)  # noqa: SLF001  the two sessions keep it in different places
    if isinstance(session, MeSession):
        return session._next_time  # noqa: SLF001
    return math.inf


def to_next_event(session: Session) -> float | None:
    """Advance over the next time event, inputs as they are; return its time [s], None if there is none.

    Raises:
        SimulationError: the model fails on the way.
    """
    time = next_time_event(session)
    if not math.isfinite(time):
        return None
    session.advance(max(time, session.time), signals={})
    session.advance(session.time, signals={})  # an event at the end of an advance belongs to the next one
    return time

"""Whether the solver of a co-simulation FMU begins at the start time that it is told."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from workbench.errors import WorkbenchError
from workbench.fmi.variable import FLOAT_TYPES
from workbench.session.base import Floats
from workbench.session.fmu import FmuSession, Setup
from workbench.session.probe import forced

__all__ = ["begins_at_zero"]

_SAME = 0.01  # of the gap that the start time makes
_DISTURBED = 0.125
_PARTS = np.arange(1, 9) / 8.0
_ROUNDING = 1e-13  # relative
_CLEAR = 1e-6  # relative: what differs by less says nothing


def begins_at_zero(open_session: Callable[[Setup], FmuSession], setup: Setup, step: float, *, states: bool) -> bool:
    """Return whether a first step from t0 to t0 + h begins at 0 all the same.

    The solvers of some exports keep a clock of their own, which begins at 0 whatever start time they are told, and
    integrate from there. Such a run begins with the values of one begun at 0, and has after one step those which that
    one has after a step to t0 and another of h. A model that depends on time, but keeps to its start, has not. Where no
    states are declared, what is the same to rounding on the way of eight steps, too, is a function of time, and right.

    Args:
        open_session: returns a session of co-simulation.
        setup: of the session that is to begin at `setup.start_time`, t0.
        step: h, its communication step [s].
        states: whether the FMU declares any.
    """
    begin, free = setup.start_time, replace(setup, signals={}, step=max(setup.start_time, step))
    if not begin > 0.0:
        return False
    try:
        told = _seen(open_session, free, (begin, begin + step))
        usual = _seen(open_session, replace(free, start_time=0.0), (0.0, step))
        by_then = _seen(open_session, replace(free, start_time=0.0), (begin, begin + step))
        slowly = _seen(open_session, replace(free, start_time=0.0), (*(begin * _PARTS), begin + step))
    except WorkbenchError:
        return False
    gap = np.abs(told[1] - usual[1])
    clear = gap > _CLEAR * np.maximum(np.abs(told[1]), np.abs(usual[1]))
    if not states:
        clear &= np.abs(slowly[-1] - by_then[1]) > _ROUNDING * np.abs(by_then[1])
    same = (np.abs(told[1] - by_then[1]) <= _SAME * gap) & (np.abs(told[0] - usual[0]) <= _SAME * gap)
    return bool(clear.any() and same[clear].all())


def _seen(open_session: Callable[[Setup], FmuSession], setup: Setup, times: Sequence[float]) -> Floats:
    """Return what is seen at some times, each a step after the one before, shape (times, n)."""
    rows = []
    with open_session(setup) as session:
        names = [n for n, v in setup.variables.items() if v.causality in ("output", "local") and v.type in FLOAT_TYPES]
        signals = forced(session, _DISTURBED)  # one at rest would not tell
        for time in times:
            if time > session.time:
                session.advance(time, signals=signals)
            rows.append(list(session.values(names).values()))
    return np.array(rows)

"""Probe whether an FMU's saved state can be trusted: take, disturb, restore, compare."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np

from workbench.errors import WorkbenchError
from workbench.session.fmu import FmuSession, Setup
from workbench.signals import Constant, Signal

__all__ = ["forced", "why_state_fails"]

RELATIVE = 1e-9


def why_state_fails(open_session: Callable[[Setup], FmuSession], setup: Setup) -> str:
    """Return why get, set and free of the FMU state do not bring a session back; empty if they do.

    A scratch session runs a little with disturbed inputs, twice after a restore of one saved state with another
    run between; all outputs, states and derivatives must agree.
    """
    scratch = dataclasses.replace(setup, state_works=lambda: True)
    try:
        with open_session(scratch) as session:
            return _difference(session)
    except WorkbenchError as error:
        return f"it fails: {error}"


def _difference(session: FmuSession) -> str:
    description = session.instance.description
    names = [v.name for v in description.variables if v.is_number and v.causality == "output"]
    known = session.setup.variables
    names += [v.name for v in (*description.states, *description.derivatives) if v.name in known]
    span = session.setup.step or description.experiment.step or 1e-3
    start = session.time
    session.advance(start + span, signals=forced(session, 0.125))
    saved = session.snapshot()
    before = _values(session, names)
    session.restore(saved)  # both runs begin with a solver that knows nothing
    first = _run(session, names, span, 0.5)
    _run(session, names, 2.0 * span, -0.5)
    session.restore(saved)
    back = _values(session, names)
    second = _run(session, names, span, 0.5)
    if not _alike(before, back):
        return "the values after a restore are not those that were saved"
    return "" if _alike(first, second) else "the same run after a restore gives other values"


def forced(session: FmuSession, shift: float) -> dict[str, Signal]:
    """Constant signals near the start values of the continuous inputs."""
    signals: dict[str, Signal] = {}
    for name, variable in session.inputs.items():
        if variable.is_continuous_input:
            start = float(variable.start or 0.0)
            signals[name] = Constant(start + shift * (abs(variable.nominal or start) or 1.0) * 1e-2)
    return signals


def _run(session: FmuSession, names: list[str], span: float, shift: float) -> list[float]:
    session.advance(session.time + span, signals=forced(session, shift))
    return _values(session, names)


def _values(session: FmuSession, names: list[str]) -> list[float]:
    values = session.values(list(dict.fromkeys(names)))
    return [session.time, *values.values()]


def _alike(a: list[float], b: list[float]) -> bool:
    scale = max(map(abs, a), default=0.0)
    close = np.allclose(a, b, rtol=RELATIVE, atol=RELATIVE * scale * 1e-3)
    return bool(close) and all(map(math.isfinite, b))

"""Probe whether an FMU's saved state can be trusted, and whether its solver begins at the start time it is told."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from workbench.core.values.arrays import Floats
from workbench.errors import WorkbenchError
from workbench.fmi.variable import FLOAT_TYPES
from workbench.session.fmu import FmuSession
from workbench.session.setup import Setup
from workbench.signals.kinds import Constant, Signal, Sine

__all__ = ["begins_at_zero", "forced", "slopes_act", "why_state_fails"]

RELATIVE = 1e-9
_SAMPLES = 1000  # of the fastest part, which show whatever it saves


def why_state_fails(open_session: Callable[[Setup], FmuSession], setup: Setup) -> str:
    """Return why get, set and free of the FMU state do not bring a session back; empty if they do.

    A scratch session runs a little with disturbed inputs, twice after a restore of one saved state with another
    run between; all outputs, states and derivatives must agree. A co-simulation FMU must also make the same steps
    whether or not a restore may come (noSetFMUStatePriorToCurrentPoint).
    """
    scratch = dataclasses.replace(setup, state_works=lambda: True)
    try:
        with open_session(scratch) as session:
            difference = _difference(session)
            if difference or session.instance.interface != "cs":
                return difference
        free, kept = (_course(open_session, scratch, keep=keep) for keep in (False, True))
    except WorkbenchError as error:
        return f"it fails: {error}"
    return "" if _alike(free, kept) else "while a state is kept it makes other steps (noSetFMUStatePriorToCurrentPoint)"


def _course(open_session: Callable[[Setup], FmuSession], setup: Setup, *, keep: bool) -> list[float]:
    """Return the values after two steps, while a state from before them is kept or none."""
    with open_session(setup) as session:
        _kept = session.snapshot() if keep else None
        span, names = _probed(session)
        return [x for shift in (0.125, 0.5) for x in _run(session, names, span, shift)]


def _probed(session: FmuSession) -> tuple[float, list[str]]:
    """Return how far a probe runs at a time [s], and what it looks at."""
    description = session.instance.description
    names = [v.name for v in description.variables if v.is_number and v.causality == "output"]
    known = session.setup.variables
    names += [v.name for v in (*description.states, *description.derivatives) if v.name in known]
    fastest = float(min((s.period for s in session.setup.samplers), default=math.inf))
    return min(session.setup.step or description.experiment.step or 1e-3, _SAMPLES * fastest), names


def _difference(session: FmuSession) -> str:
    span, names = _probed(session)
    _run(session, names, span, 0.125)
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


# -- do slopes of inputs act -------------------------------------------------------------------

_STEPS = 4
_PERIOD = 40.0  # steps


def slopes_act(open_session: Callable[[Setup], FmuSession], setup: Setup, step: float) -> bool:
    """Return whether a co-simulation FMU that takes slopes of its inputs makes anything of them.

    Sessions make a few steps under sines, with slopes and with held inputs: some exporters accept slopes and leave
    them. Where a run fails they are believed to act. An FMU that samples its inputs at communication points has no use
    for slopes, nor for another value of the input: it is the one whose outputs do not change where held inputs are
    given twice as often.

    Args:
        open_session: opens a session.
        setup: how it begins.
        step: communication step [s].
    """
    try:
        sloped, held = (_under_sines(open_session, setup, step, hold=hold, parts=1) for hold in (False, True))
        if not np.array_equal(sloped, held, equal_nan=True):
            return True
        often = _under_sines(open_session, setup, step, hold=True, parts=2)
    except WorkbenchError:
        return True
    return held.shape == often.shape and np.array_equal(held, often, equal_nan=True)


def _under_sines(
    open_session: Callable[[Setup], FmuSession], setup: Setup, step: float, *, hold: bool, parts: int
) -> NDArray[np.float64]:
    """Return the outputs after each of a few steps, made in so many parts, shape (steps, outputs)."""
    free = replace(
        setup, guesses={}, point={}, outputs={}, lead=None, step=step / parts, slopes_act=lambda: True,
        hold_inputs=hold,
    )  # fmt: skip
    with open_session(free) as session:
        outputs = [v.name for v in session.instance.description.variables if v.causality == "output"]
        known = [n for n in outputs if n in session.setup.variables and session.setup.variables[n].is_number]
        signals, result = _sines(session, step), []
        for number in range(1, _STEPS + 1):
            rows = session.advance(setup.start_time + number * step, signals=signals, record=known)
            result.append([float(rows.values[n][-1]) for n in known])
    return np.array(result, dtype=np.float64)


def _sines(session: FmuSession, step: float) -> dict[str, Signal]:
    """Sines about the start values of the continuous inputs."""
    result: dict[str, Signal] = {}
    for name, variable in session.inputs.items():
        if variable.is_continuous_input:
            start = float(variable.start or 0.0)
            size = 0.01 * (abs(variable.nominal or start) or 1.0)
            result[name] = Sine(amplitude=size, frequency=1.0 / (_PERIOD * step), offset=start)
    return result


# -- does the solver of a co-simulation FMU begin at the start time -------------------------------

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
        later = _seen(open_session, free, (begin, begin + step))
        usual = _seen(open_session, replace(free, start_time=0.0), (0.0, step))
        by_then = _seen(open_session, replace(free, start_time=0.0), (begin, begin + step))
        slowly = _seen(open_session, replace(free, start_time=0.0), (*(begin * _PARTS), begin + step))
    except WorkbenchError:
        return False
    gap = np.abs(later[1] - usual[1])
    clear = gap > _CLEAR * np.maximum(np.abs(later[1]), np.abs(usual[1]))
    if not states:
        clear &= np.abs(slowly[-1] - by_then[1]) > _ROUNDING * np.abs(by_then[1])
    same = (np.abs(later[1] - by_then[1]) <= _SAME * gap) & (np.abs(later[0] - usual[0]) <= _SAME * gap)
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

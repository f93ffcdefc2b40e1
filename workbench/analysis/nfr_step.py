"""Make the response of a co-simulation independent of its communication step, or say that it is not."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

from workbench.analysis.nfr_point import NfrPoint, PointTask, change
from workbench.errors import InputError

__all__ = ["at_step", "refine"]

# Points may cost this many communication steps each, all repetitions together.
_MOST_STEPS = 400_000

# Changes by halving the step that are accepted: gain (relative), phase [deg].
_GAIN, _PHASE_DEG = 0.005, 0.5

# With an explicit step a change beyond this is told (gain relative; phase in rad: the same error of the phasor).
_TELL = 0.01

_FEWEST_ROWS = 4

Run = Callable[[Sequence[PointTask]], list[NfrPoint]]


def refine(tasks: Sequence[PointTask], run: Run) -> list[NfrPoint]:
    """Measure points with ever smaller communication steps until the step no longer matters.

    The first run has 200 steps per period (or the FMU's own step, if that is smaller), each further
    run half the step of the one before. A point's answer is taken when gain and phase change by at
    most 0.5 % and 0.5° from one run to the next; where the output did not become periodic (see
    `Settling`), by at most errcrit (relative, rad), since more is not known of it. The finer
    run is reported. With a method of first order inside the FMU the error left is about the change seen.

    A point that needs more than 400 000 communication steps fails and says so.

    Args:
        tasks: one point, or the points of a carried sweep, which are run together.
        run: measures them in the order given.
    """
    new = run(tasks)
    budget = _MOST_STEPS * len(tasks) - _cost(tasks, new)
    while True:
        old, tasks = new, [replace(t, rows=2 * t.rows) for t in tasks]
        new = run(tasks)
        budget -= _cost(tasks, new)
        agreed = [_agree(o, n, t.errcrit) for o, n, t in zip(old, new, tasks, strict=True)]
        if all(agreed) or budget < 2 * _cost(tasks, new):
            return [n if good else _unconverged(o, n) for o, n, good in zip(old, new, agreed, strict=True)]


def at_step(tasks: Sequence[PointTask], step: float, run: Run) -> tuple[list[NfrPoint], list[str]]:
    """Measure points at a given communication step; warn where half of it gives another answer.

    The step is shortened so that a whole number of steps makes a period.

    Args:
        tasks: one point, or the points of a carried sweep.
        step: communication step [s].
        run: measures them in the order given.

    Returns:
        The points, and a warning for each of which gain or phase changes by more than 1 %
        (0.01 rad) when the step is halved.

    Raises:
        InputError: fewer than four steps make a period.
    """
    tasks = [replace(t, rows=_rows(t, step), fixed_step=True) for t in tasks]
    points = run(tasks)
    halved = run([replace(t, rows=2 * t.rows) for t in tasks])
    pairs = zip(points, halved, strict=True)
    return points, [_warning(p, h) for p, h in pairs if p.reason is None and max(_error(p, h)) > _TELL]


def _rows(task: PointTask, step: float) -> int:
    # A quotient within rounding of a whole number is that number.
    rows = math.ceil(1.0 / (task.frequency * step) - 1e-9)
    if rows < _FEWEST_ROWS:
        longest = 1.0 / (_FEWEST_ROWS * task.frequency)
        raise InputError(
            f"step: {step:g} s is too long for {task.frequency:g} Hz; at least {_FEWEST_ROWS} steps must make a "
            f"period, so take at most {longest:.3g} s"
        )
    return rows


def _cost(tasks: Sequence[PointTask], points: Sequence[NfrPoint]) -> int:
    return sum(max(1, p.periods) * t.rows for p, t in zip(points, tasks, strict=True))


def _error(old: NfrPoint, new: NfrPoint) -> tuple[float, float]:
    gain, phase_deg = change(old, new)
    return gain, math.radians(phase_deg)


def _agree(old: NfrPoint, new: NfrPoint, errcrit: float) -> bool:
    gain, phase_deg = change(old, new)
    if old.resolved and new.resolved:
        return gain <= _GAIN and phase_deg <= _PHASE_DEG
    return gain <= max(_GAIN, errcrit) and phase_deg <= max(_PHASE_DEG, math.degrees(errcrit))


def _unconverged(old: NfrPoint, new: NfrPoint) -> NfrPoint:
    step = f"communication step {new.step or 0.0:.3g} s"
    if new.reason is not None:
        why = f"{new.reason}, still at a {step}; take --interface me or a smaller --step"
    elif old.reason is not None:
        why = f"only a {step} gave an answer and nothing confirms it; take --interface me or a smaller --step"
    else:
        gain, phase_deg = change(old, new)
        why = (
            f"depends on the communication step: at a {step} halving it still changed the gain by "
            f"{100.0 * gain:.2g} % and the phase by {phase_deg:.2g} deg; take --interface me or a smaller --step"
        )
    return replace(new, response=None, offset=None, averaged=False, resolved=False, reason=why)


def _warning(point: NfrPoint, halved: NfrPoint) -> str:
    where = f"{point.frequency:.6g} Hz, amplitude {point.amplitude:g}"
    if halved.reason is not None:
        return f"{where}: half the communication step fails: {halved.reason}"
    gain, phase_deg = change(point, halved)
    return (
        f"{where}: half the communication step changes the gain by {100.0 * gain:.2g} % and the phase by "
        f"{phase_deg:.2g} deg; the answer depends on --step"
    )

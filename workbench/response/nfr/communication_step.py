"""Make the response of a co-simulation independent of its communication step, or say that it is not."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from workbench.errors import EndedError, InputError
from workbench.model import DescribedModel, Model
from workbench.response.nfr.certificate import finite
from workbench.response.nfr.point import NfrPoint, PointTask, change

__all__ = ["NOT_TIGHTER", "OF_HALVING", "at_own_step", "at_step", "checked", "refine", "rows_of_step", "wider"]

# Points may cost this many communication steps each, all repetitions together.
_MOST_STEPS = 400_000

# Change of the response (relative, complex) by halving the step that is accepted, and as a part of errcrit if less.
_CHANGE, _PART = 0.005, 0.05

# With a method of first order, what is left after a halving is this many times what it changed, at most.
_LEFT = 1.25

# Each halving changes a method of first order by half as much as the one before: by 2 within this, it is taken for one.
_FIRST_ORDER = 0.35

# What half the step makes of a tolerance: one of a step is the third power of its length, with extrapolation of order 1
# (of order 0 steps become shorter).
OF_HALVING = 0.125

# With an explicit step a change beyond this is told (gain relative; phase in rad: the same error of the phasor).
_TELL = 0.01

_FEWEST_ROWS = 4
_SAME = 1e-6  # of a step: rounding

# Why a point that settled by itself is not called so.
_DEPENDS = "half the communication step gives a different result"
NOT_TIGHTER = "what its own solver gets wrong is not in the error, since the FMU fails at a tighter tolerance"
SHORTER = "use a smaller `step`"  # what helps, where model exchange is not offered and the FMU names no step

Run = Callable[[Sequence[PointTask], int], list[NfrPoint]]  # what to measure, and how often its step was halved


def refine(tasks: Sequence[PointTask], run: Run, way: str) -> list[NfrPoint]:
    """Measure points with ever smaller communication steps until the step no longer matters.

    The first run has 200 steps per period (or the FMU's own step, if that is smaller), each further
    run half the step of the one before. A point's answer is taken when the response changes by at
    most 0.5 % (below errcrit 0.1: by 0.05 errcrit) from one run to the next; where the output did not become
    periodic (see `Settling`), by at most errcrit, since more is not known of it. The finer
    run is reported. With a method of first order inside the FMU the error left is about the change seen (1.08 times
    it for an explicit Euler method at a third of its resonance); 1.25 times the change is added to the point's.

    Where three runs show a method of first order (each halving changes half as much), the answer is what they tend to,
    2 R(h) − R(2h), and is taken when this changes as little from the last two pairs; what it changes is three times
    what is left of the next order, and is added to the point's error.

    A point that needs more than 400 000 communication steps fails and says so, unless that limit is known.

    Args:
        tasks: one point, or the points of a carried sweep, which are run together.
        run: measures them in the order given, at a step that was halved so often.
        way: what helps where the step matters.

    Source: Richardson extrapolation, e.g. Hairer, Nørsett & Wanner, Solving Ordinary Differential Equations I, II.9.
    """
    old: list[NfrPoint] = []
    new, halvings = run(tasks, 0), 0
    budget = _MOST_STEPS * len(tasks) - _cost(tasks, new)
    while True:
        before, old = old, new
        tasks = [replace(t, rows=2 * _rows(t, p)) for t, p in zip(tasks, new, strict=True)]
        halvings += 1
        new = run(tasks, halvings)
        budget -= _cost(tasks, new)
        limits = [_limit(*runs) for runs in zip(before, old, new, strict=True)] if before else [None] * len(new)
        last = budget < 2 * _cost(tasks, new)
        ends = [_end(*of_point, last=last, way=way) for of_point in zip(old, new, limits, tasks, strict=True)]
        if last or all(end is not None for end in ends):
            return [end or _unconverged(o, n, way) for end, o, n in zip(ends, old, new, strict=True)]


def _rows(task: PointTask, point: NfrPoint) -> int:
    """Return how many steps a period had: more than the rows asked for where the model's own step is shorter."""
    return task.rows if not point.step else max(task.rows, round(1.0 / (task.frequency * point.step)))


def _end(
    old: NfrPoint, new: NfrPoint, limit: tuple[NfrPoint, float] | None, task: PointTask, *, last: bool, way: str
) -> NfrPoint | None:
    """Return the answer of a point; None: a finer run is needed."""
    if new.kind == EndedError.kind:  # whatever the step
        return new
    if _agree(old, new, task.errcrit):
        return _certified(new, old, new, by="step", left=_LEFT * _apart(old, new), why=f"{_DEPENDS}; {way}")
    if limit is not None and (last or limit[1] <= _asked(task.errcrit)):
        return _certified(limit[0], old, new, by="step", left=limit[1], why=f"{_DEPENDS}; {way}")
    return None


def _limit(before: NfrPoint, old: NfrPoint, new: NfrPoint) -> tuple[NfrPoint, float] | None:
    """Return what three runs of a method of first order tend to, and its error (relative); None: not such a method.

    Args:
        before: with four times the step of the last.
        old: with twice that step.
        new: the last run.
    """
    runs = (before, old, new)
    first, second, third = (p.response for p in runs)
    if first is None or second is None or third is None or not all(p.resolved for p in runs):
        return None
    change_, last = second - first, third - second
    if not last or abs(change_ / last - 2.0) > _FIRST_ORDER:
        return None
    response = third + last
    offset = None if new.offset is None or old.offset is None else 2.0 * new.offset - old.offset
    known = None if new.error is None or old.error is None else 2.0 * new.error + old.error
    return replace(new, response=response, offset=offset, error=known), abs(2.0 * last - change_) / abs(response)


def at_step(tasks: Sequence[PointTask], step: float, run: Run, way: str) -> list[NfrPoint]:
    """Measure points at a given communication step; warn where half of it gives another answer.

    The step is shortened so that a whole number of steps makes a period.

    Args:
        tasks: one point, or the points of a carried sweep.
        step: communication step [s].
        run: measures them in the order given, at a step that was halved so often.
        way: what helps where the step matters.

    Returns:
        The points, with a warning where gain or phase changes by more than 1 % (0.01 rad) when the
        step is halved.

    Raises:
        InputError: fewer than four steps make a period.
    """
    tasks = [_at_step_of(t, step) for t in tasks]
    points = run(tasks, 0)
    halved = run([replace(t, rows=2 * t.rows) for t in tasks], 1)
    pairs = zip(points, halved, strict=True)
    words, why = "half the communication step", f"{_DEPENDS}; {way}"
    return [checked(p, h, by="step", words=words, why=why, times=1.0 + _LEFT) for p, h in pairs]


def at_own_step(points: Sequence[NfrPoint], tasks: Sequence[PointTask], own: float, run: Run) -> list[NfrPoint]:
    """Return points with what it may cost that the FMU was asked for steps shorter than its own.

    Between its own steps it holds input and output, whatever the communication step: half of that changes nothing, and
    the error does not show the holds. A model that samples is right with them; one that is continuous is not. What a
    communication step as long as the FMU's own changes (one hold less, and the delay of points between its steps), and
    the factor 1 / sinc(f T) of the hold that is left there, come to the error, which then holds for both.

    Args:
        points: measured.
        tasks: theirs.
        own: the FMU's own step [s]; 0: it has none, or none that shows.
        run: measures them in the order given.
    """
    if not any(_below(p, own) for p in points):
        return list(points)
    others = run([replace(t, rows=max(_FEWEST_ROWS, _rows_in(t.frequency, own)), fixed_step=True) for t in tasks], 0)
    words = f"a communication step as long as the FMU's own, {own:.3g} s,"
    why = f"the output moves every {own:.3g} s only; unless the model samples, use that as `step`"
    result = zip(points, others, strict=True)
    return [_held(p, checked(p, o, by="step", words=words, why=why, times=_LEFT), own, why) for p, o in result]


def _held(point: NfrPoint, compared: NfrPoint, own: float, why: str) -> NfrPoint:
    """Return `compared` with the hold that is left at the FMU's own step [s] in its error, where it matters."""
    if not _below(point, own):
        return point
    left = float(np.sinc(point.frequency * own)) if point.frequency * own < 1.0 else 0.0
    return wider(compared, 1.0 / left - 1.0 if left else math.inf, why)


def _below(point: NfrPoint, own: float) -> bool:
    """Whether at least two communication steps of a point make one of the FMU's own [s]."""
    return point.reason is None and point.step is not None and 2.0 * point.step <= own * (1.0 + _SAME)


def _at_step_of(task: PointTask, step: float) -> PointTask:
    """Return a task with so long a communication step, or slightly less [s].

    Raises:
        InputError: fewer than four steps make a period.
    """
    return replace(task, rows=rows_of_step(task.frequency, step), fixed_step=True)


def checked(point: NfrPoint, other: NfrPoint, *, by: str, words: str, why: str, times: float = 1.0) -> NfrPoint:
    """Return `point` with the outcome of a second measurement in certificate and error, and a warning if they differ.

    Args:
        point: what is reported.
        other: the second measurement.
        by: what was changed for it, for the certificate.
        words: the same for people.
        why: why the point is not called settled where they differ too much.
        times: by how many times that change the point is wrong: 2 for half the step of a method of first order.
    """
    if point.reason is not None:
        return point
    point = _certified(point, point, other, by=by, left=times * _apart(point, other), why=why)
    gain, phase_deg = change(point, other)
    where = f"{point.frequency:.6g} Hz, amplitude {point.amplitude:g}"
    if other.reason is not None:
        return replace(point, warning=f"{where}: {words} fails: {other.reason}")
    said = point.averaged and point.certificate is not None and point.certificate.why == why
    if said or max(gain, math.radians(phase_deg)) <= _TELL:
        return replace(point, warning=point.warning or other.warning)
    warning = (
        f"{where}: {words} changes the gain by {100.0 * gain:.2g} % and the phase by {phase_deg:.2g} deg; "
        f"the result depends on --{by}"
    )
    return replace(point, warning=warning)


def _certified(point: NfrPoint, old: NfrPoint, new: NfrPoint, *, by: str, left: float, why: str) -> NfrPoint:
    """Return `point` with the change from `old` to `new` in its certificate, and what is left of it in its error."""
    if point.certificate is None:
        return point
    gain, phase_deg = map(finite, change(old, new))
    certificate = replace(point.certificate, check=by, check_gain=gain, check_phase_deg=phase_deg)
    return wider(replace(point, certificate=certificate), left, why)


def wider(point: NfrPoint, left: float, why: str) -> NfrPoint:
    """Return a point with a larger error, no longer called settled where it is too large.

    Args:
        point: with a certificate.
        left: what comes to its error.
        why: said where the point is not settled for that.
    """
    if point.certificate is None:
        return point
    error = None if point.error is None else finite(point.error + left)
    too_large = point.status == "settled" and (error is None or error > 0.1 * point.certificate.errcrit)
    return replace(
        point,
        certificate=replace(point.certificate, why=why) if too_large else point.certificate,
        error=error,
        averaged=point.averaged or too_large,
        resolved=point.resolved and not too_large,
    )


def _apart(old: NfrPoint, new: NfrPoint) -> float:
    """Return by how much two measurements differ as complex numbers, relative to the second; inf where one failed."""
    if old.response is None or not new.response:
        return math.inf
    return abs(old.response - new.response) / abs(new.response)


def rows_of_step(frequency: float, step: float) -> int:
    """Return how many communication steps [s] make a period of `frequency` [Hz].

    Raises:
        InputError: too few to show a sine.
    """
    rows = _rows_in(frequency, step)
    if rows < _FEWEST_ROWS:
        longest = 1.0 / (_FEWEST_ROWS * frequency)
        raise InputError(
            f"step: {step:g} s is too long for {frequency:g} Hz; a period needs at least {_FEWEST_ROWS} "
            f"steps, so use at most {longest:.3g} s"
        )
    return rows


def shows(step: float | None, frequency: float) -> bool:
    """Whether there is a step [s], and enough of them make a period of `frequency` [Hz] to show a sine."""
    return bool(step) and _rows_in(frequency, step or 0.0) >= _FEWEST_ROWS


def other_step(model: Model, step: float | None, frequency: float) -> str:
    """Return in words the step that helps where model exchange is not offered.

    Args:
        model: of co-simulation.
        step: that was asked for [s]; None: it was found by halving.
        frequency: highest one [Hz].
    """
    declared = model.description.experiment.step if isinstance(model, DescribedModel) else None
    if step is not None or not shows(declared, frequency):
        return SHORTER
    return f"use `step={declared:.12g}`, which the FMU declares: it may be made for that one alone"


def _rows_in(frequency: float, step: float) -> int:
    """Return how many steps of at most that length make a period; what is a whole number but for rounding is one."""
    return math.ceil(1.0 / (frequency * step) - 1e-9)


def _cost(tasks: Sequence[PointTask], points: Sequence[NfrPoint]) -> int:
    return sum(max(1, p.periods) * t.rows for p, t in zip(points, tasks, strict=True))


def _agree(old: NfrPoint, new: NfrPoint, errcrit: float) -> bool:
    if old.response == new.response == 0.0:
        return True
    return _apart(old, new) <= (_asked(errcrit) if new.resolved else max(_CHANGE, errcrit))


def _asked(errcrit: float) -> float:
    return min(_CHANGE, _PART * errcrit)


def _unconverged(old: NfrPoint, new: NfrPoint, way: str) -> NfrPoint:
    step = f"communication step {new.step or 0.0:.3g} s"
    if new.reason is not None:
        why = f"{new.reason}, still at a {step}; {way}"
    elif old.reason is not None:
        why = f"only a {step} gave a result, and nothing confirms it; {way}"
    else:
        gain, phase_deg = change(old, new)
        why = (
            f"depends on the communication step: at a {step} halving it still changed the gain by "
            f"{100.0 * gain:.2g} % and the phase by {phase_deg:.2g} deg; {way}"
        )
    return replace(new, response=None, offset=None, averaged=False, resolved=False, reason=why)

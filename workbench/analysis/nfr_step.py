"""Make the response of a co-simulation independent of its communication step, or say that it is not."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

from workbench.analysis.certificate import finite
from workbench.analysis.nfr_point import NfrPoint, PointTask, change
from workbench.errors import InputError

__all__ = ["at_step", "checked", "refine", "rows_of_step"]

# Points may cost this many communication steps each, all repetitions together.
_MOST_STEPS = 400_000

# Change of the response (relative, complex) by halving the step that is accepted, and as a part of errcrit if less.
_CHANGE, _PART = 0.005, 0.05

# With a method of first order, what is left after a halving is this many times what it changed, at most.
_LEFT = 1.25

# With an explicit step a change beyond this is told (gain relative; phase in rad: the same error of the phasor).
_TELL = 0.01

_FEWEST_ROWS = 4

# Why a point that settled by itself is not called so.
_DEPENDS = {
    "step": "half the communication step gives another answer; take a smaller --step, or --interface me if it has one",
    "tolerance": "0.01 of the tolerance gives another answer; take a smaller --tolerance",
}

Run = Callable[[Sequence[PointTask]], list[NfrPoint]]


def refine(tasks: Sequence[PointTask], run: Run) -> list[NfrPoint]:
    """Measure points with ever smaller communication steps until the step no longer matters.

    The first run has 200 steps per period (or the FMU's own step, if that is smaller), each further
    run half the step of the one before. A point's answer is taken when the response changes by at
    most 0.5 % (below errcrit 0.1: by 0.05 errcrit) from one run to the next; where the output did not become
    periodic (see `Settling`), by at most errcrit, since more is not known of it. The finer
    run is reported. With a method of first order inside the FMU the error left is about the change seen (1.08 times
    it for an explicit Euler method at a third of its resonance); 1.25 times the change is added to the point's.

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
            ends = zip(
                old,
                (_certified(n, o, n, by="step", times=_LEFT) for o, n in zip(old, new, strict=True)),
                agreed,
                strict=True,
            )
            return [n if good else _unconverged(o, n) for o, n, good in ends]


def at_step(tasks: Sequence[PointTask], step: float, run: Run) -> list[NfrPoint]:
    """Measure points at a given communication step; warn where half of it gives another answer.

    The step is shortened so that a whole number of steps makes a period.

    Args:
        tasks: one point, or the points of a carried sweep.
        step: communication step [s].
        run: measures them in the order given.

    Returns:
        The points, with a warning where gain or phase changes by more than 1 % (0.01 rad) when the
        step is halved.

    Raises:
        InputError: fewer than four steps make a period.
    """
    tasks = [replace(t, rows=rows_of_step(t.frequency, step), fixed_step=True) for t in tasks]
    points = run(tasks)
    halved = run([replace(t, rows=2 * t.rows) for t in tasks])
    pairs = zip(points, halved, strict=True)
    return [checked(p, h, by="step", words="half the communication step", times=1.0 + _LEFT) for p, h in pairs]


def checked(point: NfrPoint, other: NfrPoint, *, by: str, words: str, times: float = 1.0) -> NfrPoint:
    """Return `point` with the outcome of a second measurement in certificate and error, and a warning if they differ.

    Args:
        point: what is reported.
        other: the second measurement.
        by: what was changed for it, for the certificate.
        words: the same for people.
        times: by how many times that change the point is wrong: 2 for half the step of a method of first order.
    """
    if point.reason is not None:
        return point
    point = _certified(point, point, other, by=by, times=times)
    gain, phase_deg = change(point, other)
    where = f"{point.frequency:.6g} Hz, amplitude {point.amplitude:g}"
    if other.reason is not None:
        return replace(point, warning=f"{where}: {words} fails: {other.reason}")
    told = point.averaged and point.certificate is not None and point.certificate.why == _DEPENDS[by]
    if told or max(gain, math.radians(phase_deg)) <= _TELL:
        return point
    warning = (
        f"{where}: {words} changes the gain by {100.0 * gain:.2g} % and the phase by {phase_deg:.2g} deg; "
        f"the answer depends on --{by}"
    )
    return replace(point, warning=warning)


def _certified(point: NfrPoint, old: NfrPoint, new: NfrPoint, *, by: str, times: float) -> NfrPoint:
    """Return `point` with the change from `old` to `new` in its certificate and, so many times, in its error."""
    if point.certificate is None:
        return point
    gain, phase_deg = map(finite, change(old, new))
    certificate = replace(point.certificate, check=by, check_gain=gain, check_phase_deg=phase_deg)
    error = None if point.error is None else finite(point.error + times * _apart(old, new))
    too_large = point.status == "settled" and (error is None or error > 0.1 * certificate.errcrit)
    return replace(
        point,
        certificate=replace(certificate, why=_DEPENDS[by]) if too_large else certificate,
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
    # A quotient within rounding of a whole number is that number.
    rows = math.ceil(1.0 / (frequency * step) - 1e-9)
    if rows < _FEWEST_ROWS:
        longest = 1.0 / (_FEWEST_ROWS * frequency)
        raise InputError(
            f"step: {step:g} s is too long for {frequency:g} Hz; at least {_FEWEST_ROWS} steps must make a "
            f"period, so take at most {longest:.3g} s"
        )
    return rows


def _cost(tasks: Sequence[PointTask], points: Sequence[NfrPoint]) -> int:
    return sum(max(1, p.periods) * t.rows for p, t in zip(points, tasks, strict=True))


def _agree(old: NfrPoint, new: NfrPoint, errcrit: float) -> bool:
    if old.response == new.response == 0.0:
        return True
    least = min(_CHANGE, _PART * errcrit)
    return _apart(old, new) <= (least if old.resolved and new.resolved else max(_CHANGE, errcrit))


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

"""Does the result depend on the start time?"""

from __future__ import annotations

import math
from dataclasses import replace

from workbench.errors import FmuError, InputError, SimulationError
from workbench.health.check.compare import largest_gap, usual_gap
from workbench.health.check.result import Answer
from workbench.health.check.subject import CheckedFmu, Trajectory, same_bits
from workbench.model.sample_rates import rates_of

__all__ = ["start_time"]

_FAR = 16  # test runs by which the start is moved: a power of two, so that times stay as exact as they are
_SAME = 1e-9
_TOLERANCE = 100.0  # times the integration's own: two runs may step differently by rounding
_BESIDE = 0.1
_TIGHTER, _SHRINKS = 1e-3, 0.3
_NUMERICAL = "none: the difference shrinks with a tighter tolerance, so it comes from the integration"
_OFF = 0.9371  # of the natural step: no communication point falls on a sampling instant
_AT_ZERO = "runs that begin later than at 0 are wrong, also co-simulation at a later operating point"
_CLOCK = (
    "linear models and responses hold only for the time at which they are made, which `start` gives to all commands; "
    "points of nfr may not settle"
)
_FAILS = "what begins so late fails, also co-simulation at a later operating point: let runs begin earlier (`start`)"


def start_time(subject: CheckedFmu) -> Answer:
    """Make the same run begin at t0 and at t0 + T: without an explicit dependence on time they are the same.

    Inputs jump once at the start and stand still. T is 16 test runs, or, where the model has a clock on absolute time
    (its time events, asked for by model exchange, are periodic), the multiple of the common period next to it.
    Tolerance: 100 times that of the integration, relative to the range, one point of ten set aside for jumps;
    what is larger counts only if it stays with a thousandth of the tolerance (else it is numerical: stiff or unstable
    models whose runs lie apart by more than they move).
    Broken: a co-simulation FMU begins at 0 whatever start time it is told, in that its first step is one from there.
    Watch: the runs differ by more. A source is allowed to depend on time, so that no promise is broken, but analyses
    that take the model as invariant must know. Not applicable: time events without a common period, and FMUs that do
    not repeat their own runs (see determinism).
    """
    try:
        period = _period(subject)
    except InputError as error:
        return Answer("not applicable", f"time events without a common period ({error})")
    shift = _FAR * subject.span if not period else period * math.ceil(_FAR * subject.span / period)
    h = (_OFF if subject.is_cs and period else 1.0) * subject.step
    try:
        first, later = (_run(subject, subject.start + t, h) for t in (0.0, shift))
    except (FmuError, SimulationError) as error:
        return Answer("watch", f"a run that begins at {subject.start + shift:.4g} s fails: {error}", _FAILS)
    result = _judge(subject, first, replace(later, time=first.time), shift, period)
    if subject.model.start_note:
        return Answer("broken", subject.model.start_note, _AT_ZERO, result.numbers)
    if result.verdict == "good":
        return result
    if not same_bits(first, _run(subject, subject.start, h)):
        return Answer("not applicable", "even the same run at the same time does not repeat itself (see determinism)")
    return result if _remains(subject, result, shift, h) else replace(result, verdict="good", consequence=_NUMERICAL)


def _judge(subject: CheckedFmu, first: Trajectory, later: Trajectory, shift: float, period: float) -> Answer:
    rtol = subject.model.recipe.tolerance or subject.model.description.experiment.tolerance or 1e-6
    limit = max(_TOLERANCE * rtol, _SAME)
    gaps = usual_gap(first, later, _BESIDE)
    gap = float(gaps.max(initial=0.0))
    clock = f" (common period of its samples {period:.6g} s)" if period else ""
    numbers = {"shift": shift, "relative": gap, "limit": limit, "period": period or None}
    if gap <= limit:
        return Answer("good", f"{shift:.4g} s later the same within {gap:.1g} of the range{clock}", numbers=numbers)
    worst = int(gaps.argmax())
    names = (subject.names[worst],)
    a, b = (Trajectory(t.time, t.values[:, [worst]]) for t in (first, later))
    words = largest_gap(a, b, names).words
    return Answer("watch", f"begun {shift:.4g} s later {words}", _CLOCK, numbers)


def _remains(subject: CheckedFmu, result: Answer, shift: float, h: float) -> bool:
    """Whether the gap stays with a tighter integration: what shrinks is numerical."""
    with subject.model.recipe.tighter(_TIGHTER).open() as model:
        tight = replace(subject, model=model)
        try:
            first, later = (_run(tight, subject.start + t, h) for t in (0.0, shift))
        except (FmuError, SimulationError):
            return True
    gap = float(usual_gap(first, later, _BESIDE).max(initial=0.0))
    return gap > _SHRINKS * float(result.numbers["relative"])


def _run(subject: CheckedFmu, start: float, h: float) -> Trajectory:
    points = subject.points(start, h)
    return subject.run(subject.constants(), start=start, step=h, points=points)


def _period(subject: CheckedFmu) -> float:
    """Return the common period of the model's time events [s]; 0: it has none, or they cannot be asked for.

    Raises:
        InputError: they follow no constant rates.
    """
    try:
        return rates_of(subject.model, time=subject.start, btptol=_SAME).period
    except (FmuError, SimulationError):
        return 0.0

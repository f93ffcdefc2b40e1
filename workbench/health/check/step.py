"""Does a co-simulation FMU converge with the communication step, how fast, and how far is it at its natural one?"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.errors import SimulationError
from workbench.health.check.compare import relative_gaps, usual_gap
from workbench.health.check.result import Answer
from workbench.health.check.subject import CheckedFmu, Trajectory
from workbench.health.check.swing import swing_of
from workbench.signals.kinds import Signal

__all__ = ["step"]

_COARSE = 64  # natural steps over which convergence is judged: short, so that unstable models do not fly away
_HALVINGS = 8
_FLOOR = 1e-9  # of the range: changes below it are rounding and the FMU's own tolerance
_STEADY = 0.25  # orders that close to each other are the order
_BESIDE = 0.1  # of the points may lie at a jump
_ORDERS = 3  # steady ones in a row, after which no finer step is tried

_EXACT, _FIRST, _FINE = 1e-4, 1.5, 1e-2
_ROUNDING = 1e-5  # what an FMU with error control leaves
_NO_ORDER = 0.5

_DIVERGES = 10.0  # times larger than with a shorter step
_SETTLED = 2.0
_FINEST_WHOLE = 5  # halvings of the whole test run

_AFFORDABLE = 10.0  # [s] of this computer that the default experiment may take at the natural step
_LOOKED = 200  # points of it


@dataclass(frozen=True)
class _Convergence:
    """Changes from each step to half of it, relative to the range.

    Attributes:
        steps: [s], falling.
        changes: shape (len(steps) − 1,); inf where the longer step failed.
        orders: log2 of each change over the next.
        order: the last steady one; NaN: none is seen.
        error: of the longest step, by Richardson's extrapolation from the shortest two.
        name: of the variable that has it.
        moves: whether anything moves.
    """

    steps: list[float]
    changes: list[float]
    orders: list[float]
    order: float
    error: float
    name: str = ""
    moves: bool = True


def step(subject: CheckedFmu) -> Answer:
    """Halve the communication step until the change falls steadily; then run long enough to see divergence.

    First inputs jump once and stand still, so that what is seen is the FMU's own integration. Over 64 natural steps h:
    y_k with step h/2^k, change d_k = max |y_k − y_(k+1)| over the range, observed order p = log2(d_k / d_(k+1)),
    y* = y_K + (y_K − y_(K−1)) / (2^p − 1) (Richardson), error of the natural step max |y_0 − y*|. One point of ten may
    differ by more: where a jump falls beside a communication point, rounding decides on which side. Then the same with
    inputs that swing as fast as the model follows them (see `swing_of`): where an FMU makes short steps of its own
    inside, only these show a communication step that is too long. At last, over the whole test run (at most 500
    natural steps), the largest excursion is compared with that of shorter steps until two of these agree within a
    factor of 2. A default experiment that is longer than a test run is made, too, where it takes less than 10 s at the
    natural step, inputs at rest: only there is seen what moves late.

    Broken: the excursion at the natural step is 10 times that of a short one, or it fails where a short one does not:
    the FMU diverges where the model does not. A model that is itself unstable passes, since it flies away with all
    steps. Watch: first order with an error above 1e-4, any order with one above 1 %, or no convergence; at a step that
    the user or the FMU names, also more than 1 % of the fastest output's range with swinging inputs, or more than 1 %
    of an output's range that half the step changes in the whole experiment. Not applicable: nothing moves, so that the
    effect of the step is unknown. Good: else.

    Source: Richardson, The approximate arithmetical solution by finite differences, Phil. Trans. A 210 (1911).
    """
    near = _converge(subject, subject.constants(), min(_COARSE, subject.steps))
    far, reached = _excursion(subject)
    swing = swing_of(subject)
    late = _late(subject)
    if isinstance(swing, str) and not near.moves and not late.moves:
        return Answer("not applicable", "; ".join(filter(None, [_still(subject), late.words])))
    swung = None if isinstance(swing, str) else _converge(swing.subject, swing.signals, swing.steps)
    numbers = {
        "step": subject.step, "own_step": subject.own_step is not None, "steps": near.steps,
        "changes": _plain(near.changes), "orders": _plain(near.orders), "order": _number(near.order),
        "error": _number(near.error), "excursion": _number(far), "excursion_step": reached,
        "diverges": far >= _DIVERGES, "swing_frequency": None if isinstance(swing, str) else swing.frequency,
        "swing_error": None if swung is None else _number(swung.error), "late_change": _number(late.change),
    }  # fmt: skip
    verdict, evidence, consequence = _verdict(subject, near, far, reached)
    verdict, consequence = _with_late(subject, late, verdict, consequence)
    if verdict == "broken":
        return Answer(verdict, evidence, consequence, numbers)
    at = f"at {_whose(subject)} {subject.step:.4g} s"
    seen = f"; {late.words}" if late.words else ""
    if isinstance(swing, str) or swung is None:
        unknown = f"; with moving inputs not known: {swing}" if subject.inputs else ""
        return Answer(verdict, f"{evidence} {at}{unknown}{seen}", consequence, numbers)
    without = "after a jump of the inputs" if subject.inputs else "with inputs at rest"
    evidence = f"{_share(swung)} {at} with {swing.words}; {without} {evidence}{seen}"
    if swung.error <= _FINE or subject.own_step is None:
        return Answer(verdict, evidence, consequence, numbers)
    return Answer("watch", evidence, consequence or _advice(subject, swung, subject.step), numbers)


def _still(subject: CheckedFmu) -> str:
    jump = "when its inputs jump by 5 % of their size" if subject.inputs else "and there are no continuous inputs"
    return f"unknown at {subject.step:.4g} s: nothing moves {jump}"


def _share(near: _Convergence) -> str:
    if not math.isfinite(near.error):
        return "fails"
    return f"error {float(f'{100.0 * near.error:.2g}'):g} % of the range of {near.name}"


def _verdict(subject: CheckedFmu, near: _Convergence, far: float, reached: float) -> tuple[str, str, str]:
    whose = _whose(subject)
    order = _order_words(near)
    if far >= _DIVERGES:
        times = "fails" if math.isinf(far) else f"{far:.3g} times too large"
        text = f"{order}, diverging at {whose} {subject.step:.4g} s ({times} after {subject.span:.3g} s; "
        return "broken", f"{text}not with {reached:.3g} s)", _advice(subject, near, reached)
    error = _share(near)
    if near.error <= _EXACT or (near.order >= _FIRST and near.error <= _FINE):
        return "good", f"{error} ({order})", ""
    return "watch", f"{order}, {error}", _advice(subject, near, subject.step)


def _whose(subject: CheckedFmu) -> str:
    if subject.model.recipe.step:
        return "the given step"
    return "its own step" if subject.own_step is not None else "its natural step"


def _order_words(near: _Convergence) -> str:
    if near.error <= _ROUNDING or (not near.order >= _NO_ORDER and near.error <= _EXACT):
        return "the step has almost no effect"
    if not near.order >= _NO_ORDER:
        return "no convergence" if math.isnan(near.order) else f"no convergence (order {round(near.order, 1) + 0.0:g})"
    names = {1: "first", 2: "second", 3: "third", 4: "fourth"}
    return f"{names.get(round(near.order), 'higher')} order ({near.order:.2f})"


def _advice(subject: CheckedFmu, near: _Convergence, reached: float) -> str:
    if near.order >= _NO_ORDER and near.error <= _FINE and reached >= subject.step:
        return subject.model.way_out("use a shorter `step` where that is too much: half the step leaves half the error")
    if near.order >= _NO_ORDER and 0.0 < near.error < math.inf:
        wanted = min(subject.step * (_FINE / near.error) ** (1.0 / near.order), reached)
        shorter = f"use `step={wanted:.1g}` (about 1 % then)"
    else:
        shorter = "use a shorter `step`, and compare"
    return f"{subject.model.way_out(shorter)}; nfr and simulate halve the step and tell"


# -- late: the default experiment as a whole ------------------------------------------------------


@dataclass(frozen=True)
class _Late:
    """What half the step changes in the whole default experiment, relative to the range; NaN: it was not run."""

    words: str = ""
    change: float = math.nan
    moves: bool = False


def _late(subject: CheckedFmu) -> _Late:
    """Compare the default experiment at the natural step and at half of it, inputs at rest, where it is longer."""
    h, span = subject.step, subject.experiment
    count = math.floor(span / h * (1.0 + 1e-9))
    if count <= subject.steps:
        return _Late()
    only = f"only {subject.span:.3g} s of {span:.4g} s were seen"
    if subject.shorten < 1.0:
        return _Late(only)
    begin = time.perf_counter()
    _reach(subject, h)
    seconds = (time.perf_counter() - begin) * count / subject.steps
    if seconds > _AFFORDABLE:
        return _Late(f"{only}: all of it would take {seconds:.2g} s")
    points = subject.start + h * np.unique(np.round(np.linspace(1.0, count, min(count, _LOOKED))))
    coarse, fine = (_try(subject, {}, points, step) for step in (h, 0.5 * h))
    if fine is None or coarse is None:
        return _Late(f"{only}: the run fails later on", math.nan if fine is None else math.inf)
    gaps = relative_gaps(coarse, fine)
    changes = np.minimum(gaps[1:], gaps[:-1]).max(axis=0, initial=0.0)  # alone is a point beside a jump
    change, moves = float(changes.max(initial=0.0)), bool((fine.scale > 0.0).any())
    name = subject.names[int(np.argmax(changes))] if len(changes) else "nothing"
    return _Late(f"over {span:.4g} s half of it changes {name} by {100.0 * change:.2g} % of its range", change, moves)


def _with_late(subject: CheckedFmu, late: _Late, verdict: str, consequence: str) -> tuple[str, str]:
    """Return the verdict and its consequence with what the whole experiment adds to them."""
    if verdict != "good" or not late.change > _FINE or subject.own_step is None:
        return verdict, consequence
    return "watch", subject.model.way_out("use a shorter `step`; simulate halves it, too, and tells")


# -- near: order and error ----------------------------------------------------------------------


def _converge(subject: CheckedFmu, signals: Mapping[str, Signal], count: int) -> _Convergence:
    points: Floats = subject.start + subject.step * np.arange(1.0, count + 1.0)
    runs: list[Trajectory | None] = []
    changes: list[float] = []
    for k in range(_HALVINGS + 1):
        runs.append(_try(subject, signals, points, subject.step / 2**k))
        if k:
            changes.append(_change(runs[-2], runs[-1]))
        if _enough(changes):
            break
    steps = [subject.step / 2**k for k in range(len(runs))]
    orders = _orders(changes)
    order = next((p for p in reversed(orders) if math.isfinite(p)), math.nan)
    errors = _errors(runs, order)
    name = subject.names[int(np.argmax(errors))] if len(subject.names) else ""
    moves = runs[-1] is None or bool((runs[-1].scale > 0.0).any())
    return _Convergence(steps, changes, orders, order, float(errors.max(initial=0.0)), name, moves)


def _try(subject: CheckedFmu, signals: Mapping[str, Signal], points: Floats, h: float) -> Trajectory | None:
    try:
        return subject.run(signals, step=h, points=points)
    except SimulationError:
        return None


def _change(coarse: Trajectory | None, fine: Trajectory | None) -> float:
    if coarse is None or fine is None:
        return math.inf
    return float(usual_gap(coarse, fine, _BESIDE).max(initial=0.0))


def _orders(changes: list[float]) -> list[float]:
    """Return log2 of successive changes; NaN where one of them is below the floor or is not a number."""
    good = [c if _FLOOR < c < math.inf else math.nan for c in changes]
    return [math.log2(a / b) for a, b in pairwise(good)]


def _enough(changes: list[float]) -> bool:
    if len(changes) >= 2 and max(changes[-2:]) <= _FLOOR:
        return True
    last = _orders(changes)[-_ORDERS:]
    steady = len(last) == _ORDERS and max(last) - min(last) <= _STEADY and min(last) >= _NO_ORDER
    return steady and changes[-1] <= _FINE


def _errors(runs: list[Trajectory | None], order: float) -> Floats:
    """Return the error of each variable in the first run against the extrapolated last; [inf] where one fails."""
    first, before, last = runs[0], runs[-2], runs[-1]
    if first is None or before is None or last is None:
        return np.array([math.inf])
    gain = 1.0 / (2.0**order - 1.0) if order >= _NO_ORDER else 0.0
    best = Trajectory(last.time, last.values + gain * (last.values - before.values))
    return usual_gap(first, best, _BESIDE)


# -- far: divergence ----------------------------------------------------------------------------


def _excursion(subject: CheckedFmu) -> tuple[float, float]:
    """Return how many times larger the excursion at the natural step is than at a short one, and that step [s].

    1 where all steps fail: then it is not the step.
    """
    h = subject.step
    first = reach = _reach(subject, h)
    for _ in range(_FINEST_WHOLE):
        before, h = reach, 0.5 * h
        reach = _reach(subject, h)
        if reach is not None and before is not None and _times(before, reach) <= _SETTLED:
            break
    if reach is None:
        return 1.0, subject.step
    return (math.inf if first is None else _times(first, reach)), h


def _reach(subject: CheckedFmu, h: float) -> Floats | None:
    """Return how far each variable gets from where it starts, None where the run fails."""
    try:
        result = subject.run(subject.constants(), step=h)
    except SimulationError:
        return None
    reach: Floats = np.abs(result.values - result.values[0]).max(axis=0, initial=0.0)
    return reach


def _times(coarse: Floats, fine: Floats) -> float:
    """Return the largest ratio of excursions of variables that move."""
    moving = fine > _FLOOR * fine.max(initial=0.0)
    return float(np.max(coarse[moving] / fine[moving], initial=1.0))


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _plain(values: list[float]) -> list[float | None]:
    return [_number(v) for v in values]

"""The search: stable first, then least maximum, from several starts; and what cannot be met together."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.errors import InputError
from workbench.study.tune.minimax import Evaluation, MinimaxEnd, SmoothPiece, minimax
from workbench.study.tune.problem import STABILITY, TuneProblem
from workbench.study.tune.result import Conflict, TradeOff

__all__ = ["Descent", "conflict_of", "descents", "made_stable", "measured_descent"]

_MET = 1e-6  # a value up to this counts as 0
_INSIDE = 1e-6  # of a limit's scale: what a hard requirement is met by, more than the solver leaves
_PAIRS = 4  # so many of the requirements that hold the result are looked at in pairs
_FURTHER = 6  # starts before a conflict is told: with 2 one of 20 planted ones was a local minimum of another pair
_CURVE = 7  # points of a trade-off


@dataclass(frozen=True, eq=False)
class Descent:
    """One search.

    Attributes:
        start: coordinates at which it began.
        end: where it ended; None: nothing could be evaluated.
        reason: how.
    """

    start: Floats
    end: MinimaxEnd | None
    reason: str


def descents(
    problem: TuneProblem, starts: Sequence[Floats], hard: Sequence[str], most: int, told: Callable[[str], None]
) -> list[Descent]:
    """Return the searches with the linear requirements from each start.

    Args:
        problem: what is to be met.
        starts: coordinates.
        hard: names of requirements that must be met.
        most: evaluations of each search.
        told: is called before each.
    """
    result = []
    for number, z in enumerate(starts, 1):
        told(f"start {number} of {len(starts)}")
        stable = made_stable(problem, z, most)
        if isinstance(stable, str):
            result.append(Descent(z, None, stable))
            continue
        first = owners(problem, hard)
        end = minimax(_inside(problem.pieces, first), stable, problem.free.limits, hard=first, most=most)
        result.append(Descent(z, end, "no step gains more" if end is not None and end.converged else "steps spent"))
    return result


def _inside(evaluate: Evaluation, hard: frozenset[int]) -> Evaluation:
    """Return pieces whose hard ones end a little inside their limits: a study knows no nearly."""

    def shifted(z: Floats) -> Sequence[SmoothPiece] | None:
        every = evaluate(z)
        return every and [replace(p, value=p.value + _INSIDE) if p.owner in hard else p for p in every]

    return shifted


def owners(problem: TuneProblem, names: Sequence[str]) -> frozenset[int]:
    """Return the numbers of the questions with these requirements, and of stability; where that is all, of that only.

    Args:
        problem: which has the questions.
        names: of requirements.
    """
    found = {k for k, q in enumerate(problem.questions) if q.requirement.name in names}
    return frozenset({STABILITY} | (found if len(found) < len(problem.questions) else set()))


def made_stable(problem: TuneProblem, z: Floats, most: int) -> Floats | str:
    """Return coordinates at which all linear models are stable, near z; or why there are none."""
    try:
        if problem.pieces(z) is not None:
            return z
        found = minimax(lambda x: _or_none(problem, x), z, problem.free.limits, enough=-1e-4, most=most)
    except InputError as error:
        return str(error)
    if found is None:
        return "a block refuses these values"
    if problem.pieces(found.z) is not None:
        return found.z
    return f"no values were found with which all is stable: {problem.unstable(found.z)}"


def _or_none(problem: TuneProblem, z: Floats) -> list[SmoothPiece] | None:
    try:
        return problem.instability(z)
    except InputError:
        return None


def measured_descent(problem: TuneProblem, z: Floats, hard: Sequence[str], most: int) -> Descent:
    """Return a search with all requirements, those that are not linear measured.

    Args:
        problem: what is to be met.
        z: where it begins.
        hard: names of requirements that must be met.
        most: evaluations.
    """
    first = owners(problem, hard)
    end = minimax(
        _inside(problem.mixed_pieces, first), z, problem.free.limits, hard=first, most=most, radius=0.1, enough=-0.02,
        tolerance=1e-3,
    )  # fmt: skip
    if end is None:
        return Descent(z, None, "a requirement could not be measured at the linear design")
    return Descent(z, end, "no measured step gains more" if end.converged else "measured steps spent")


def conflict_of(problem: TuneProblem, end: MinimaxEnd, names: Sequence[str], most: int) -> Conflict | None:
    """Return which linear requirements exclude each other; None: those that were looked at can be met together.

    First each by itself, then in pairs those that hold the result.

    Args:
        problem: what is to be met.
        end: a result that violates one.
        names: of requirements that are to be met.
        most: evaluations of each search.
    """
    weight: dict[str, float] = {}
    for owner, part in end.weights.items():
        if owner == STABILITY:
            continue
        name = problem.questions[owner].requirement.name
        weight[name] = weight.get(name, 0.0) + part
    above = {problem.questions[p.owner].requirement.name for p in end.pieces if p.owner >= 0 and p.value > _MET}
    holding = sorted((n for n in weight if n in names and (weight[n] > 1e-3 or n in above)), key=lambda n: -weight[n])
    holding = holding[:_PAIRS]
    singly: dict[str, Floats] = {}  # where each is met by itself: a pair that can be met, is often beside one of them
    for group in (*((n,) for n in holding), *combinations(holding, 2)):
        found = _alone(problem, [end.z, *(singly[n] for n in group if n in singly)], group, most)
        if found is not None and len(group) == 1:
            singly[group[0]] = found.z
        if found is not None and found.value > _MET:
            pair = _trade_off(problem, found, group, most) if len(group) == 2 else None
            return Conflict(requirements=group, excess=found.value, trade_off=pair)
    if len(holding) < 3 or (end.value <= _MET and end.hard <= _MET):
        return None
    return Conflict(requirements=tuple(holding), excess=max(end.value, end.hard))


def _alone(problem: TuneProblem, near: Sequence[Floats], names: Sequence[str], most: int) -> MinimaxEnd | None:
    """Return the best search with some requirements only: from near, and further starts while it violates one."""
    best: MinimaxEnd | None = None
    for start in (*near, *problem.free.further(_FURTHER)):
        stable = made_stable(problem, start, most)
        if isinstance(stable, str):
            continue
        end = minimax(
            lambda x: problem.pieces(x, names), stable, problem.free.limits, hard=frozenset({STABILITY}), enough=-_MET,
            most=most,
        )  # fmt: skip
        if end is not None and (best is None or end.value < best.value):
            best = end
        if best is not None and best.value <= _MET:
            break
    return best


def _trade_off(problem: TuneProblem, meeting: MinimaxEnd, pair: Sequence[str], most: int) -> TradeOff:
    """Return how well the second requirement can be met where the first one is held at a value."""
    points = sorted(_curve(problem, meeting, pair, most))
    return TradeOff(first=np.array([x for x, _ in points]), second=np.array([y for _, y in points]))


def _curve(problem: TuneProblem, meeting: MinimaxEnd, pair: Sequence[str], most: int) -> Iterator[tuple[float, float]]:
    first = owners(problem, pair[:1])
    top = 2.0 * meeting.value
    z = meeting.z
    for level in np.linspace(0.0, top, _CURVE)[::-1].tolist():

        def lowered(x: Floats, level: float = level) -> list[SmoothPiece] | None:
            found = problem.pieces(x, pair)
            own = first - {STABILITY}
            return found and [replace(p, value=p.value - level) if p.owner in own else p for p in found]

        end = minimax(lowered, z, problem.free.limits, hard=first, most=most)
        if end is None:
            return
        z = end.z
        own = max((p.value for p in end.pieces if p.owner in first - {STABILITY}), default=0.0) + level
        yield own, end.value

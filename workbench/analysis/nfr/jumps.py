"""Signs, in a nonlinear frequency response, that there is a second stable one."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from itertools import pairwise

from workbench.analysis.nfr.point import NfrPoint, PointTask
from workbench.analysis.nfr.solved import NotSolvedError, can_solve, solve_point
from workbench.analysis.nfr.surroundings import LinearStart
from workbench.analysis.periodic.period_map import PeriodMap
from workbench.errors import WorkbenchError
from workbench.model import Model
from workbench.session import Session
from workbench.session.compiled import CompiledMeSession
from workbench.workers import Job

__all__ = ["SecondJob", "another", "disagreements", "jumps", "may_jump"]

# A change between neighbouring frequencies this large, and this many times the changes beside it, is a jump.
_LARGE, _STEEPER = 0.5, 4.0

# A linear response does not jump; one this much distorted may.
_DISTORTED = 0.005

# Two measurements of one point that differ by more than this, and by more than so many times their errors, are two
# responses.
_APART, _ERRORS = 0.05, 3.0

# A response may fold back where it departs from the linear one by more than this, and is distorted by so much.
_BENT, _BENDS = 0.1, 3e-4
_MEMORY = 0.5

# On the way from one frequency to the next so many periods are run at each of a few between, at most this ratio apart,
# so that the sweep stays with the response it comes from.
_CARRIED, _APACE = 2, 1.04
_PATIENT = 20


def jumps(row: Sequence[NfrPoint]) -> list[str]:
    """Return a line for each place where the response jumps from one frequency to the next.

    A branch of periodic responses that folds back ends there, and the model goes to another branch, which must have
    been stable before the jump, too. Seen from four points on; only where the output is distorted.

    Args:
        row: points of one amplitude, rising in frequency.
    """
    good = [p for p in row if p.status == "settled" and p.response]
    changes = [_apart(a, b) for a, b in pairwise(good)]
    found = []
    for i, change in enumerate(changes):
        beside = [changes[k] for k in (i - 1, i + 1) if 0 <= k < len(changes)]
        low, high = good[i], good[i + 1]
        if change < _LARGE or len(beside) < 1 or len(good) < 4 or change < _STEEPER * max(beside):
            continue
        if max(_distortion(low), _distortion(high)) >= _DISTORTED:
            where = f"between {low.frequency:.6g} and {high.frequency:.6g} Hz, amplitude {low.amplitude:g}"
            gains = f"from gain {abs(low.response or 0.0):.4g} to {abs(high.response or 0.0):.4g}"
            found.append(
                f"{where}, the response jumps {gains}: on one side there are probably two stable responses; --branches "
                "shows all"
            )
    return found


def disagreements(
    points: Mapping[tuple[float, float], NfrPoint], before: Mapping[tuple[float, float], NfrPoint]
) -> list[str]:
    """Return a line if points settled at another response in an earlier run.

    Args:
        points: by amplitude and frequency.
        before: of the earlier run, likewise.
    """
    both = [(p, before[key]) for key, p in points.items() if key in before]
    differ = [(new, old) for new, old in both if new.status == old.status == "settled" and _contradict(new, old)]
    if not differ:
        return []
    new, old = differ[0]
    others = f" and {len(differ) - 1} more" if len(differ) > 1 else ""
    where = f"{new.frequency:.6g} Hz, amplitude {new.amplitude:g}{others}"
    gains = f"{abs(new.response or 0.0):.4g} in this run, {abs(old.response or 0.0):.4g} in the earlier one"
    return [f"{where}: two stable responses: gain {gains}"]


def _contradict(new: NfrPoint, old: NfrPoint) -> bool:
    errors = (new.error or 0.0) + (old.error or 0.0)
    return _apart(new, old) > max(_APART, _ERRORS * errors)


def _apart(a: NfrPoint, b: NfrPoint) -> float:
    """Return by how much two responses differ, relative to the larger one."""
    first, second = a.response or 0.0, b.response or 0.0
    largest = max(abs(first), abs(second))
    return abs(first - second) / largest if largest > 0.0 else 0.0


def _distortion(point: NfrPoint) -> float:
    return (point.certificate.thd or 0.0) if point.certificate is not None else 0.0


# -- looked for ------------------------------------------------------------------------------------------------------


def may_jump(row: Sequence[NfrPoint], linear: LinearStart | None) -> bool:
    """Return whether the responses of one amplitude are nonlinear enough for a second one to be worth a look.

    Args:
        row: points that were solved for.
        linear: the linear model where they start.
    """
    if len(row) < _FEWEST or any(p.certificate is None or p.certificate.method != "solved" for p in row):
        return False
    if linear is None or max(map(_distortion, row)) < _BENDS:
        return False
    return any(_bent(p, linear) > _BENT and _remembers(p) for p in row)


_FEWEST = 3  # points


def _remembers(point: NfrPoint) -> bool:
    """Whether a deviation outlives a period: without that, every period leads to the same response."""
    known = () if point.certificate is None else point.certificate.multipliers
    return max(map(abs, known), default=0.0) > _MEMORY


def _bent(point: NfrPoint, linear: LinearStart) -> float:
    forced = linear.forced(point.frequency)
    if forced is None or point.response is None:
        return 0.0
    largest = max(abs(forced.response), abs(point.response))
    return abs(abs(forced.response) - abs(point.response)) / largest if largest > 0.0 else 0.0


@dataclass(frozen=True, kw_only=True)
class SecondJob(Job):
    """Look for second responses: once rising and once falling in frequency, each begun where the one before stands.

    Attributes:
        tasks: the points of one amplitude, rising in frequency.
    """

    tasks: tuple[PointTask, ...]

    def run(self, model: Model) -> Iterator[Second]:
        yield Second(tuple(p for tasks in (self.tasks, self.tasks[::-1]) for p in self._carried(model, tasks)))

    def _carried(self, model: Model, tasks: Sequence[PointTask]) -> Iterator[NfrPoint]:
        session: Session | None = None
        before = tasks[0].frequency
        with ExitStack() as stack:
            for task in tasks:
                if session is None:
                    first = {task.input: task.sine(model.start_time)}
                    session = stack.enter_context(model.open_session(signals=first))
                if not can_solve(session, task):
                    return
                try:
                    _carry(session, task, before)
                    found = _stable_one(session, task)
                except WorkbenchError:
                    stack.close()
                    session = None
                else:
                    yield from found
                before = task.frequency


def _stable_one(session: CompiledMeSession, task: PointTask) -> list[NfrPoint]:
    """Return the stable response near to where a session stands; none: it was not reached soon."""
    for warm in (_CARRIED, _PATIENT):
        with suppress(NotSolvedError):
            found = solve_point(session, task, task.evidence(), warm=warm).point(task)
            if found.stable:
                return [found]
    return []


def _carry(session: CompiledMeSession, task: PointTask, before: float) -> None:
    """Go slowly from one frequency to that of a point."""
    steps = math.ceil(abs(math.log(task.frequency / before)) / math.log(_APACE))
    periods = PeriodMap(session, task.output, task.input, task.centre, task.rows)
    for i in range(1, steps):
        for _ in range(_CARRIED):
            if task.stopped():
                raise KeyboardInterrupt
            periods.lap(before * (task.frequency / before) ** (i / steps), task.amplitude)


@dataclass(frozen=True)
class Second:
    """What `SecondJob` found.

    Attributes:
        points: by frequency, each at most twice.
    """

    points: tuple[NfrPoint, ...]


def another(points: Mapping[tuple[float, float], NfrPoint], second: Sequence[NfrPoint], output: str) -> list[str]:
    """Return a line if there are other stable responses than those measured.

    Args:
        points: measured, by amplitude and frequency.
        second: found from elsewhere.
        output: name of the output.
    """
    found: dict[tuple[float, float], NfrPoint] = {}
    for p in second:
        mine = points.get((p.amplitude, p.frequency))
        if p.stable and mine is not None and mine.response is not None and _contradict(p, mine):
            found.setdefault((p.amplitude, p.frequency), p)
    if not found:
        return []
    key, other = min(found.items())
    here = points[key]
    span = f"{key[1]:.6g}" if len(found) == 1 else f"{key[1]:.6g} … {max(f for _, f in found):.6g}"
    gains = f"gain {abs(other.response or 0.0):.4g} besides {abs(here.response or 0.0):.4g} of {output}"
    what = f"{span} Hz, amplitude {key[0]:g}: there is another stable response, {gains} at {key[1]:.6g} Hz"
    return [f"{what}; which one is reached depends on the start; --branches shows all"]

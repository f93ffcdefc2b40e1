"""What one worker does for a nonlinear frequency response: a point, a carried amplitude, the zero input."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from workbench.analysis.nfr_point import NfrPoint, PointTask, run_fresh, run_point
from workbench.analysis.nfr_step import at_step, checked, refine
from workbench.analysis.zero_input import ZeroInput, watch
from workbench.errors import InputError
from workbench.model import Model
from workbench.signals import Sine
from workbench.workers import Job, Remark

__all__ = ["PointsJob", "ZeroInputJob"]

# A check by the tolerance takes so much of the one that the model has.
_TIGHTER = 0.01


@dataclass(frozen=True, kw_only=True)
class ZeroInputJob(Job):
    """Watch the model while the input is zero.

    Attributes:
        task: names and the lowest frequency; its amplitude is not used.
    """

    task: PointTask

    def run(self, model: Model) -> Iterator[ZeroInput | Remark]:
        yield watch(model, self.task)
        yield from map(Remark, model.remarks())


@dataclass(frozen=True, kw_only=True)
class PointsJob(Job):
    """Measure one point afresh, or several in one session.

    Attributes:
        tasks: the points, in the order to be measured.
        carry: whether one session serves all.
        step: communication step [s], checked once with half of it; None: found by halving.
        verify: model exchange: measure again with a hundredth of the tolerance.
    """

    tasks: tuple[PointTask, ...]
    carry: bool
    step: float | None
    verify: bool = False

    def streams(self, interface: str) -> bool:
        """Whether the points come one by one: after a crash it is known which one was at work."""
        return len(self.tasks) == 1 or (interface != "cs" and not self.verify)

    def run(self, model: Model) -> Iterator[NfrPoint]:
        if model.interface != "cs":
            yield from self._verified(model) if self.verify else self._pass(model, self.tasks)
        elif self.step is None:
            yield from refine(self.tasks, lambda tasks: list(self._pass(model, tasks)))
        else:
            yield from at_step(self.tasks, self.step, lambda tasks: list(self._pass(model, tasks)))

    def _pass(self, model: Model, tasks: Sequence[PointTask]) -> Iterator[NfrPoint]:
        """Measure `tasks` once: each afresh, or all in one session."""
        if self.carry:
            return carried(model, tasks)
        return (run_fresh(model, t) for t in tasks)

    def _verified(self, model: Model) -> Iterator[NfrPoint]:
        points = list(self._pass(model, self.tasks))
        if model.recipe is None:
            raise InputError(f"verify: the tolerance of {model.name}, which is no file, cannot be changed")
        with model.recipe.tighter(_TIGHTER).open() as exact:
            finer = list(self._pass(exact, self.tasks))
        for point, other in zip(points, finer, strict=True):
            yield checked(point, other, by="tolerance", words=f"{_TIGHTER:g} of the tolerance")


def carried(model: Model, tasks: Sequence[PointTask]) -> Iterator[NfrPoint]:
    """Measure in one session; after a failed point the next one begins in a new session."""
    rest = list(tasks)
    while rest:
        first = Sine(amplitude=rest[0].amplitude, frequency=rest[0].frequency)
        # One session serves all frequencies; the rows of each divide its period and bound the step.
        steps = [t.step for t in rest if t.step is not None]
        with model.open_session(signals={rest[0].input: first}, step=max(steps, default=None)) as session:
            while rest:
                task = rest.pop(0)
                point = run_point(session, task)
                yield point if model.interface == "cs" else replace(point, step=None)
                if point.reason is not None:
                    break

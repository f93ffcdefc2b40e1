"""Does the FMU give the same numbers in another process?"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace

from workbench.errors import FmuError, SimulationError, WorkbenchError
from workbench.health.check.compare import unlike
from workbench.health.check.result import Answer
from workbench.health.check.subject import CheckedFmu, Trajectory, same_bits
from workbench.jobs.job import Job
from workbench.jobs.options import Workers
from workbench.jobs.pool import Pool
from workbench.jobs.runner import Lost, perform
from workbench.jobs.runner import WorkItem as Work
from workbench.model import Model
from workbench.model.described_model import DescribedModel

__all__ = ["processes"]

_MIXED = "results of several workers, or of another day, do not belong to one model; nothing is repeatable"


@dataclass(frozen=True)
class _Seen:
    """What a process gave.

    Attributes:
        first, again: the same test run in its first instance and in another.
        names: of the variables.
    """

    first: Trajectory
    again: Trajectory
    names: tuple[str, ...]


@dataclass(frozen=True)
class _ProcessRuns(Work):
    """The test run of an interface, in the first instance of a process and in another."""

    interface: str
    shorten: float
    refine: int

    def run(self, model: Model) -> Iterator[_Seen | str]:
        if not isinstance(model, DescribedModel):
            return
        solver = model.recipe.solver if self.interface == "me" else "auto"
        with replace(model.recipe, interface=self.interface, solver=solver).open() as opened:
            subject = CheckedFmu(opened, self.shorten, self.refine)
            try:
                yield _Seen(subject.run(subject.sines()), subject.run(subject.sines()), subject.names)
            except (FmuError, SimulationError) as error:
                yield str(error)


def processes(subject: CheckedFmu, interface: str, where: Workers, job: Job) -> Answer:
    """Make the same run in two new processes, twice in each: equal to the last bit.

    The inputs swing as in `runs`. Broken: the processes differ by more than 1e-12 of a range, or the first instance of
    a process gives other numbers than the next, as with memory that nobody has set, static variables, or the number of
    the process; watch: by less (sums whose order changes, as with threads). Not applicable: it is to run elsewhere.

    Args:
        subject: what is checked, with the length and step of its test runs.
        interface: "me" or "cs".
        where: in which processes.
        job: ends the runs.

    Raises:
        WorkbenchError: the FMU cannot be opened.
    """
    if where.in_process or where.executor is not None or where.scheduler is not None:
        return Answer("not applicable", "it takes worker processes of this computer")
    result = [_in_a_new_process(subject, interface, where, job) for _ in range(2)]
    for one in result:
        if not isinstance(one, _Seen):
            return one
    a, b = (one for one in result if isinstance(one, _Seen))
    return _judged(a, b)


def _in_a_new_process(subject: CheckedFmu, interface: str, where: Workers, job: Job) -> _Seen | Answer:
    runs = deque([_ProcessRuns(interface, subject.shorten, subject.refine)])
    fails = "analyses that need this fail in the same way"
    with Pool(subject.model.recipe, jobs=1, limits=where.limits, fresh=True) as pool, job.ended_by(pool.stop):
        try:
            event = list(pool.run(perform, runs))[-1]  # the process may be lost after its reply
        except WorkbenchError as error:
            return Answer("watch", f"it fails: {error}", fails)
    if isinstance(event, Lost):
        return Answer("broken", event.reason, "it ends its process: such points are lost", finished=False)
    return event.value if isinstance(event.value, _Seen) else Answer("watch", f"it fails: {event.value}", fails)


def _judged(a: _Seen, b: _Seen) -> Answer:
    count = int(a.first.values.size)
    for where, other in (("in a second process", b.first), ("in the second instance of a process", a.again)):
        if not same_bits(a.first, other):
            return unlike(a.first, other, a.names, where, _MIXED, values=count)
    return Answer("good", f"2 processes, {count} values each: equal to the last bit", numbers={"values": count})

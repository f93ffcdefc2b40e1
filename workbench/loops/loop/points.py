"""Single points of a frequency response, several outputs at once, in the workers of an analysis."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from workbench.core.machine.closable import Closable
from workbench.jobs.job import Job
from workbench.jobs.options import Workers
from workbench.jobs.runner import Lost, perform
from workbench.jobs.runner_choice import choose
from workbench.model import Model
from workbench.response.nfr.job import PointsJob
from workbench.response.nfr.point import NfrPoint, PointTask, failed_point

__all__ = ["Bench"]


class Bench(Closable):
    """Measures points of one model, round by round, in the same workers.

    Args:
        model: what is measured; it stays open.
        workers: where.
        job: gets what the user should know of how they ran.
    """

    def __init__(self, model: Model, workers: Workers, job: Job) -> None:
        self._runner, self.notes = choose(model, workers)
        self._job = job

    def measure(self, tasks: Sequence[PointTask]) -> list[NfrPoint]:
        """Return the points of the tasks, in their order; one whose worker was lost has failed.

        Raises:
            FmuError, SimulationError: the model cannot be started.
        """
        jobs = [PointsJob(tasks=(task,), carry=False, step=None) for task in tasks]
        found: dict[int, NfrPoint] = {}
        for event in self._runner.run(perform, deque(jobs)):
            task = event.job.tasks[0]
            if isinstance(event, Lost):
                point = failed_point(task.frequency, task.amplitude, event.error)
            else:
                point = event.value
            found[id(event.job)] = point
        return [found[id(job)] for job in jobs]

    def close(self) -> None:
        """End the workers."""
        self._runner.close()
        self._job.notes += self._runner.remarks()

"""Single points of a frequency response, several outputs at once, in the workers of an analysis."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from workbench.core.machine.closable import Closable
from workbench.core.values.linear import LinearPart
from workbench.jobs.job import Job
from workbench.jobs.runner import Lost, perform
from workbench.jobs.runner_choice import choose
from workbench.loops.loop.request import Loop
from workbench.model import Model
from workbench.response.nfr.job import PointsJob
from workbench.response.nfr.point import NfrPoint, PointTask, failed_point

__all__ = ["Bench"]


class Bench(Closable):
    """Measures points of one model, round by round, in the same workers.

    Args:
        model: what is measured; it stays open.
        asked: where, and how long to wait for a point.
        job: gets what the user should know of how they ran.
        value: of the signal at the operating point [unit of the source].
        loop: linear L; None: not known.
    """

    def __init__(self, model: Model, asked: Loop, job: Job, *, value: float, loop: LinearPart | None) -> None:
        self._runner, self.notes = choose(model, asked.place)
        self._asked, self._job = asked, job
        self.value, self.loop = value, loop

    def measure(self, input: str, output: str, wanted: Sequence[tuple[float, float]]) -> list[NfrPoint]:
        """Return points in their order; one whose worker was lost has failed.

        Args:
            input: what is forced.
            output: what is measured.
            wanted: frequency [Hz] and amplitude of each.

        Raises:
            FmuError, SimulationError: the model cannot be started.
        """
        errcrit, most = self._asked.errcrit, self._asked.max_periods
        tasks = [
            PointTask(input=input, output=output, frequency=f, amplitude=a, errcrit=errcrit, max_periods=most)
            for f, a in wanted
        ]
        jobs = [PointsJob(tasks=(task,), carry=False, step=None) for task in tasks]
        result: dict[int, NfrPoint] = {}
        for event in self._runner.run(perform, deque(jobs)):
            task = event.job.tasks[0]
            if isinstance(event, Lost):
                point = failed_point(task.frequency, task.amplitude, event.error)
            else:
                point = event.value
            result[id(event.job)] = point
        return [result[id(job)] for job in jobs]

    def close(self) -> None:
        """End the workers."""
        self._runner.close()
        self._job.notes += self._runner.remarks()

"""The requirement of an envelope at points: measured on the workers, or taken from the store."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

from workbench.core.machine.closable import Closable
from workbench.core.records.option import recast
from workbench.errors import InputError
from workbench.jobs.job import Job
from workbench.jobs.options import Workers
from workbench.study.description import GridPoint, Study
from workbench.study.execute import Execution, Progress
from workbench.study.finished_store import Finished
from workbench.study.plan import Plan, PlannedRun, RunResult, make_plan
from workbench.study.requirements.base import Compliance, Requirement
from workbench.study.run import check_runs, finding_of

if TYPE_CHECKING:
    from workbench.jobs.runner import Lost, Reply, Runner
    from workbench.jobs.worker_main import Task

__all__ = ["Evaluator"]


class Evaluator(Closable):
    """Runs analyses of a study at points, on workers that stay warm from one call to the next.

    Args:
        study: whose analyses are run.
        finished: the store.
        workers: where they run.
        job: can end it.

    Attributes:
        measured: how many analyses were run.
        reused: how many were in the store.
        files: that they depend on → SHA-256.
        afterwards: what went wrong at the workers when all was told.
    """

    def __init__(self, study: Study, finished: Finished, workers: Workers, job: Job) -> None:
        self._study, self._finished, self._workers, self._job = study, finished, workers, job
        self._stack = ExitStack()
        self._runner: Runner | None = None
        self._interrupted = False
        self.measured = self.reused = 0
        self.files: dict[str, str] = {}

    @property
    def afterwards(self) -> tuple[str, ...]:
        """What went wrong at the workers when all was told."""
        return () if self._runner is None else tuple(dict.fromkeys(self._runner.afterwards))

    def outcomes(
        self,
        names: Sequence[str],
        points: Sequence[GridPoint],
        *,
        progress: Progress = lambda _done, _label: None,
        patient: bool = False,
    ) -> tuple[Plan, dict[PlannedRun, RunResult]]:
        """Run analyses at points.

        Args:
            names: of the analyses.
            points: where.
            progress: is told after each.
            patient: see `Execution`.

        Returns:
            What is run where, and what came out; what an interrupt left undone is missing.

        Raises:
            InputError: an analysis cannot be done at any point.
        """
        plan = make_plan(self._study.alone(names), points)
        execution = Execution(plan, finished=self._finished, folder=self._study.folder, patient=patient)
        self.reused += len(execution.outcomes)
        for run in plan.runs:
            self.files.update(run.subject["files"])
        progress(len(execution.outcomes), "")
        if execution.missing and not self.stopped:
            if self._runner is None:
                check_runs(self._study, execution.missing)
            try:
                execution.execute_on(self._open(), self._workers, progress)
            except KeyboardInterrupt:
                self._interrupted = True
        self.measured += execution.measured
        return plan, execution.outcomes

    def findings(
        self,
        requirement: Requirement,
        points: Sequence[GridPoint],
        *,
        progress: Progress = lambda _done, _label: None,
        patient: bool = False,
    ) -> list[Compliance | None]:
        """Return how a requirement came out at points; None where an interrupt came before.

        Args:
            requirement: to be met.
            points: where.
            progress: is told after each analysis.
            patient: see `Execution`.

        Raises:
            InputError: an analysis cannot be done at any point, or the requirement asks for what no result has.
        """
        plan, outcomes = self.outcomes(requirement.analyses, points, progress=progress, patient=patient)
        result: list[Compliance | None] = []
        wrong: list[InputError] = []
        for k in range(len(points)):
            runs = [plan.at[name, k] for name in requirement.analyses]
            try:
                there = all(run in outcomes for run in runs)
                result.append(finding_of(requirement, [outcomes[run] for run in runs]) if there else None)
            except InputError as error:
                wrong.append(error)
                result.append(Compliance(value=None, reason=str(error)))
        if wrong and len(wrong) == len(result) and not patient:
            raise wrong[0]
        return result

    def performed(self, task: Task, jobs: deque[Any]) -> Iterator[Reply | Lost]:
        """Do other work on the workers.

        Args:
            task: see `Runner.run`.
            jobs: its arguments.

        Raises:
            KeyboardInterrupt: the runner was stopped.
        """
        yield from self._open().run(task, jobs)

    def line_at(self, requirement: Requirement, point: GridPoint) -> list[str]:
        """Return the command lines that measure the requirement at a point again."""
        plan = make_plan(self._study.alone(requirement.analyses), [point])
        return [run.command_line for run in plan.runs]

    @property
    def stopped(self) -> bool:
        """Whether it was interrupted."""
        return self._interrupted or self._job.stopped

    def _open(self) -> Runner:
        from workbench.jobs.runner_choice import runner_for  # noqa: PLC0415 - what is in the store needs no workers

        if self._runner is None:
            # The worker of an analysis writes its files; that of the FMU, which it begins, is confined.
            self._runner = self._stack.enter_context(runner_for(recast(Workers, self._workers, confine=False)))
            self._stack.enter_context(self._job.ended_by(self._runner.stop))
        return self._runner

    def close(self) -> None:
        """End the workers. Any number of times."""
        self._stack.close()

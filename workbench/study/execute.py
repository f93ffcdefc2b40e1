"""Run what of a study is not in its store, in worker processes."""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from workbench.core.records.option import recast
from workbench.errors import InputError, WorkbenchError
from workbench.jobs.end_signals import INTERRUPTED
from workbench.jobs.options import Workers
from workbench.study.commands import Reference, filled
from workbench.study.finished_store import Finished
from workbench.study.plan import Plan, PlannedRun, RunResult

if TYPE_CHECKING:  # a study that is in its store as a whole needs no workers
    from workbench.jobs.job import Job
    from workbench.jobs.runner import Runner
    from workbench.study.worker import CommandJob

__all__ = ["Execution", "Progress"]

# Called with the number of runs done, and the label of the last one.
Progress = Callable[[int, str], None]


class Execution:
    """Runs a plan; what is finished is on disk before the next begins.

    Args:
        plan: what to run.
        finished: the store.
        folder: of the study.
        patient: whether an analysis that cannot be done at any of these points fails there, and is not an error.

    Attributes:
        outcomes: of the runs that are done.
        measured: how many were run now.
    """

    def __init__(self, plan: Plan, *, finished: Finished, folder: Path, patient: bool = False) -> None:
        self._plan, self._patient = plan, patient
        self._finished, self._folder = finished, folder
        self._jobs, self._confine = 1, False
        self.afterwards: tuple[str, ...] = ()
        self.outcomes: dict[PlannedRun, RunResult] = {}
        self.measured = 0
        self._reuse()

    def _reuse(self) -> None:
        for run in self._plan.runs:
            result = self._finished.load(run)
            if result is not None:
                self.outcomes[run] = result

    @property
    def missing(self) -> list[PlannedRun]:
        """Runs that are not done."""
        return [run for run in self._plan.runs if run not in self.outcomes]

    def execute(self, workers: Workers, job: Job) -> None:
        """Run what is missing.

        Args:
            workers: how many at a time, and the time for each analysis.
            job: is told after each, and can end it.

        Raises:
            InputError: an analysis asks for what cannot be done, at every point.
            WorkbenchError: the store cannot be written.
        """
        from workbench.jobs.runner_choice import runner_for  # noqa: PLC0415

        total = len(self._plan.runs)

        def progress(done: int, label: str) -> None:
            job.done(label, done, total)

        progress(len(self.outcomes), "")
        # The worker of an analysis writes its files; that of the FMU, which it begins, is confined.
        with runner_for(recast(Workers, workers, confine=False)) as runner:
            with job.ended_by(runner.stop), suppress(KeyboardInterrupt):  # what is missing tells
                self.execute_on(runner, workers, progress)
            self.afterwards = tuple(dict.fromkeys(runner.afterwards))

    def execute_on(self, runner: Runner, workers: Workers, progress: Progress) -> None:
        """Run what is missing on a runner that stays open.

        Args:
            runner: that runs the analyses.
            workers: it was made for.
            progress: is told after each.

        Raises:
            InputError, WorkbenchError: see `execute`.
            KeyboardInterrupt: the runner was stopped.
        """
        from workbench.jobs.limits import cores  # noqa: PLC0415

        self._jobs = 1 if workers.scheduler is not None else workers.jobs or cores()
        self._confine = workers.confine
        self._drive(runner, progress)

    def _drive(self, runner: Runner, progress: Progress) -> None:
        from workbench.jobs.runner import Lost  # noqa: PLC0415
        from workbench.study.worker import perform  # noqa: PLC0415

        runs = self.missing
        waiting = dict(enumerate(runs))
        queue: deque[CommandJob] = deque()
        self._release(waiting, queue)
        for reply in runner.run(perform, queue):
            run = runs[reply.job.number]
            outcome = RunResult(reason=reply.reason, kind=reply.kind) if isinstance(reply, Lost) else reply.value
            if outcome.code == INTERRUPTED:
                continue
            self._done(run, outcome)
            self._release(waiting, queue)
            progress(len(self.outcomes), run.label)

    def _done(self, run: PlannedRun, outcome: RunResult) -> None:
        self.measured += 1
        self.outcomes[run] = outcome
        self._finished.save(run, outcome)
        if outcome.kind == InputError.kind and not self._patient:
            self._refuse(run)

    def _refuse(self, run: PlannedRun) -> None:
        """What cannot be done at any point is a mistake in the study; at some points only, it is their failure."""
        same = [r for r in self._plan.runs if r.analysis is run.analysis]
        if all(r in self.outcomes and self.outcomes[r].kind == InputError.kind for r in same):
            raise InputError(f"[analyses.{run.analysis.name}]: {self.outcomes[same[0]].reason}")

    def _release(self, waiting: dict[int, PlannedRun], queue: deque[CommandJob]) -> None:
        """Put the runs whose references are there into the queue; those whose references failed, fail."""
        again = True
        while again:
            again = False
            for number, run in list(waiting.items()):
                if any(needed not in self.outcomes for needed in run.needs.values()):
                    continue
                del waiting[number]
                lacking = self._lacking(run)
                if lacking:
                    self.outcomes[run] = RunResult(reason=lacking, kind=WorkbenchError.kind)
                    again = True
                else:
                    queue.append(self._job(number, run))

    def _lacking(self, run: PlannedRun) -> str:
        """Return why a run cannot begin; empty: it can."""
        for reference in run.analysis.references:
            needed = run.needs[reference.analysis]
            outcome = self.outcomes[needed]
            if outcome.result is None:
                return f"it needs {needed.label}, which failed: {outcome.reason}"
            if reference.kind != "json" and reference.kind not in outcome.files:
                return f"{needed.label} wrote no '{reference.kind}'; it wrote: {', '.join(outcome.files) or 'none'}"
        return ""

    def _job(self, number: int, run: PlannedRun) -> CommandJob:
        from workbench.study.worker import CommandJob  # noqa: PLC0415

        workplace = self._finished.workplace(run)
        command = run.analysis.command
        table = filled(run.options, lambda reference: self._file(reference, run, workplace))
        return CommandJob(
            number=number,
            command=command.name,
            subject=[str(model.model) for model in run.models],
            options={**table, **self._own(run, workplace)},
            command_line=run.command_line,
            folder=self._folder,
            workplace=workplace,
            csv=run.analysis.name if run.wants else "",
            confine=self._confine,
            files=run.subject["files"],
            rows=run.rows,
        )

    def _own(self, run: PlannedRun, workplace: Path) -> dict[str, Any]:
        """Return what the study adds: a store for the points of an analysis but those that failed, and few jobs."""
        known, given = run.analysis.command.options, run.options
        own: dict[str, Any] = {}
        if "store" in known:
            own["store"] = str(workplace / "points")
        if "redo" in known and "redo" not in given:
            own["redo"] = ["failed"]
        if "jobs" in known and "jobs" not in given and not given.get("in-process"):
            own["jobs"] = max(1, self._jobs // max(1, len(self.missing)))
        return own

    def _file(self, reference: Reference, run: PlannedRun, workplace: Path) -> str:
        """Write what a reference stands for into a file; return its name."""
        outcome = self.outcomes[run.needs[reference.analysis]]
        text, suffix = _content(reference, outcome)
        path = workplace / f"of_{reference.analysis}_{reference.kind}.{suffix}"
        path.write_text(text, encoding="utf-8")
        return str(path)


def _content(reference: Reference, outcome: RunResult) -> tuple[str, str]:
    if reference.kind == "json":
        return json.dumps(outcome.result), "json"
    return outcome.files[reference.kind], "csv"

"""Run a study: what its store lacks is measured, then everything is compared with the requirements."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from workbench.study.bundled import is_bundled_study
from workbench.study.commands import Commands
from workbench.study.description import Study
from workbench.study.evaluate import answer, questions
from workbench.study.execute import Execution, Progress
from workbench.study.finished import FOLDER, Finished
from workbench.study.place import place
from workbench.study.plan import Plan, Run, make_plan
from workbench.study.read import read_study
from workbench.study.references import check_arguments
from workbench.study.result import Checked, StudyResult

if TYPE_CHECKING:
    from workbench.workers import Workers

__all__ = ["StudyRun", "default_store"]


def default_store(name: str | Path) -> Path:
    """Return the folder that keeps the results of a study: beside it, of a bundled one in the present folder."""
    return Path(FOLDER) if is_bundled_study(str(name)) else Path(name).expanduser().parent / FOLDER


class StudyRun:
    """A study, its plan and its store.

    Args:
        name: of the study: a path, or `study:NAME`.
        commands: that do its analyses.
        store: folder of finished analyses; None: nothing is kept.
        fresh: whether everything is measured again.

    Attributes:
        study: as it is written down.
        plan: what it runs.

    Raises:
        InputError: the study cannot be read, or the store cannot be used.
    """

    def __init__(self, name: str | Path, commands: Commands, *, store: Path | None, fresh: bool = False) -> None:
        self.study: Study = read_study(name, commands)
        self._commands, self._store, self._fresh = commands, store, fresh
        with place(str(self.study.path)):
            self.plan: Plan = make_plan(self.study, commands)
        self._execution: Execution | None = None

    @property
    def total(self) -> int:
        """Number of analyses at all points."""
        return len(self.plan.runs)

    def _check(self, runs: Sequence[Run]) -> None:
        """Look for mistakes before anything runs; what is in the store had none."""
        from workbench.study.names import check_names  # noqa: PLC0415 - a study in its store opens no model

        for analysis in {run.analysis.name: run.analysis for run in runs}.values():
            check_arguments(analysis, self._commands)
        check_names(self.study, runs)

    def _checked(self, finished: Finished, execution: Execution) -> list[Checked]:
        """Return every requirement, as it came out before where nothing is new."""
        every = questions(self.study, self.plan)
        if not execution.measured and not execution.missing:
            kept = finished.load_findings(every)
            if kept is not None:
                return [replace(c, finding=finding) for c, finding in zip(every, kept, strict=True)]
        checked = [answer(c, execution.outcomes) for c in every]
        if not execution.missing and all(o.lasting for o in execution.outcomes.values()):
            finished.save_findings(checked)
        return checked

    def stop(self) -> None:
        """Let `run` end soon; a signal handler may call it."""
        if self._execution is not None:
            self._execution.stop()

    def run(
        self,
        workers: Callable[[], Workers],
        *,
        progress: Progress = lambda _done, _label: None,
        command: str = "",
    ) -> StudyResult:
        """Run what is missing and return how the study came out.

        Args:
            workers: asked for only if something is to be measured.
            progress: is told after each analysis.
            command: that started it, for the report.

        Raises:
            InputError: an analysis asks for what cannot be done at any point, a requirement for what its result cannot
                hold; what was measured is in the store.
        """
        with Finished(self._store, fresh=self._fresh) as finished, place(str(self.study.path)):
            self._execution = execution = Execution(
                self.plan, commands=self._commands, finished=finished, folder=self.study.folder
            )
            reused = len(execution.outcomes)
            if execution.missing:
                self._check(execution.missing)
                execution.execute(workers(), progress)
            checked = self._checked(finished, execution)
        return StudyResult(
            study=self.study,
            runs={run: execution.outcomes[run] for run in self.plan.runs if run in execution.outcomes},
            checked=checked,
            measured=execution.measured,
            reused=reused,
            missing=len(execution.missing),
            notes=self.plan.notes,
            command=command,
        )

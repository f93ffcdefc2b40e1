"""Run a study: what its store lacks is measured, then everything is compared with the requirements."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import chdir
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from workbench.errors import InputError
from workbench.jobs.job import Job
from workbench.jobs.options import Scheduler
from workbench.study.baselines import baseline_file, made_otherwise, read_baseline, renew
from workbench.study.description import GridPoint, Study
from workbench.study.execute import Execution
from workbench.study.finished_store import FOLDER, Finished
from workbench.study.plan import Plan, PlannedRun, RunResult, make_plan
from workbench.study.position_in_file import in_file, place
from workbench.study.read import is_bundled_study, read_study
from workbench.study.requirements.base import Compliance, NotMeasured, Requirement, Result
from workbench.study.result import RequirementResult, StudyResult

if TYPE_CHECKING:
    from workbench.jobs.options import Workers

__all__ = ["StudyRun", "applies", "check_runs", "default_store", "finding_of", "run_study"]


def default_store(name: str | Path) -> Path:
    """Return the folder that keeps the results of a study: beside it, of a bundled one in the present folder."""
    return Path(FOLDER) if is_bundled_study(str(name)) else Path(name).expanduser().parent / FOLDER


class StudyRun:
    """A study, its plan and its store.

    Args:
        name: of the study: a path, or `study:NAME`.
        store: folder of finished analyses; None: nothing is kept.
        fresh: whether everything is measured again.

    Attributes:
        study: as it is written down.
        plan: what it runs.

    Raises:
        InputError: the study cannot be read, or the store cannot be used.
    """

    def __init__(self, name: str | Path, *, store: Path | None, fresh: bool = False) -> None:
        self.study: Study = read_study(name)
        if self.study.envelope is not None:
            raise InputError(f"{name}: has an [envelope]: wb.envelope runs it, or `workbench run {name}`")
        self._store, self._fresh = store, fresh
        with in_file(self.study.path):
            self.plan: Plan = make_plan(self.study)

    @property
    def total(self) -> int:
        """Number of analyses at all points."""
        return len(self.plan.runs)

    def _checked(
        self, every: Sequence[RequirementResult], finished: Finished, execution: Execution
    ) -> list[RequirementResult]:
        """Return every requirement, as it came out before where nothing is new."""
        if not execution.measured and not execution.missing:
            kept = finished.load_findings(every)
            if kept is not None:
                return [replace(c, finding=finding) for c, finding in zip(every, kept, strict=True)]
        checked = [_answer(c, execution.outcomes) for c in every]
        if not execution.missing and all(o.lasting for o in execution.outcomes.values()):
            finished.save_findings(checked)
        return checked

    def run(
        self,
        workers: Callable[[], Workers],
        job: Job | None = None,
        *,
        command: str = "",
        update_baselines: bool = False,
    ) -> StudyResult:
        """Run what is missing and return how the study came out; a stop leaves out what was not done by then.

        Args:
            workers: asked for only if something is to be measured.
            job: is told after each analysis; None: nobody is.
            command: that started it, for the report.
            update_baselines: write the baselines that are missing or not met.

        Raises:
            InputError: an analysis asks for what cannot be done at any point; what was measured is in the store.
        """
        job = job or Job()
        with job.ended_by(), Finished(self._store, fresh=self._fresh) as finished, in_file(self.study.path):
            execution = Execution(self.plan, finished=finished, folder=self.study.folder)
            reused = len(execution.outcomes)
            every = _questions(self.study, self.plan)
            came_to = partial(self._came_to, execution, reused, command)
            job.partial = lambda: came_to([_answer(c, execution.outcomes) for c in every])
            if execution.missing:
                check_runs(self.study, execution.missing)
                execution.execute(workers(), job)
            renewed = _renewed(every, execution.outcomes) if update_baselines else []
            checked = self._checked(every, finished, execution)
            damage = finished.remarks()
        return came_to(checked, (*damage, *execution.afterwards, *renewed))

    def _came_to(
        self, execution: Execution, reused: int, command: str, checked: Sequence[RequirementResult],
        notes: Sequence[str] = (),
    ) -> StudyResult:  # fmt: skip
        return StudyResult(
            study=self.study,
            runs={run: execution.outcomes[run] for run in self.plan.runs if run in execution.outcomes},
            checked=checked,
            measured=execution.measured,
            reused=reused,
            missing=len(execution.missing),
            notes=(*self.plan.notes, *notes),
            command=command,
        )


def run_study(
    study: str | Path,
    *,
    store: str | Path | None = "auto",
    fresh: bool = False,
    jobs: int | None = None,
    timeout: float | None = None,
    confine: bool = False,
    scheduler: str | Scheduler | None = None,
    update_baselines: bool = False,
) -> StudyResult:
    """Run a study: analyses over a grid of parameters, compared with requirements.

    Args:
        study: file (.toml), or a bundled one, `study:NAME`.
        store: folder of finished analyses; "auto": .workbench-store beside the study (of a bundled one in the present
            folder); None: nothing is kept or reused.
        fresh: measure again what the store has.
        jobs: worker processes at a time; None: one per core.
        timeout: longest time for one analysis [s]; None: an hour.
        confine: keep FMUs from networks, and from writing files outside their own temporary folders.
        scheduler: Dask cluster on which the analyses run, an address or a `Cluster`; study and store must lie on a
            file system that its machines share.
        update_baselines: write the baselines of requirements that are missing or not met; `notes` say which.

    Returns:
        Values, limits and margins, with `.passed`, `.to_dict()`, `.to_csv()`, `.to_junit()` and `.report()`.

    Raises:
        InputError: the study is wrong: one line with the file, the table and the key.
        FmuError: a model cannot be opened.

    Examples:
        In equilibrium the output of 1/(s + 1) is its input.

        >>> from pathlib import Path
        >>> _ = Path("lag.toml").write_text('''
        ... models.lag = "fmu:FirstOrderLag"
        ... analyses.rest = {command = "trim", model = "lag", u0 = {u = 2.0}}
        ... [[requirements]]
        ... name = "gain"
        ... analysis = "rest"
        ... kind = "value"
        ... path = "y.y"
        ... equal = 2.0
        ... tolerance = 1e-9
        ... ''')
        >>> print(wb.run_study("lag.toml", store=None).passed)
        True
    """
    from workbench.jobs.options import DEFAULT_TIMEOUT, Workers  # noqa: PLC0415 - see `StudyRun`

    limit = DEFAULT_TIMEOUT if timeout is None else timeout
    place = Workers(jobs=jobs, timeout=limit, confine=confine, scheduler=scheduler)
    folder = default_store(study) if store == "auto" else None if store is None else Path(store)
    prepared = StudyRun(study, store=folder, fresh=fresh)
    return prepared.run(lambda: place, update_baselines=update_baselines)


def check_runs(study: Study, runs: Sequence[PlannedRun]) -> None:
    """Look for mistakes before anything runs; what is in the store had none.

    Args:
        study: that they belong to.
        runs: that are going to be run.

    Raises:
        InputError: an option of a value that it cannot have, a name that the model does not have.
        FmuError: a model cannot be opened.
    """
    from workbench.study.names import check_names  # noqa: PLC0415 - a study in its store opens no model

    for run in {run.analysis.name: run for run in runs}.values():
        with place(f"[analyses.{run.analysis.name}]"), chdir(study.folder):
            run.analysis.command.check(run.options)
    check_names(study, runs)


# -- requirements ------------------------------------------------------------------------------


def _questions(study: Study, plan: Plan) -> list[RequirementResult]:
    """Return every requirement at every point at which its analyses differ, nothing measured yet.

    Args:
        study: what was asked for.
        plan: what is run.
    """
    result: list[RequirementResult] = []
    for requirement in study.requirements:
        seen: set[tuple[PlannedRun, ...]] = set()
        for k, point in enumerate(plan.points):
            runs = tuple(plan.at[name, k] for name in requirement.analyses)
            if runs not in seen and applies(requirement, point):
                seen.add(runs)
                label, empty = _label(runs), Compliance(value=None)
                file = baseline_file(study, requirement, label)
                result.append(
                    RequirementResult(requirement=requirement, point=label, runs=runs, finding=empty, baseline=file)
                )
    return result


def _answer(question: RequirementResult, outcomes: Mapping[PlannedRun, RunResult]) -> RequirementResult:
    """Return a requirement with what came out.

    Args:
        question: one of `_questions`.
        outcomes: what was run.

    A requirement that asks for what cannot be in such a result is not met, with the reason: the others keep theirs.
    """
    found = [outcomes.get(run) for run in question.runs]
    try:
        finding = finding_of(question.requirement, found, question.baseline)
    except InputError as error:
        head = f'[[requirements]] "{question.requirement.name}": '
        finding = _none(question.requirement, str(error).removeprefix(head))
    if question.baseline is not None and not finding.passed:
        reasons = [finding.reason, made_otherwise(question.baseline, question.runs[0])]
        finding = replace(finding, reason="; ".join(filter(None, reasons)))
    return replace(question, finding=finding)


def _renewed(questions: Sequence[RequirementResult], outcomes: Mapping[PlannedRun, RunResult]) -> list[str]:
    """Write the baselines that are missing or not met; return what was done, a line for each."""
    return renew([_answer(q, outcomes) for q in questions if q.baseline is not None], outcomes)


def applies(requirement: Requirement, point: GridPoint) -> bool:
    """Return whether a requirement is to be met at a point.

    Args:
        requirement: of a study.
        point: of its grid.
    """
    chosen = requirement.configurations is None or point.configuration in requirement.configurations
    wanted = {name: v if isinstance(v, list) else [v] for name, v in requirement.grid.items()}
    return chosen and all(point.values[name] in values for name, values in wanted.items())


def _label(runs: Sequence[PlannedRun]) -> str:
    """Join what of the point concerns the analyses."""
    configuration = next((r.point.configuration for r in runs if r.point.configuration), None)
    values = {name: value for r in runs for name, value in r.point.values.items()}
    return GridPoint(configuration=configuration, values=values).label


def finding_of(
    requirement: Requirement, outcomes: Sequence[RunResult | None], baseline: Path | None = None
) -> Compliance:
    """Return how a requirement came out.

    Args:
        requirement: to be met.
        outcomes: of its analyses; None: not run.
        baseline: file of the record that it is compared with; None: with none.

    Raises:
        InputError: it asks for what cannot be in such a result.
    """
    results: list[Result] = []
    for name, outcome in zip(requirement.analyses, outcomes, strict=True):
        if outcome is None:
            return _none(requirement, f"{name} was not run")
        if outcome.result is None:
            return _none(requirement, f"{name} failed: {outcome.reason}")
        results.append(outcome.result)
    try:
        if baseline is not None:
            lacking = "" if baseline.is_file() else requirement.no_baseline(results[0])
            if lacking:
                return _none(requirement, f"{requirement.analysis}: {lacking}")
            results.append(read_baseline(baseline))
        return requirement.find(results)
    except NotMeasured as error:
        return _none(requirement, str(error))
    except InputError as error:
        raise InputError(
            f'[[requirements]] "{requirement.name}": {str(error).removeprefix(f"{requirement.name}: ")}'
        ) from None


def _none(requirement: Requirement, reason: str) -> Compliance:
    """Return that nothing was measured, and why; the limits that stand in the file are shown beside it."""
    given = {name: getattr(requirement, name, None) for name in ("min", "max")}
    limit = {name: float(value) for name, value in given.items() if value is not None}
    return Compliance(value=None, limit=limit, unit=getattr(requirement, "unit", None), reason=reason)

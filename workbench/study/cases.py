"""A study's requirements as verdicts that a CI shows."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import TYPE_CHECKING

from workbench.show.cases import ERROR, FAILURE, PASSED, Case
from workbench.study.plan import PlannedRun

if TYPE_CHECKING:
    from workbench.study.result import RequirementResult, StudyResult

__all__ = ["cases_of"]


def cases_of(result: StudyResult) -> Iterator[Case]:
    """Yield one case for each requirement at each point, and one for each analysis that failed without any.

    A requirement that is not met is a failure; one whose analysis gave no result is an error.

    Args:
        result: of the study.
    """
    file = str(result.study.path)
    shares = Counter(run for checked in result.checked for run in checked.runs)
    for checked in result.checked:
        yield Case(
            group=checked.requirement.analysis,
            name=checked.name,
            outcome=_outcome(result, checked),
            message=checked.finding.words,
            kind=checked.requirement.kind,
            seconds=sum(_seconds(result, run) / shares[run] for run in checked.runs),
            file=file,
            mark=f'"{checked.requirement.name}"',
        )
    for run, outcome in result.failed:
        if run not in shares:
            yield Case(
                group=run.analysis.name,
                name=f"analysis {run.label}",
                outcome=ERROR,
                message=outcome.reason or "points of it failed",
                kind=outcome.kind or "failed",
                seconds=outcome.seconds,
                file=file,
                mark=run.analysis.name,
            )


def _outcome(result: StudyResult, checked: RequirementResult) -> str:
    if checked.finding.passed:
        return PASSED
    return ERROR if any(_lost(result, run) for run in checked.runs) else FAILURE


def _seconds(result: StudyResult, run: PlannedRun) -> float:
    """Time that an analysis took now; a reused one took none."""
    outcome = result.runs.get(run)
    return 0.0 if outcome is None or outcome.reused else outcome.seconds


def _lost(result: StudyResult, run: PlannedRun) -> bool:
    """Whether an analysis gave no result, which is an error rather than a failure."""
    return run not in result.runs or result.runs[run].result is None

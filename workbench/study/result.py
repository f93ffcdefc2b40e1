"""What a study came to."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

from workbench.core.records.csv_file import write_csv
from workbench.core.records.named import named
from workbench.errors import one_line, shortened
from workbench.show.cases import Case, Judged
from workbench.study.description import Study
from workbench.study.plan import PlannedRun, RunResult
from workbench.study.requirements.base import Compliance, Requirement

__all__ = ["RequirementResult", "StudyResult"]

_MOST = 40  # so many lines are shown
_NAMED = 4  # so many violated requirements are named in a sentence

_COLUMNS = (
    "requirement", "point", "kind", "analysis", "value", "unit", "min", "max", "equal", "tolerance", "margin", "passed",
    "where", "reason",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class RequirementResult:
    """One requirement at one point.

    Attributes:
        requirement: as it stands in the study.
        point: where, for people; empty: the study has one point.
        runs: what it was read from.
        finding: how it came out.
        baseline: file of the record that it is compared with; None: with none.
    """

    requirement: Requirement
    point: str
    runs: tuple[PlannedRun, ...]
    finding: Compliance
    baseline: Path | None = None

    @property
    def name(self) -> str:
        """For people: "gain mask (worn)"."""
        return f"{self.requirement.name} ({self.point})" if self.point else self.requirement.name

    def to_dict(self) -> dict[str, Any]:
        """Return it ready for JSON."""
        result = self.finding
        return {
            "id": self.requirement.id,
            "name": self.requirement.name,
            "point": self.point,
            "kind": self.requirement.kind,
            "analyses": list(self.requirement.analyses),
            "value": result.value,
            "unit": result.unit,
            "limit": dict(result.limit),
            "margin": result.margin,
            "passed": result.passed,
            "where": result.where,
            "reason": result.reason,
            "comment": self.requirement.comment,
        }


@dataclass(frozen=True, eq=False, kw_only=True)
class StudyResult(Judged):
    """What a study came to.

    Attributes:
        study: what was asked for.
        runs: every analysis at every point → what it gave; those that were not run are left out.
        checked: every requirement at every point.
        measured: how many analyses were run now.
        reused: how many came from the store.
        missing: how many were not run, since the study was interrupted.
        notes: one line each.
        command: command that made the result.
    """

    _page = "workbench.study.page:study_page"

    study: Study
    runs: Mapping[PlannedRun, RunResult]
    checked: Sequence[RequirementResult]
    measured: int
    reused: int
    missing: int
    notes: Sequence[str]
    command: str

    def __repr__(self) -> str:
        """Return one line: which study it is, and how it came out."""
        return f"<{type(self).__name__}: {shortened(one_line(f'{self.study.name}. {self.words}'))}>"

    @property
    def violated(self) -> list[RequirementResult]:
        """Requirements that are not met, in the order of the study."""
        return [c for c in self.checked if not c.finding.passed]

    @property
    def shown(self) -> list[RequirementResult]:
        """Violated requirements first; of a long list only the worst of each requirement beside them."""
        ordered = sorted(self.checked, key=lambda c: c.finding.passed)
        if len(ordered) <= _MOST:
            return ordered
        worst: dict[str, RequirementResult] = {}
        for checked in sorted((c for c in ordered if c.finding.passed), key=_margin):
            worst.setdefault(checked.requirement.name, checked)
        return [*self.violated, *worst.values()]

    @property
    def failed(self) -> list[tuple[PlannedRun, RunResult]]:
        """Analyses without a result, and those of which points failed."""
        return [(run, o) for run, o in self.runs.items() if o.result is None or o.code != 0]

    @property
    def passed(self) -> bool:
        """Whether every requirement is met, and nothing failed or is missing."""
        return not self.violated and not self.failed and not self.missing

    @property
    def words(self) -> str:
        """How it came out, in a sentence or two; what is violated is named."""
        every, bad = len(self.checked), self.violated
        if not every:
            said = "no requirements"
        elif not bad:
            said = "the requirement is met" if every == 1 else f"all {every} requirements are met"
        else:
            names = ", ".join(c.name for c in bad[:_NAMED]) + (" and others" if len(bad) > _NAMED else "")
            said = f"{len(bad)} of {every} requirements {'is' if len(bad) == 1 else 'are'} not met: {names}"
        missing = f", {self.missing} not run" if self.missing else ""
        analyses = "analysis" if self.measured == 1 else "analyses"
        return f"{said}; {self.measured} {analyses} measured, {self.reused} taken from the store{missing}"

    def to_dict(self) -> dict[str, Any]:
        """Return it ready for JSON, the results of the analyses in full."""
        return {
            "study": self.study.name,
            "description": self.study.description,
            "file": str(self.study.path),
            "sha256": self.study.sha256,
            "id": self.study.id,
            "author": self.study.author,
            "revision": self.study.revision,
            "approvals": [{"role": a.role, "name": a.name, "date": a.date} for a in self.study.approvals],
            "passed": self.passed,
            "requirements": [c.to_dict() for c in self.checked],
            "analyses": [_run_dict(run, outcome) for run, outcome in self.runs.items()],
            "measured": self.measured,
            "reused": self.reused,
            "missing": self.missing,
            "notes": list(self.notes),
        }

    def to_csv(self, path: str | Path | TextIO) -> None:
        """Write one line for each requirement at each point.

        Args:
            path: path of the file, or an open text stream.

        Raises:
            InputError: the file cannot be written.
        """
        write_csv(path, [_COLUMNS, *(_row(c) for c in self.checked)])

    @property
    def suite(self) -> str:
        return self.study.name

    def cases(self) -> list[Case]:
        return list(named("workbench.study.cases:cases_of")(self))

    def report(self, path: str | Path) -> None:
        """Write the page.

        Args:
            path: path of the file, .html.

        Raises:
            InputError: another suffix, or the file cannot be written.
        """
        from workbench.requests.origin import Origin  # noqa: PLC0415 - only pages need them
        from workbench.show.result import write_report  # noqa: PLC0415

        origin = Origin(command="run", call=self.command)
        write_report(self, path, origin)


def _margin(checked: RequirementResult) -> float:
    return math.inf if checked.finding.margin is None else checked.finding.margin


def _run_dict(run: PlannedRun, outcome: RunResult) -> dict[str, Any]:
    return {
        "name": run.analysis.name,
        "point": run.point.label,
        "configuration": run.point.configuration,
        "parameters": dict(run.point.values),
        "command": run.analysis.command.request.command,
        "command_line": run.command_line,
        "files": dict(run.subject["files"]),
        "code": outcome.code,
        "failed": outcome.reason or None,
        "kind": outcome.kind or None,
        "notes": list(outcome.notes),
        "seconds": outcome.seconds,
        "reused": outcome.reused,
        "result": outcome.result,
    }


def _row(checked: RequirementResult) -> list[Any]:
    requirement = checked.requirement
    result = checked.to_dict() | {"requirement": requirement.name, "analysis": requirement.analysis}
    cells = (result.get(name, checked.finding.limit.get(name)) for name in _COLUMNS)
    return ["" if cell is None else cell for cell in cells]

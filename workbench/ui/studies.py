"""Studies in the browser: a draft that is checked while it is written, and the request that runs one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from workbench.core.machine.scratch import scratch
from workbench.errors import InputError
from workbench.jobs.job import Job
from workbench.requests.request import Request, Subject
from workbench.show.page import Page
from workbench.show.result import Reportable
from workbench.ui.root import ServedFolder

if TYPE_CHECKING:
    from workbench.study.description import Study
    from workbench.study.requirements.base import Requirement
    from workbench.study.result import RequirementResult, StudyResult

__all__ = ["RunStudy", "StudyRecord", "checked_study", "run_study", "study_record_page", "with_limit"]

_DRAWN = ("min", "max", "upper", "lower", "quantity", "band")  # of a requirement


class RunStudy(Request["str | Path", "StudyRecord"]):
    """Run a study: analyses over a grid of parameters, compared with requirements."""

    command = "run"
    called = "run_study"
    algorithm = "workbench.ui.studies:run_study"
    example = "workbench run study:rudder_specification"
    subject = Subject(
        name="study",
        type="str | Path",
        help="Study file (.toml), or a bundled one, study:NAME.",
        metavar="STUDY",
        words="Study file (.toml), or a bundled one: study:NAME.",
    )
    counts = "analyses"

    def went_well(self, record: StudyRecord) -> bool:
        """Return whether every requirement is met, and nothing failed or is missing."""
        return record.result.passed


@dataclass(frozen=True, eq=False)
class StudyRecord(Reportable):
    """What a study came to; in JSON without the results of its analyses, which its store has.

    Attributes:
        result: all of it.
    """

    _page = "workbench.ui.studies:study_record_page"

    result: StudyResult

    def to_dict(self) -> dict[str, Any]:
        """Return it ready for JSON."""
        analyses = self.result.to_dict()["analyses"]
        short = [{key: value for key, value in a.items() if key != "result"} for a in analyses]
        return {**self.result.to_dict(), "analyses": short}

    def to_csv(self, path: str | Path) -> None:
        """Write one line for each requirement at each point.

        Args:
            path: of the file.
        """
        self.result.to_csv(path)


def study_record_page(record: StudyRecord) -> Page:
    """Return the page of a study."""
    from workbench.study.page import study_page  # noqa: PLC0415 - the form needs none

    return study_page(record.result)


@dataclass(frozen=True)
class _Answered:
    """How requirements came out after one more analysis.

    Attributes:
        label: of the analysis.
        requirements: those that are new, as `StudyResult.to_dict` has them.
    """

    label: str
    requirements: Sequence[Mapping[str, Any]]

    def to_dict(self) -> dict[str, Any]:
        """Return it ready for JSON."""
        return {"label": self.label, "requirements": list(self.requirements)}


def run_study(name: str | Path, request: RunStudy, job: Job) -> StudyRecord:  # noqa: ARG001 - it has no options
    """Run a study; the job is told after each analysis which requirements are met.

    Args:
        name: a path, or `study:NAME`.
        request: it has no options.
        job: is told.

    Raises:
        InputError, FmuError: the study is wrong, or a model cannot be opened.
    """
    from workbench.jobs.options import Workers  # noqa: PLC0415 - as above
    from workbench.study.run import StudyRun, default_store  # noqa: PLC0415

    said: dict[tuple[str, str], dict[str, Any]] = {}

    def told(label: object, done: int, total: int) -> None:
        result: Any = inner.partial()
        rows = [] if result is None else [_row(c) for c in result.checked if all(run in result.runs for run in c.runs)]
        new = [row for row in rows if said.get((row["name"], row["point"])) != row]
        said.update({(row["name"], row["point"]): row for row in new})
        job.partial = lambda: None if result is None else StudyRecord(result)
        job.done(_Answered(str(label), new), done, total)

    prepared, inner = StudyRun(name, store=default_store(name)), Job(told)
    with job.ended_by(inner.stop):
        result = prepared.run(Workers, inner, command=f"workbench run {name}")
    return StudyRecord(result)


def _row(checked: RequirementResult) -> dict[str, Any]:
    """Return a requirement as a table shows it."""
    finding = checked.finding
    return {
        "name": checked.requirement.name, "point": checked.point, "verdict": finding.verdict,
        "value": finding.value_words, "limit": finding.limit_words, "margin": finding.margin_words,
        "where": finding.where, "reason": finding.reason,
    }  # fmt: skip


def checked_study(text: str, root: ServedFolder, name: str) -> dict[str, Any]:
    """Return what a draft of a study says, ready for JSON.

    `mistakes` (`line`, None: not known, and `message`), `envelope`: whether it has one, `analyses` (`name`, `command`),
    `requirements` (`name`, `kind`, `analysis`, `line`); the last two are empty where there are mistakes.

    Args:
        text: of the file.
        root: the folder that is shown.
        name: of the file, to which paths in it are relative; it need not be there.

    Raises:
        NotHereError: the name, or a file that it uses, is not in the folder.
    """
    from workbench.study.position_in_file import line_of  # noqa: PLC0415 - as above
    from workbench.study.read import read_study  # noqa: PLC0415

    bundled = name.startswith("study:")
    folder = root.folder if bundled else root.path(name, new=True).parent
    result: dict[str, Any] = {"mistakes": [], "envelope": False, "analyses": [], "requirements": []}
    root.check_study(name, text, folder / "study.toml")
    with scratch("ui") as place:
        draft = place / "study.toml"
        draft.write_text(text, encoding="utf-8")
        try:
            study = read_study(draft, folder=folder)
        except InputError as error:
            every = [{"line": m.line, "message": m.message} for m in error.mistakes]
            said = str(error).removeprefix(f"{draft}: ")
            return {**result, "mistakes": every or [{"line": None, "message": said}]}
    return {**result, **_parts(study, [line_of(text, f"requirements.{k + 1}") for k in range(len(study.requirements))])}


def _limits(requirement: Requirement) -> dict[str, Any]:
    """Return what pictures draw of a requirement: `min`, `max`, corners of a mask and the like, where it has them."""
    given = {name: getattr(requirement, name, None) for name in _DRAWN}
    return {name: value for name, value in given.items() if value is not None}


def with_limit(text: str, number: int, key: str, value: float) -> str:
    """Return the text of a study with another limit in one of its requirements; all else stays as it is.

    Args:
        text: of the file.
        number: of the requirement, from 0.
        key: "min" or "max".
        value: of the limit.

    Raises:
        InputError: it is not TOML, or there is no such requirement.
    """
    import tomlkit  # noqa: PLC0415 - as above
    from tomlkit.exceptions import TOMLKitError  # noqa: PLC0415

    try:
        document: Any = tomlkit.parse(text)
        document["requirements"][number][key] = value
    except (TOMLKitError, KeyError, IndexError, TypeError) as error:
        raise InputError(f"the requirement cannot be changed: {error}") from None
    return tomlkit.dumps(document)


def _parts(study: Study, lines: Sequence[int | None]) -> dict[str, Any]:
    return {
        "envelope": study.envelope is not None,
        "analyses": [{"name": a.name, "command": a.command.request.command} for a in study.analyses.values()],
        "requirements": [
            {"name": r.name, "kind": r.kind, "analysis": ", ".join(r.analyses), "line": line, **_limits(r)}
            for r, line in zip(study.requirements, lines, strict=True)
        ],
    }

"""The report of a study."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from workbench.report.page import Page, Section, Table
from workbench.report.tones import Verdict
from workbench.study.outcome import Outcome
from workbench.study.pictures import pictures
from workbench.study.plan import Run
from workbench.study.words import limit_words, margin_words, said, value_words, verdict

if TYPE_CHECKING:
    from workbench.study.result import Checked, StudyResult

__all__ = ["study_page"]

_HEADINGS = ("requirement", "verdict", "value", "limit", "margin", "where")


def study_page(result: StudyResult) -> Page:
    """Return the page of a study: violations first, then every requirement, pictures, and the analyses.

    Args:
        result: what to report.
    """
    sections = [*_violations(result), *_requirements(result), *pictures(result), *_grid(result), _analyses(result)]
    return Page(
        title=result.study.name,
        lead=f"{_sentence(result.words)} {result.study.description}".strip(),
        facts=_facts(result),
        summary=[Verdict(verdict(c.finding), f"{c.name}: {said(c.finding)}") for c in result.shown],
        notes=result.notes,
        sections=sections,
        data=result.to_dict(),
    )


def _sentence(words: str) -> str:
    return f"{words[:1].upper()}{words[1:]}."


def _facts(result: StudyResult) -> dict[str, str]:
    study = result.study
    models = {f"model {name}": _model(str(m.model), result) for name, m in study.models.items()}
    return {"study": str(study.path), **models}


def _model(file: str, result: StudyResult) -> str:
    """Return the file of a model and the hashes of what it consists of."""
    for run in result.runs:
        files = run.subject["files"]
        if file in files:
            parts = [
                f"{name} (sha256 {files[name][:16]}…)" for name in files if name == file or name.startswith("fmu:")
            ]
            return ", ".join(parts)
    return file


def _violations(result: StudyResult) -> Iterator[Section]:
    if result.violated:
        reasons = [f"{c.name}: {c.finding.reason}" for c in result.violated if c.finding.reason]
        yield Section("Not met", tables=[_table(result.violated)], items=reasons)
    if result.failed:
        lines = [f"{run.label}: {_why(outcome)}" for run, outcome in result.failed]
        yield Section("Analyses that failed", items=lines)


def _why(outcome: Outcome) -> str:
    return outcome.reason or "ended with exit code 1: points of it failed"


def _requirements(result: StudyResult) -> Iterator[Section]:
    if result.checked:
        comments = {c.requirement.name: c.requirement.comment for c in result.checked if c.requirement.comment}
        items = [f"{name}: {comment}" for name, comment in comments.items()]
        yield Section("Requirements", tables=[_table(result.checked)], items=items)


def _table(checked: Sequence[Checked]) -> Table:
    return Table(_HEADINGS, [_row(c) for c in checked], verdict=1, right=(2, 3, 4))


def _row(checked: Checked) -> tuple[str, ...]:
    found = checked.finding
    numbers = (value_words(found), limit_words(found), margin_words(found))
    return (checked.name, verdict(found), *numbers, found.where)


def _grid(result: StudyResult) -> Iterator[Section]:
    study = result.study
    if study.grid or study.configurations:
        rows = [(name, ", ".join(map(str, values))) for name, values in study.grid.items()]
        if study.configurations:
            rows.insert(0, ("configuration", ", ".join(study.configurations)))
        yield Section("Grid", tables=[Table(("parameter", "values"), rows)])


def _analyses(result: StudyResult) -> Section:
    rows = [_of_run(run, outcome) for run, outcome in result.runs.items()]
    headings = ("analysis", "interface", "solver", "seconds", "from the store", "notes")
    commands = [run.command_line for run in result.runs]
    parts = [Section("The commands", code=commands, folded=True)]
    return Section("Analyses", tables=[Table(headings, rows)], parts=parts)


def _of_run(run: Run, outcome: Outcome) -> tuple[str, ...]:
    found = outcome.result or {}
    how = [str(found.get(key, "")) for key in ("interface", "solver")]
    return (run.label, *how, f"{outcome.seconds:.2f}", "yes" if outcome.reused else "", "; ".join(outcome.notes))

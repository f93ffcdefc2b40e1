"""The report of a study."""

from __future__ import annotations

import hashlib
import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from workbench.errors import WorkbenchError
from workbench.show.facts import point_facts
from workbench.show.page import Page, PageTable, Section
from workbench.show.tables import sentence
from workbench.show.verdicts import Verdict
from workbench.study.baselines import read_baseline
from workbench.study.plan import PlannedRun, RunResult
from workbench.study.requirements.base import Compliance, Result, convert
from workbench.study.requirements.baseline import Baseline
from workbench.study.requirements.response import UNITS, Mask
from workbench.study.requirements.step import Overshoot, SettlingTime

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from workbench.study.result import RequirementResult, StudyResult

__all__ = ["study_page"]

_HEADINGS = ("requirement", "verdict", "value", "limit", "margin", "where")
_BLANK = "_" * 18
_FEW = 6  # operating points that are shown without being asked for
_MOST = 12  # pictures on a page; those of violated requirements first


def study_page(result: StudyResult) -> Page:
    """Return the page of a study: violations first, then every requirement, pictures, and the analyses.

    Args:
        result: what to report.
    """
    sections = [
        *_violations(result),
        *_requirements(result),
        *_pictures(result),
        *_grid(result),
        *_points(result),
        _analyses(result),
        *_approvals(result),
    ]
    return Page(
        title=result.study.name,
        lead=f"{sentence(result.words)} {result.study.description}".strip(),
        facts=_facts(result),
        summary=_verdicts(result),
        notes=result.notes,
        sections=sections,
        data=result.to_dict(),
        verdicts=[Verdict(c.finding.verdict, _named(c)) for c in result.checked],
        signed={a.role: ", ".join(filter(None, [a.name, a.date])) or "open" for a in result.study.approvals},
    )


def _named(checked: RequirementResult) -> str:
    """Return a requirement with its id, and what was found."""
    number = f"{checked.requirement.id} " if checked.requirement.id else ""
    return f"{number}{checked.name}: {checked.finding.words}"


def _verdicts(result: StudyResult) -> list[Verdict]:
    """Return what is not met, and how much is; the table says the rest."""
    met = [c for c in result.checked if c.finding.passed]
    verdicts = [Verdict(c.finding.verdict, f"{c.name}: {c.finding.words}") for c in result.violated]
    return [*verdicts, *([Verdict(met[0].finding.verdict, f"{len(met)} of {len(result.checked)}")] if met else [])]


def _facts(result: StudyResult) -> dict[str, str]:
    study = result.study
    models = {f"model {name}": _model(str(m.model), result) for name, m in study.models.items()}
    labels = {"document": study.id, "revision": study.revision, "author": study.author}
    return {
        **{name: value for name, value in labels.items() if value},
        "study": study.path.name,
        "SHA-256 of the study": study.sha256,
        **models,
        **_baselines(result),
    }


def _baselines(result: StudyResult) -> dict[str, str]:
    """Return the files that results were compared with, as seen from the study, and their hashes."""
    files = {c.baseline: f"baseline of {c.requirement.analysis}" for c in result.checked if c.baseline is not None}
    several = Counter(files.values())
    return {
        f"{name} {file.stem}" if several[name] > 1 else name: _hashed(file, result.study.folder)
        for file, name in files.items()
    }


def _hashed(file: Path, folder: Path) -> str:
    shown = file.relative_to(folder) if file.is_relative_to(folder) else file
    if not file.is_file():
        return f"{shown.as_posix()}, which is not there"
    return f"{shown.as_posix()}, SHA-256 {hashlib.sha256(file.read_bytes()).hexdigest()}"


def _model(file: str, result: StudyResult) -> str:
    """Return the file of a model and the hashes of what it consists of."""
    for run in result.runs:
        files = run.subject["files"]
        if file in files:
            parts = [f"{name}, SHA-256 {files[name]}" for name in files if name == file or name.startswith("fmu:")]
            return "\n".join(parts)
    return file


def _violations(result: StudyResult) -> Iterator[Section]:
    if result.violated:
        reasons = [f"{c.name}: {c.finding.reason}" for c in result.violated if c.finding.reason]
        yield Section("Not met", tables=[_table(result.violated)], items=reasons)
    if result.failed:
        lines = [f"{run.label}: {_why(outcome)}" for run, outcome in result.failed]
        yield Section("Analyses that failed", items=lines)


def _why(outcome: RunResult) -> str:
    return outcome.reason or "ended with exit code 1: points of it failed"


def _requirements(result: StudyResult) -> Iterator[Section]:
    if result.checked:
        comments = {c.requirement.name: c.requirement.comment for c in result.checked if c.requirement.comment}
        items = [f"{name}: {comment}" for name, comment in comments.items()]
        yield Section("Requirements", tables=[_table(result.checked)], items=items)


def _table(checked: Sequence[RequirementResult]) -> PageTable:
    """Return the verdicts, with the ids of the requirements where there are any."""
    if not any(c.requirement.id for c in checked):
        return PageTable(_HEADINGS, [_row(c) for c in checked], verdict=1, right=(2, 3, 4))
    rows = [(c.requirement.id, *_row(c)) for c in checked]
    return PageTable(("id", *_HEADINGS), rows, verdict=2, right=(3, 4, 5))


def _row(checked: RequirementResult) -> tuple[str, ...]:
    result = checked.finding
    numbers = (result.value_words, result.limit_words, result.margin_words)
    return (checked.name, result.verdict, *numbers, result.where)


def _grid(result: StudyResult) -> Iterator[Section]:
    study = result.study
    if study.grid or study.configurations:
        rows = [(name, ", ".join(map(str, values))) for name, values in study.grid.items()]
        if study.configurations:
            rows.insert(0, ("configuration", ", ".join(study.configurations)))
        yield Section("Grid", tables=[PageTable(("parameter", "values"), rows)])


def _approvals(result: StudyResult) -> Iterator[Section]:
    """Yield who has to agree; what is not told yet is left to be written by hand."""
    if result.study.approvals:
        rows = [(a.role, a.name or _BLANK, a.date or _BLANK, _BLANK) for a in result.study.approvals]
        yield Section("Approval", tables=[PageTable(("role", "name", "date", "signature"), rows)])


def _points(result: StudyResult) -> Iterator[Section]:
    """Yield where each analysis was measured; those at one point share a row."""
    where: dict[tuple[str, str], list[str]] = {}
    for run, outcome in result.runs.items():
        facts = point_facts(outcome.result or {})
        if facts:
            where.setdefault((facts.get("held inputs", ""), facts["operating point"]), []).append(run.label)
    if where:
        rows = [(", ".join(labels), *facts) for facts, labels in where.items()]
        table = PageTable(("analysis", "held inputs", "operating point"), rows, right=())
        yield Section("Operating points", tables=[table], folded=len(rows) > _FEW)


def _analyses(result: StudyResult) -> Section:
    rows = [_of_run(run, outcome) for run, outcome in result.runs.items()]
    headings = ("analysis", "interface", "solver", "seconds", "from the store", "notes")
    commands = [run.command_line for run in result.runs]
    parts = [Section("The commands", code=commands, folded=True)]
    return Section("Analyses", tables=[PageTable(headings, rows)], parts=parts)


def _of_run(run: PlannedRun, outcome: RunResult) -> tuple[str, ...]:
    result = outcome.result or {}
    how = [str(result.get(key, "")) for key in ("interface", "solver")]
    return (run.label, *how, f"{outcome.seconds:.2f}", "yes" if outcome.reused else "", "; ".join(outcome.notes))


# -- pictures ----------------------------------------------------------------------------------


def _pictures(result: StudyResult) -> Iterator[Section]:
    """Yield a section with the pictures of a study, if there are any."""
    figures: list[tuple[Callable[[], Figure], str]] = []
    for checked in sorted(result.checked, key=lambda c: c.finding.passed):
        outcome = result.runs.get(checked.runs[0])
        if len(figures) < _MOST and outcome is not None and outcome.result is not None:
            figure = _drawn(checked, outcome.result)
            if figure is not None:
                figures.append((partial(_same, figure), f"{checked.name}: {checked.finding.words}."))
    if figures:
        yield Section("Pictures", figures=figures)


def _same(figure: Figure) -> Figure:
    return figure


def _drawn(checked: RequirementResult, result: Result) -> Figure | None:
    requirement = checked.requirement
    try:
        if isinstance(requirement, Mask):
            return _mask(requirement, result, _title(checked, result), checked.finding)
        if isinstance(requirement, Baseline) and checked.baseline is not None:
            return _over_baseline(requirement, [result, read_baseline(checked.baseline)], _title(checked, result))
        if isinstance(requirement, SettlingTime | Overshoot):
            return _step(requirement, result, _title(checked, result), checked.finding)
    except WorkbenchError:
        pass  # the finding says what is wrong
    return None


def _title(checked: RequirementResult, result: Result) -> str:
    model = result.get("model")
    return f"{model}: {checked.name}" if isinstance(model, str) else checked.name


def _mask(requirement: Mask, result: Result, title: str, compliance: Compliance) -> Figure:
    from workbench.study.picture import plot_between_masks  # noqa: PLC0415 - matplotlib is slow to import

    curves = requirement.responses(result, requirement.corners)
    return plot_between_masks(
        {c.label: (c.frequency, c.values(requirement.quantity)) for c in curves},
        title=title,
        quantity=requirement.quantity,
        unit=UNITS.get(requirement.quantity, curves[0].unit),
        upper=requirement.upper or (),
        lower=requirement.lower or (),
        worst=_place(compliance),
    )


def _over_baseline(requirement: Baseline, results: Sequence[Result], title: str) -> Figure | None:
    from workbench.study.picture import plot_baseline  # noqa: PLC0415 - matplotlib is slow to import

    curves = [a for a in requirement.compared(results) if a.theirs.along]
    if not curves:
        return None
    worst = max(curves, key=lambda a: float(a.ratio[a.worst]))
    return plot_baseline(worst, title=f"{title}, {worst.theirs.name}")


def _place(result: Compliance) -> tuple[float, float] | None:
    """Return the frequency [Hz] and the value of the worst place."""
    if not isinstance(result.value, float) or " Hz" not in result.where:
        return None
    return float(result.where.split(" Hz")[0]), result.value


def _step(requirement: SettlingTime | Overshoot, result: Result, title: str, compliance: Compliance) -> Figure:
    from workbench.study.picture import LIMIT, plot_step  # noqa: PLC0415 - matplotlib is slow to import

    history = requirement.history(result)
    begin, final = requirement.ends(history)
    number = requirement.number(history, 0.0)[0]
    limit = requirement.max
    if limit is not None and requirement.unit is not None:  # in which the limit is told, not the number
        limit = convert(limit, requirement.unit, requirement.units[0], requirement.name)
    broken = not compliance.passed and limit is not None and number > limit
    levels: dict[str, Any] = {"final": final}
    if isinstance(requirement, SettlingTime):
        settled = requirement.after + number
        levels["band"] = (f"± {100.0 * requirement.band:g} % of the step", requirement.band * abs(final - begin))
        levels["times"] = {"settled": settled} | ({} if limit is None else {LIMIT: requirement.after + limit})
        place = (settled, float(np.interp(settled, history.time, history.values)))
    else:
        levels["highest"] = None if limit is None else final + limit / 100.0 * (final - begin)
        up = math.copysign(1.0, final - begin)
        place = max(zip(history.time, history.values, strict=True), key=lambda row: up * (row[1] - final))
    levels["violated"] = place if broken else None
    name = requirement.signal(result)
    return plot_step(history.time, history.values, title=title, name=name, unit=history.unit, **levels)

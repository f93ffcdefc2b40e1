"""Baselines: records kept beside a study, with which its requirements compare those of now."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from workbench import __version__
from workbench.core.machine.files import replacing
from workbench.core.records.option import options_of
from workbench.core.records.record import read_json
from workbench.errors import InputError
from workbench.jobs.options import Workers
from workbench.study.description import Study
from workbench.study.plan import OUTPUTS, PlannedRun, RunResult, with_label
from workbench.study.requirements.base import NotMeasured, Requirement, Result
from workbench.study.result import RequirementResult

__all__ = ["baseline_file", "made_otherwise", "read_baseline", "renew"]

_MADE = "made"  # key of what a record was made of
_PASSING = ("seconds", "files")  # keys that say nothing about the model
_SHOWN = 8  # digits of a hash


def baseline_file(study: Study, requirement: Requirement, point: str) -> Path | None:
    """Return the file with which a requirement compares its result; None: with none.

    Args:
        study: that it belongs to.
        requirement: of the study.
        point: its label; empty: there is only one.
    """
    usual = Path(f"{study.path.stem}.baselines") / f"{requirement.analysis}.json"
    file = requirement.baseline(usual)
    return None if file is None else study.folder / with_label(file, point)


def read_baseline(file: Path) -> Result:
    """Return the record in a file.

    Raises:
        NotMeasured: there is none, or it cannot be read; with what to do.
    """
    remedy = "workbench run STUDY --update-baselines writes it"
    if not file.is_file():
        raise NotMeasured(f"there is no baseline {_named(file)}: {remedy}")
    try:
        result = read_json(file)
    except InputError as error:
        raise NotMeasured(f"{_named(file)}{str(error).removeprefix(str(file))}; {remedy} anew") from None
    if not isinstance(result, dict) or "command" not in result:
        raise NotMeasured(f"{_named(file)} is not the JSON of a command; {remedy} anew")
    return result


def made_otherwise(file: Path, run: PlannedRun) -> str:
    """Return how what was measured now came about in another way than the baseline; empty: in no other, or not known.

    Args:
        file: of the baseline.
        run: that measured.
    """
    try:
        baseline = read_baseline(file)
    except NotMeasured:
        return ""
    made = baseline.get(_MADE, {})
    files: Mapping[str, str] = made.get("files", {})
    said = [_other_file(name, hashed, files) for name, hashed in run.subject["files"].items()] if files else []
    now, before = (_asked(words) for words in (run.words, shlex.split(made.get("command_line", ""))[1:]))
    if before and set(now) != set(before):
        new, old = ([word for word in one if word not in other] for one, other in ((now, before), (before, now)))
        said.append(
            f"asked with {shlex.join(new) or 'nothing more'}, the baseline with {shlex.join(old) or 'nothing more'}"
        )
    version = baseline.get("version", __version__)
    if version != __version__:
        said.append(f"measured by version {__version__}, the baseline by {version}")
    return "; ".join(filter(None, said))


def _other_file(name: str, hashed: str, files: Mapping[str, str]) -> str:
    if files.get(name) == hashed:
        return ""
    before = f", was {files[name][:_SHOWN]}…" if name in files else ", was not among the baseline's files"
    return f"{name} is another one (SHA-256 {hashed[:_SHOWN]}…{before})"


def _asked(words: Sequence[str]) -> list[str]:
    """Return the words that matter to a result: not where it is written."""
    return [word for word in words if not any(word.startswith(f"--{name}=") for name in OUTPUTS)]


def renew(answered: Sequence[RequirementResult], outcomes: Mapping[PlannedRun, RunResult]) -> list[str]:
    """Write the baselines that are missing or not met; return what was done, a line for each.

    A baseline that is met stays as it is: else each renewal could move it by an error bar.

    Args:
        answered: requirements with baselines, beside those that there are.
        outcomes: of the analyses.

    Raises:
        InputError: a file cannot be written, or two different results belong into it.
    """
    shared: dict[Path, list[RequirementResult]] = {}
    for question in answered:
        if question.baseline is not None:
            shared.setdefault(question.baseline, []).append(question)
    notes = []
    for file, several in shared.items():
        runs = {q.runs for q in several}
        if len(runs) > 1:
            names = " and ".join(dict.fromkeys(f'"{q.name}"' for q in several))
            raise InputError(f"[[requirements]] {names}: have one baseline, {_named(file)}, but not one result")
        [(run,)] = runs
        notes.append(f"baseline {_named(file)}: {_renewed(file, run, outcomes.get(run), several)}")
    return notes


def _renewed(file: Path, run: PlannedRun, outcome: RunResult | None, asked: Sequence[RequirementResult]) -> str:
    if outcome is None or outcome.result is None:
        return f"not written, {run.label} {'was not run' if outcome is None else f'failed: {outcome.reason}'}"
    there, findings = file.is_file(), [q.finding for q in asked]
    if there and all(f.passed for f in findings):
        return "same, left as it is"
    for why in filter(None, (q.requirement.no_baseline(outcome.result) for q in asked)):
        return f"not written, {run.label}: {why}"
    _write(file, {**_record(outcome.result), _MADE: {"command_line": run.command_line, "files": run.subject["files"]}})
    return f"changed: {'; '.join(f.words for f in findings if not f.passed)}" if there else "new"


def _record(result: Result) -> dict[str, Any]:
    """Return a record without what is another each time, and where it was computed."""
    where = {d.name for d in options_of(Workers)} | {"store", "redo"}
    asked = {name: value for name, value in result.get("asked", {}).items() if name not in where}
    return {k: v for k, v in {**result, "asked": asked}.items() if k not in _PASSING}


def _write(file: Path, record: Mapping[str, Any]) -> None:
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{file.parent}: cannot be made: {error.strerror or error}") from None
    # A line for each key: small files, and a difference that a person can find.
    lines = [
        f"{json.dumps(key)}: {json.dumps(value, ensure_ascii=False, allow_nan=False)}" for key, value in record.items()
    ]
    with replacing(file) as part:
        part.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")


def _named(file: Path) -> str:
    """Return a file beside its folder, which is enough for people."""
    return f"{file.parent.name}/{file.name}"

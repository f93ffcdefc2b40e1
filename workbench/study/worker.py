"""What a worker process of a study does: run one command after the other."""

from __future__ import annotations

import json
import multiprocessing
import os
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from workbench.errors import InputError
from workbench.model.base import Model
from workbench.model.recipe import Recipe
from workbench.session.base import Session
from workbench.signals import Signal
from workbench.study.commands import RunCommand
from workbench.study.outcome import Outcome

__all__ = ["Job", "NoRecipe", "perform"]

_RESULT = "result.json"


@dataclass(frozen=True, kw_only=True)
class Job:
    """One command.

    Attributes:
        number: of the run, for whoever sent it.
        arguments: the command and its arguments.
        folder: in which it runs.
        workplace: where its result is written.
        csv: name of the CSV file without suffix, where other analyses take it; empty: none is wanted.
        run: runs a command in this process.
    """

    number: int
    arguments: tuple[str, ...]
    folder: Path
    workplace: Path
    csv: str
    run: RunCommand


def perform(_model: Model, job: Job) -> Iterator[Outcome]:
    """Run a command and yield what it gave, once."""
    os.chdir(job.folder)
    result, table = job.workplace / _RESULT, job.workplace / f"{job.csv}.csv"
    result.unlink(missing_ok=True)
    written = ("--json", str(result), *(("--csv", str(table)) if job.csv else ()))
    begin = time.monotonic()
    ended = job.run((*job.arguments, *written))
    seconds = round(time.monotonic() - begin, 3)
    found = _read(result)
    reason = ended.reason or ("" if found is not None else f"it ended with exit code {ended.code} and no result")
    yield Outcome(
        result=None if ended.reason else found,
        code=ended.code,
        reason=reason,
        bad_input=ended.bad_input,
        notes=ended.notes,
        seconds=seconds,
        files=_tables(job) if job.csv else {},
    )


def _read(path: Path) -> Mapping[str, Any] | None:
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return found if isinstance(found, dict) else None


def _tables(job: Job) -> dict[str, str]:
    """Return the CSV files by kind: NAME.csv is "csv", NAME_validation.csv is "validation"."""
    first = f"{job.csv}.csv"
    files = {f.name: f.read_text(encoding="utf-8") for f in job.workplace.glob(f"{job.csv}*.csv")}
    return {"csv" if n == first else Path(n).stem.removeprefix(f"{job.csv}_"): text for n, text in files.items()}


class _NoModel(Model):
    """Stands where a worker expects a model; the commands open their own."""

    name = "no model"

    def open_session(
        self,
        *,
        start_time: float | None = None,
        step: float | None = None,
        signals: Mapping[str, Signal] | None = None,
    ) -> Session:
        raise InputError("a study has no model of its own")

    def close(self) -> None:
        return


@dataclass(frozen=True)
class NoRecipe(Recipe):
    """Of no model: a worker that gets it runs commands."""

    def open(self) -> Model:
        # The commands run FMUs in worker processes of their own, which a daemon may not have; those watch for the end
        # of this process, so none stays behind.
        multiprocessing.current_process().daemon = False
        return _NoModel()

    def identity(self) -> dict[str, Any]:
        return {}

    def tighter(self, factor: float) -> Recipe:
        return self

    def abandon(self) -> None:
        return

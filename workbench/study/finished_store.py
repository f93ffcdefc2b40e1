"""Finished analyses on disk, and what an interrupted one left behind."""

from __future__ import annotations

import hashlib
import json
import shutil
import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from pydantic import TypeAdapter

from workbench import __version__
from workbench.core.machine.closable import Closable
from workbench.core.machine.scratch import remove, scratch_folder
from workbench.errors import InputError
from workbench.jobs.store import Store
from workbench.study.plan import PlannedRun, RunResult
from workbench.study.requirements.base import Compliance
from workbench.study.result import RequirementResult

__all__ = ["FOLDER", "Finished"]

FOLDER = ".workbench-store"
_UNFINISHED = "unfinished"
_FORGOTTEN = 30 * 86400.0  # what was left behind is removed after this time [s]
_LAYOUT = 1  # to be raised when what is stored changes


def _name(run: PlannedRun) -> str:
    """Return a name for everything that a result depends on."""
    return hashlib.sha256(json.dumps([run.subject, run.key], sort_keys=True).encode()).hexdigest()


def _name_of(questions: Sequence[RequirementResult]) -> str:
    """Return a name for requirements and the results that they are compared with."""
    content = [[c.requirement.model_dump(), [_name(run) for run in c.runs], _hash(c.baseline)] for c in questions]
    return f"findings {hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()}"


def _hash(file: Path | None) -> str:
    """Return the hash of a baseline; empty: there is none."""
    return hashlib.sha256(file.read_bytes()).hexdigest() if file is not None and file.is_file() else ""


class Finished(Closable):
    """The store of a study.

    Obligations:
      1. After `save` returns, the outcome is on disk; `load` returns only what was measured of the same files, with the
         same arguments, by the same state of the workbench.
      2. `workplace` is the same folder for the same run, so that a command with a store of its own goes on in it; it is
         removed by `save`.

    Args:
        folder: made when something is saved; None: nothing is kept.
        fresh: whether nothing is to be loaded.
    """

    def __init__(self, folder: Path | None, *, fresh: bool = False) -> None:
        self._fresh, self._keeps = fresh, folder is not None
        self._temporary = scratch_folder("study") if folder is None else None
        self.folder = folder or self._temporary or Path()
        self._opened: Store | None = None
        self._tidied = False

    def load(self, run: PlannedRun) -> RunResult | None:
        """Return what was measured before; None: nothing was, or a file that the run writes is not there.

        Raises:
            InputError: the store cannot be used.
        """
        if self._fresh or not self._keeps or not all(file.exists() for file in run.files):
            return None
        if not self.folder.is_dir():
            return None  # a study that was never run leaves no folder behind when something in it is wrong
        result = self._results().get(_name(run))
        with self._results().taken_apart():
            return None if result is None else RunResult.from_store(result)

    def save(self, run: PlannedRun, outcome: RunResult) -> None:
        """Keep an outcome; an analysis that failed is not kept, but what it left behind is.

        Raises:
            WorkbenchError: it cannot be written.
        """
        if not outcome.lasting:
            return
        if self._keeps:
            self._results().save(_name(run), outcome.to_store())
        shutil.rmtree(self.workplace(run, make=False), ignore_errors=True)

    def load_findings(self, questions: Sequence[RequirementResult]) -> list[Compliance] | None:
        """Return how requirements came out before, in their order; None: not of exactly these results."""
        if self._fresh or not self._keeps or not self.folder.is_dir():
            return None
        result = self._results().get(_name_of(questions))
        with self._results().taken_apart():
            return None if result is None else TypeAdapter(list[Compliance]).validate_python(result["findings"])

    def save_findings(self, checked: Sequence[RequirementResult]) -> None:
        """Keep how requirements came out.

        Raises:
            WorkbenchError: it cannot be written.
        """
        if self._keeps:
            self._results().save(_name_of(checked), {"findings": [asdict(c.finding) for c in checked]})

    def workplace(self, run: PlannedRun, *, make: bool = True) -> Path:
        """Return the folder in which a run works.

        Raises:
            InputError: it cannot be made.
        """
        path = self.folder / _UNFINISHED / _name(run)[:24]
        if not make:
            return path
        if self._fresh:
            shutil.rmtree(path, ignore_errors=True)
        try:
            path.mkdir(parents=True, exist_ok=True)
            self._tidy()
        except OSError as error:
            raise InputError(
                f"store {self.folder}: cannot be made: {error.strerror or error}; name one by `store`"
            ) from None
        return path.resolve()

    def _tidy(self) -> None:
        """Keep the store out of version control, as other tools do with their caches, and free of what is forgotten."""
        if self._tidied:  # a folder of a thousand points is looked through once
            return
        self._tidied = True
        file = self.folder / ".gitignore"
        if not file.exists():
            file.write_text("*\n", encoding="utf-8")
        for left in (self.folder / _UNFINISHED).iterdir():
            if time.time() - left.stat().st_mtime > _FORGOTTEN:
                shutil.rmtree(left, ignore_errors=True)

    def _results(self) -> Store:
        if self._opened is None:
            self._opened = Store(self.folder, subject={"study": _LAYOUT, "workbench": __version__}, effort={})
        return self._opened

    def remarks(self) -> list[str]:
        """Return what was found damaged in the store, in a line."""
        return [] if self._opened is None else self._opened.remarks()

    def close(self) -> None:
        """Close the files, and remove what was not to be kept. Any number of times."""
        if self._opened is not None:
            self._opened.close()
            self._opened = None
        if self._temporary is not None:
            remove(self._temporary)

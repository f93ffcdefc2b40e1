"""Finished analyses on disk, and what an interrupted one left behind."""

from __future__ import annotations

import hashlib
import json
import shutil
import tempfile
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from workbench.errors import InputError
from workbench.store import Store
from workbench.study.outcome import Outcome
from workbench.study.plan import Run

__all__ = ["FOLDER", "Finished"]

FOLDER = ".workbench-store"
_UNFINISHED = "unfinished"


class Finished:
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
        self._temporary = tempfile.TemporaryDirectory(prefix="fmi-workbench-") if folder is None else None
        self.folder = folder if folder is not None else Path(self._temporary.name if self._temporary else ".")
        self._stores: dict[str, Store] = {}
        self._loaded: dict[str, dict[str, Any]] = {}

    def load(self, run: Run) -> Outcome | None:
        """Return what was measured before; None: nothing was, or a file that the run writes is not there.

        Raises:
            InputError: the store cannot be used.
        """
        if self._fresh or not self._keeps or not all(file.exists() for file in run.files):
            return None
        subject = json.dumps(run.subject, sort_keys=True)
        if subject not in self._loaded:
            # A study that was never run leaves no folder behind when something in it is wrong.
            self._loaded[subject] = self._store(run).load() if (self.folder).is_dir() else {}
        found = self._loaded[subject].get(run.key)
        return None if found is None else Outcome.from_store(found)

    def save(self, run: Run, outcome: Outcome) -> None:
        """Keep an outcome; an analysis that failed is not kept, but what it left behind is.

        Raises:
            WorkbenchError: it cannot be written.
        """
        if not outcome.lasting:
            return
        if self._keeps:
            self._store(run).save(run.key, outcome.to_store())
        shutil.rmtree(self.workplace(run, make=False), ignore_errors=True)

    def workplace(self, run: Run, *, make: bool = True) -> Path:
        """Return the folder in which a run works.

        Raises:
            InputError: it cannot be made.
        """
        text = json.dumps([run.subject, run.key], sort_keys=True)
        path = self.folder / _UNFINISHED / hashlib.sha256(text.encode()).hexdigest()[:24]
        if not make:
            return path
        if self._fresh:
            shutil.rmtree(path, ignore_errors=True)
        try:
            path.mkdir(parents=True, exist_ok=True)
            self._ignore()
        except OSError as error:
            raise InputError(
                f"store {self.folder}: cannot be made: {error.strerror or error}; name one by --store"
            ) from None
        return path.resolve()

    def _ignore(self) -> None:
        """Keep the store out of version control, as other tools do with their caches."""
        file = self.folder / ".gitignore"
        if not file.exists():
            file.write_text("*\n", encoding="utf-8")

    def _store(self, run: Run) -> Store:
        subject = json.dumps(run.subject, sort_keys=True)
        if subject not in self._stores:
            self._stores[subject] = Store(self.folder, subject=run.subject, effort={})
        return self._stores[subject]

    def close(self) -> None:
        """Close the files, and remove what was not to be kept. Any number of times."""
        for store in self._stores.values():
            store.close()
        self._stores.clear()
        if self._temporary is not None:
            self._temporary.cleanup()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

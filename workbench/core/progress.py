"""A progress bar on standard error or in a notebook, for people who wait longer than a second."""

from __future__ import annotations

import sys
import time
from importlib.util import find_spec

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

from workbench.core.closable import Closable
from workbench.errors import one_line, shortened

__all__ = ["Bar", "in_notebook"]

_PATIENCE = 1.0
_WORD, _LINE = 60, 200  # longest word and text beside the bar [characters]


def in_notebook() -> bool:
    """Return whether a notebook runs this that can show a bar."""
    python = sys.modules.get("IPython")
    return python is not None and hasattr(python.get_ipython(), "kernel") and find_spec("ipywidgets") is not None


class Bar(Closable):
    """Shows how far the work is, once it has taken a second, and only on a terminal or in a notebook.

    Args:
        total: amount of work.
    """

    def __init__(self, total: float) -> None:
        self._total = total
        self._begin = time.monotonic()
        self._console = Console(stderr=True)
        self._progress: Progress | None = None
        self._task = TaskID(0)

    def update(self, done: float, text: str) -> None:
        """Tell what was done.

        Args:
            done: so much of the total.
            text: what is being worked on.
        """
        if self._progress is None and self._console.is_terminal and time.monotonic() - self._begin > _PATIENCE:
            columns = (TextColumn("{task.description}", markup=False), BarColumn(), TimeRemainingColumn())
            self._progress = Progress(*columns, console=self._console, transient=True)
            self._progress.start()
            self._task = self._progress.add_task(self._words(text), total=self._total)
        if self._progress is not None:
            self._progress.update(self._task, completed=done, description=self._words(text))

    @staticmethod
    def _words(text: str) -> str:
        return shortened(one_line(text), _WORD, _LINE)

    def close(self) -> None:
        if self._progress is not None:
            self._progress.stop()

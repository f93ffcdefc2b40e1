"""How far work is, on standard error or in a notebook: a bar for those who wait, lines for those who read it later."""

from __future__ import annotations

import sys
import time
from importlib.util import find_spec
from typing import TYPE_CHECKING

from workbench.core.machine.closable import Closable
from workbench.errors import one_line, shortened

if TYPE_CHECKING:
    from rich.progress import Progress

__all__ = ["FIRST_LINE", "Bar", "in_notebook"]

# A bar is shown after so long [s]; in a file or a pipe a line, the next when twice the time has gone, or so often.
_PATIENCE, FIRST_LINE, _OFTEN = 1.0, 30.0, 60.0
_WORD, _LINE = 60, 200  # longest word and text beside the bar [characters]


def in_notebook() -> bool:
    """Return whether a notebook runs this that can show a bar."""
    python = sys.modules.get("IPython")
    return python is not None and hasattr(python.get_ipython(), "kernel") and find_spec("ipywidgets") is not None


class Bar(Closable):
    """Shows how far the work is, once it has taken a second; where there is no terminal, a line now and then.

    Args:
        total: amount of work.
    """

    def __init__(self, total: float) -> None:
        self._total = total
        self._begin = time.monotonic()
        self._progress: Progress | None = None
        self._line = self._begin + FIRST_LINE

    def update(self, done: float, text: str) -> None:
        """Tell what was done.

        Args:
            done: so much of the total.
            text: what is being worked on.
        """
        now = time.monotonic()
        if not (sys.stderr.isatty() or in_notebook()):
            if now > self._line and done < self._total:
                self._line = now + min(now - self._begin, _OFTEN)
                sys.stderr.write(f"{done / self._total:.0%} {self._words(text)}\n")
            return
        if self._progress is None and now - self._begin > _PATIENCE:
            self._progress = self._shown()
            self._progress.add_task(self._words(text), total=self._total)
        if self._progress is not None:
            (task,) = self._progress.task_ids
            self._progress.update(task, completed=done, description=self._words(text))

    @staticmethod
    def _shown() -> Progress:
        """Show a bar; what draws it takes longer to load than a small analysis takes."""
        from rich.console import Console  # noqa: PLC0415
        from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn  # noqa: PLC0415

        columns = (TextColumn("{task.description}", markup=False), BarColumn(), TimeRemainingColumn())
        progress = Progress(*columns, console=Console(stderr=True), transient=True)
        progress.start()
        return progress

    @staticmethod
    def _words(text: str) -> str:
        return shortened(one_line(text), _WORD, _LINE)

    def close(self) -> None:
        if self._progress is not None:
            self._progress.stop()

"""One job of many, done once more in another process: whether the FMU's numbers depend on the process."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workbench.errors import WorkbenchError
from workbench.jobs.runner import Lost, Reply

__all__ = ["ENOUGH", "Numbers", "Sample"]

ENOUGH = 10  # jobs: one more costs a tenth at most
_ROUNDING = 1e-12  # of the largest number: sums whose order changes, as with threads

Numbers = Callable[[Sequence[Any]], NDArray[Any]]
"""Returns what is compared of the items of a job, shape (n,)."""


@dataclass
class Sample:
    """A job that is done in two processes.

    Attributes:
        job: the very object.
        pid: number of the process that does it first.
        items: it gave.
        again: what it gave in another process; None: it was not done again.
        why: it was not finished there.
    """

    job: Any
    pid: int
    items: list[Any] = field(default_factory=list)
    again: list[Any] | None = None
    why: str = ""

    def passed_on(self, events: Iterator[Reply | Lost]) -> Iterator[Reply | Lost]:
        """Yield the events of all jobs, those of this one the first time only.

        Args:
            events: as the workers tell them.
        """
        for event in events:
            if event.job is not self.job:
                yield event
            elif self.again is None:
                if isinstance(event, Reply):
                    self.items.append(event.value)
                yield event
            elif isinstance(event, Reply):
                self.again.append(event.value)
            else:
                self.why = event.reason

    def failed(self, error: WorkbenchError) -> None:
        """Take down why it could not be done again.

        Args:
            error: that ended it.
        """
        self.why = str(error)

    def remark(self, numbers: Numbers) -> str:
        """Return in a line how both differ; empty: not at all, or it was not done again.

        Args:
            numbers: what is compared.
        """
        if self.again is None:
            return ""
        if self.why:
            return f"{_TWICE} failed in the second: {self.why}; {_CAUSE}"
        a, b = numbers(self.items), numbers(self.again)
        if a.shape != b.shape:
            return f"{_TWICE} gave another number of values; {_CAUSE}"
        size = float(np.abs(a).max(initial=0.0)) or 1.0
        gap = float(np.abs(b - a).max(initial=0.0)) / size
        return "" if gap <= _ROUNDING else f"{_TWICE} differs by {gap:.2g} of its size; {_CAUSE}"


_TWICE = "one and the same point, taken in two worker processes,"
_CAUSE = (
    "the FMU's numbers depend on the process that it runs in (memory that nobody has set, static variables, threads): "
    "points of several workers do not belong to one model, and check tells more"
)

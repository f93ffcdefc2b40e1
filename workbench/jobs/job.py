"""A request being run: what it tells while it runs, and how it is stopped."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

__all__ = ["SLOW", "Job", "Progress"]

SLOW = 20.0  # [s]: what will take longer is said before it begins

Progress = Callable[[Any, int, int], None]
"""Is called with what was finished (a point, or words for it), how many are done, and how many there are in all."""


class Job:
    """What a running analysis tells, and whether it should stop.

    Args:
        progress: called with each finished part.

    Attributes:
        partial: returns the record of what is finished so far; None: there is nothing yet.
        notes: remarks on how the analysis runs.
        say: called with what is of use only while it runs.
        reached: number of parts finished, and their total number; (0, 0): nothing was reported yet.
        stopped: whether `stop` was called.
        checking: what is still done, in words, while the partial record is the whole answer; empty: it is not yet.
    """

    def __init__(self, progress: Progress | None = None) -> None:
        self._progress = progress
        self._ends: list[Callable[[], None]] = []
        self.partial: Callable[[], object] = lambda: None
        self.notes: list[str] = []
        self.say: Callable[[str], None] = lambda _: None
        self.reached = 0, 0
        self.stopped = False
        self.checking = ""
        self._stage = 1, 1

    def done(self, what: object, done: int, total: int) -> None:
        """Tell that something is finished.

        Args:
            what: a point, or words for it.
            done: number of points finished.
            total: number of points in all, as far as it is known.
        """
        number, count = self._stage
        self.reached = (number - 1) * total + done, count * total
        if self._progress is not None:
            self._progress(what, *self.reached)

    def found(self, record: Callable[[], object], checking: str) -> None:
        """Tell that the answer is there: whatever becomes of what comes after it, it is not lost.

        Args:
            record: returns it.
            checking: what is still done, in words.
        """
        self.partial, self.checking = record, checking
        if self._progress is not None:
            done, total = self.reached
            self._progress(checking, done, max(total, 1))

    def stage(self, number: int, count: int) -> None:
        """Begin a stage: what is told from now on counts within it.

        Args:
            number: of the stage, from 1.
            count: number of stages, of equal work each.
        """
        self._stage = number, count

    def ended(self, what: object, record: object) -> None:
        """Tell that all is finished, if that was not told yet.

        Args:
            what: words for the work.
            record: what it gave.

        Raises:
            KeyboardInterrupt: the job was stopped; the record is what there was until then.
        """
        self.partial = lambda: record
        done, total = self.reached
        if done < max(total, 1) and not self.stopped:
            self.stage(1, 1)
            self.done(what, max(total, 1), max(total, 1))
        if self.stopped:
            raise KeyboardInterrupt

    def stop(self) -> None:
        """Let the analysis end soon; a signal handler may call it.

        Raises:
            KeyboardInterrupt: the analysis has no other way to end, and is not about to return its answer.
        """
        self.stopped = True
        done, total = self.reached
        if not self._ends and (done < max(total, 1) or self.checking):
            raise KeyboardInterrupt
        for end in self._ends:
            end()

    @contextmanager
    def ended_by(self, end: Callable[[], None] = lambda: None) -> Iterator[None]:
        """Let `stop` call a function while this is entered, in place of a KeyboardInterrupt.

        Args:
            end: ends the work soon; it is called at once where `stop` came before. By default nothing: the work looks
                at `stopped`.
        """
        self._ends.append(end)
        try:
            if self.stopped:
                end()
            yield
        finally:
            self._ends.remove(end)

"""Rows that can be taken back: those of a step that is refused."""

from __future__ import annotations

from workbench.session.rows import Rows

__all__ = ["UndoableRows"]


class UndoableRows(Rows):
    """`Rows` with a way back."""

    @property
    def count(self) -> int:
        """Number of rows so far."""
        return len(self._times)

    def cut(self, count: int) -> None:
        """Forget all but the first `count` rows."""
        for column in (self._times, self._values, self._inputs):
            del column[count:]

"""Standard output and error that may be closed, full or cut off: the command goes on, its files are written."""

from __future__ import annotations

import errno
import io
import os
import sys
from contextlib import suppress
from typing import TextIO

__all__ = ["complaint", "guard"]

_HIGHEST = 2  # descriptor of standard error


class _Stream(io.TextIOWrapper):
    """A stream that remembers why it could not be written to, in place of raising it.

    Attributes:
        trouble: the first reason, other than that whoever read has seen enough; None: none.
        closed_from_the_start: whether the program was started without it.
    """

    trouble: OSError | None = None
    closed_from_the_start = False

    def write(self, text: str, /) -> int:
        if self.closed_from_the_start and text:
            self.trouble = OSError(errno.EBADF, "it is closed")
        try:
            return super().write(text)
        except OSError as error:
            self._give_up(error)
            return len(text)

    def flush(self) -> None:
        try:
            super().flush()
        except OSError as error:
            self._give_up(error)

    def _give_up(self, error: OSError) -> None:
        """Let all that follows, and what waits in the buffer, go nowhere."""
        if not isinstance(error, BrokenPipeError):
            self.trouble = self.trouble or error
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self.fileno())
        os.close(nowhere)
        with suppress(OSError):
            super().flush()


def guard() -> None:
    """Let no trouble with the standard streams end the command; text is written as UTF-8, whatever the code page."""
    while (nowhere := os.open(os.devnull, os.O_RDWR)) <= _HIGHEST:
        pass  # what is closed: else the next file that is opened would be taken for a standard stream
    os.close(nowhere)
    sys.stdout, sys.stderr = _guarded(sys.stdout, 1), _guarded(sys.stderr, 2)


def _guarded(stream: TextIO | None, descriptor: int) -> TextIO:
    if stream is not None and not isinstance(stream, io.TextIOWrapper):
        return stream  # somebody's own, not the system's
    closed = stream is None
    buffer = open(descriptor, "wb", closefd=False) if stream is None else stream.buffer  # noqa: SIM115
    interactive = descriptor == _HIGHEST or os.isatty(descriptor)
    guarded = _Stream(buffer, encoding="utf-8", errors="replace", line_buffering=interactive)
    guarded.closed_from_the_start = closed
    return guarded


def complaint() -> str:
    """Return why standard output did not take all that was written to it, in one line; empty: it did."""
    stream = sys.stdout
    if not isinstance(stream, _Stream):
        return ""
    stream.flush()
    if stream.trouble is None:
        return ""
    why = stream.trouble.strerror or stream.trouble
    return f"standard output: {why}; what was to be written there is lost, files that were named are not"

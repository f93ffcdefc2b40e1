"""Remarks beside a result, on standard error.

They wait until the command is done: bad input then gets one line and nothing else.
"""

from __future__ import annotations

import sys

from workbench.cli.command_line import spoken
from workbench.errors import is_choice, one_line

__all__ = ["drop", "flush", "note", "said", "say"]

_waiting: list[str] = []  # of the one command that a process runs
_said: list[str] = []  # all of them, also those that are written already


def note(text: str) -> None:
    """Keep a remark until `flush`."""
    if text not in _waiting:
        _waiting.append(text)
        _said.append(text)


def say(text: str) -> None:
    """Write a remark at once, for whoever waits."""
    note(text)
    flush()


def said() -> tuple[str, ...]:
    """Return every remark of the command so far, for its report."""
    return tuple(dict.fromkeys(_said))


def flush() -> None:
    """Write what was kept to standard error; what `auto` took is in the title already."""
    if not _waiting:
        return
    for text in _waiting:
        if not is_choice(text):
            sys.stderr.write(f"note: {one_line(spoken(text))}\n")
    _waiting.clear()


def drop() -> None:
    """Forget what was kept."""
    _waiting.clear()
    _said.clear()

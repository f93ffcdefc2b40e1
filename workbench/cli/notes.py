"""Remarks beside a result, on standard error.

They wait until the command is done: bad input then gets one line and nothing else.
"""

from __future__ import annotations

import sys

__all__ = ["drop", "flush", "note"]

_waiting: list[str] = []  # of the one command that a process runs


def note(text: str) -> None:
    """Keep a remark until `flush`."""
    if text not in _waiting:
        _waiting.append(text)


def flush() -> None:
    """Write what was kept to standard error."""
    for text in _waiting:
        sys.stderr.write(f"note: {text}\n")
    _waiting.clear()


def drop() -> None:
    """Forget what was kept."""
    _waiting.clear()

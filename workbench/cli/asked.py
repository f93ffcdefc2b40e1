"""What was asked for, as it can be typed again."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Sequence

__all__ = ["command_line", "keep", "was_given"]

_arguments: list[str] = []  # of the one command that a process runs


def keep(arguments: Sequence[str] | None) -> None:
    """Keep the arguments of the command that is about to run.

    Args:
        arguments: None: the process's own.
    """
    _arguments[:] = sys.argv[1:] if arguments is None else arguments


def command_line() -> str:
    """Return the line that runs the command again."""
    return shlex.join(["workbench", *_arguments])


def was_given(option: str) -> bool:
    """Return whether an option stands in that line.

    Args:
        option: as "--at".
    """
    return any(word == option or word.startswith(f"{option}=") for word in _arguments)

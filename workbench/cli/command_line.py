"""What was asked for, as it can be typed again."""

from __future__ import annotations

import re
import shlex
from collections.abc import Mapping, Sequence

__all__ = ["command_line", "complaint", "keep", "spoken", "was_given"]

_arguments: list[str] = []  # of the one command that a process runs, behind the program's name
_called = ["workbench"]
_options: dict[str, str] = {}  # of that command: name in Python → on the command line
_QUOTED = re.compile(r"`(\w+)`")  # an option, as messages of the library name one
_NAME = re.compile(r"(?<![\w.'\"/=-])[a-z]+(?:_[a-z]+)+(?![\w.(])")  # not in quotes: those are names of variables


def keep(arguments: Sequence[str], options: Mapping[str, str], called: str) -> None:
    """Keep the arguments of the command that is about to run, and what its options are called.

    Args:
        arguments: behind the name of the program.
        options: name in Python → on the command line.
        called: how the program is called.
    """
    _called[:] = [called]
    _arguments[:] = arguments
    _options.clear()
    _options.update(options)


def spoken(message: str) -> str:
    """Return a message of the library with the command's options as one types them: max_order and `band` are flags.

    Args:
        message: one line.
    """
    message = _QUOTED.sub(lambda match: _options.get(match[1], match[1]), message)
    return _NAME.sub(lambda match: _options.get(match[0], match[0]), message)


def complaint(message: str) -> str:
    """Return an error of the library in the words of the command line: "dt: …" begins with --step, see also `spoken`.

    Args:
        message: one line.
    """
    head, colon, rest = message.partition(":")
    return spoken(_options.get(head.replace(" ", "_"), head) + colon + rest)


def command_line() -> str:
    """Return the line that runs the command again."""
    return f"{_called[0]} {shlex.join(_arguments)}"


def was_given(option: str) -> bool:
    """Return whether an option stands in that line.

    Args:
        option: as "--at".
    """
    return any(word == option or word.startswith(f"{option}=") for word in _arguments)

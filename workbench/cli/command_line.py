"""What was asked for, as it can be typed again."""

from __future__ import annotations

import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from typing import Any, TypeVar, cast

from workbench.commands import MOVED

__all__ = ["command_line", "complaint", "in_flags", "keep", "spoken", "was_given"]

_Part = TypeVar("_Part")

_arguments: list[str] = []  # of the one command that a process runs, behind the program's name
_called = ["workbench"]
_options: dict[str, str] = {}  # of that command: name in Python → on the command line
_QUOTED = re.compile(r"`(?P<wb>wb\.)?(?P<name>\w+)(?:=(?P<value>[^`]*))?`")  # as messages of the library name an option
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
    message = in_flags(message)
    return _NAME.sub(lambda match: _options.get(match[0], match[0]), message)


def in_flags(part: _Part) -> _Part:
    """Return a text, or what is made of texts as a page is, with flags for what stands there as code of Python.

    `max_periods` becomes --max-periods, `step=0.01` --step 0.01, `feedthrough=False` --no-feedthrough, and a function
    of wb the command that does the same. What is not an option of the command loses its quotes only.

    Args:
        part: the text, or a dataclass or collection with texts in it.
    """
    result: Any = part
    if isinstance(part, str):
        result = _QUOTED.sub(_as_typed, part) if "`" in part else part
    elif is_dataclass(part) and not isinstance(part, type):
        result = replace(part, **{f.name: in_flags(getattr(part, f.name)) for f in fields(part)})
    elif isinstance(part, list | tuple):
        result = type(part)(map(in_flags, part))
    elif isinstance(part, dict):
        result = {key: in_flags(value) for key, value in part.items()}
    return cast("_Part", result)


def _as_typed(match: re.Match[str]) -> str:
    name, value = match["name"], match["value"]
    if match["wb"]:
        return MOVED.get(name, f"workbench {name.replace('_', '-')}")
    flag = _options.get(f"model_{name}", _options.get(name))  # how models are opened is what messages speak of most
    if flag is None:
        return name if value is None else f"{name}={value}"
    switched = {None: flag, "True": flag, "False": f"--no-{flag.removeprefix('--')}"}
    return switched.get(value, f"{flag} {value}")


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

"""The program's commands, each built from its options when it is first needed."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from typing import Any

import typer

from workbench.errors import one_line

__all__ = ["Lazily", "options_of", "program", "said"]


def program(app: typer.Typer, name: str | None) -> Any:  # noqa: ANN401 - typer's own class of a group is not public
    """Return the program with one command alone; with all of them if there is none of that name.

    Reading the options of all commands takes several times as long as those of one, and longer than a small analysis.

    Args:
        app: what the commands are registered in.
        name: of the command.
    """
    wanted = [command for command in app.registered_commands if command.name == name]
    if not wanted:
        return typer.main.get_group(app)
    alone = copy.copy(app)
    alone.registered_commands = wanted
    return typer.main.get_group(alone)


def options_of(command: Any, name: str | None) -> dict[str, str]:  # noqa: ANN401 - see `program`
    """Return what the options of a command are called: name in Python → on the command line.

    Args:
        command: the program.
        name: of its command; None: there is none.
    """
    known = getattr(command, "commands", {}).get(name)
    options = [p for p in known.params if p.opts[0].startswith("--")] if known else []
    return {str(option.name): str(option.opts[0]) for option in options}


def said(error: typer.TyperException) -> str:
    """Return what is wrong with a command line, in one line and without the words of the libraries underneath."""
    return one_line(error.format_message()).replace(": Value error, ", ": ")


class Lazily(Mapping[str, Any]):
    """Name → command, in their order.

    Args:
        app: what they are registered in.
    """

    def __init__(self, app: typer.Typer) -> None:
        self._app = app
        self._names = [str(command.name) for command in app.registered_commands]
        self._built: dict[str, Any] = {}

    def __getitem__(self, name: str) -> Any:  # noqa: ANN401 - typer's own class of a command is not public
        if name not in self._names:
            raise KeyError(name)
        if name not in self._built:
            self._built[name] = program(self._app, name).commands[name]
        return self._built[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

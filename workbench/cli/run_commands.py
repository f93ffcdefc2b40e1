"""A command run inside a worker process of a study, for those that are no requests."""

from __future__ import annotations

import io
from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout

import typer

from workbench.cli import asked, notes
from workbench.cli.program import program, said
from workbench.errors import InputError, WorkbenchError
from workbench.study.outcome import Outcome

__all__ = ["run_command"]

_NOTE = "note: "


def run_command(arguments: Sequence[str]) -> Outcome:
    """Run a command in this process, silently.

    Args:
        arguments: the command's name and its arguments.
    """
    said = io.StringIO()
    notes.drop()
    asked.keep(arguments)
    with redirect_stdout(io.StringIO()), redirect_stderr(said):
        code, reason, bad = _run(arguments)
        notes.flush()
    lines = said.getvalue().splitlines()
    return Outcome(
        code=code,
        reason=reason,
        bad_input=bad,
        notes=tuple(line.removeprefix(_NOTE) for line in lines if line.startswith(_NOTE)),
    )


def _run(arguments: Sequence[str]) -> tuple[int, str, bool]:
    """Return exit code, reason, and whether the input was bad."""
    command = program(arguments[0] if arguments else None)
    try:
        code = command.main(list(arguments), "workbench", standalone_mode=False)
    except typer.TyperException as error:
        return 2, said(error).replace("'--", "'").removesuffix("."), True
    except InputError as error:
        return 2, error.args[0], True
    except WorkbenchError as error:
        return 2, error.args[0], False
    return (code if isinstance(code, int) else 0), "", False

"""The program: its commands, its exit codes, and errors as one line."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

import click

from workbench.cli import command_line as asked
from workbench.cli import notes
from workbench.cli.github import tell_error
from workbench.cli.interrupt import exit_code, interrupted, was_interrupted
from workbench.cli.program import BEGINNING, completing, options_of, program, said
from workbench.commands import COMMANDS, MOVED, requests_of
from workbench.core.records.plug_ins import faults
from workbench.errors import InputError, WorkbenchError, one_line, suggest
from workbench.jobs.end_signals import INTERRUPTED
from workbench.jobs.options import InWorker
from workbench.requests.request import Request, modules_of

__all__ = ["BAD_INPUT", "run"]

BAD_INPUT = 2

# With these a command needs no worker process, one of its own, or perhaps none: the store may have all.
_NEEDS_NONE = {"-h", "--help", "--help-all", "--in-process", "--scheduler", "--confine", "--memory-limit", "--store"}


def run(
    arguments: Sequence[str] | None = None,
    own: type[Request[Any, Any]] | None = None,
    called: str = "workbench",
    *,
    alone: bool = False,
) -> int:
    """Run the program and return its exit code.

    Args:
        arguments: in place of the process's own.
        own: request of a command that is not one of the package's; None: all of these.
        called: how the program is called, as in a shell.
        alone: whether this process does nothing else.
    """
    given = sys.argv[1:] if arguments is None else arguments
    notes.drop()
    begun = completing()
    if not given and not begun and own is None:
        sys.stdout.write(BEGINNING)
        return BAD_INPUT
    words = given or ["--help"]
    name = next(iter(begun[1:] or words), None)
    try:
        if not begun and own is None:
            _expect(name, words, alone=alone)
            own = _study_of_its_own(name, words)
        command = program(name, own)
        asked.keep(words, options_of(command), called)
        alone = command.name == name
        code = command.main(list(words[alone:]), f"{called} {name}" if alone else called, standalone_mode=False)
    except click.ClickException as error:
        return _complain(said(error))
    except WorkbenchError as error:
        return _complain(asked.complaint(str(error)), error)
    except MemoryError:
        return _complain("out of memory: more was asked for, or a file is larger, than this process may hold")
    except (KeyboardInterrupt, click.Abort):
        code = INTERRUPTED
    except Exception:
        if not was_interrupted():  # else what was being imported made an error of its own of it
            raise
        code = INTERRUPTED
    code = _told(code)
    for text in faults():
        notes.note(text)
    notes.flush()
    return code if given else BAD_INPUT


def _told(code: object) -> int:
    """Return the exit code of what a command returned; an interrupt that nobody told of is told."""
    if code != INTERRUPTED:
        return code if isinstance(code, int) else 0
    if not any(text.startswith("interrupted") for text in notes.said()):
        notes.note(f"{interrupted()}: there is no result")
    return exit_code()


def _expect(name: str | None, words: Sequence[str], *, alone: bool) -> None:
    """Start the worker process that a command will need while the command line is read, unless a copy of this one does.

    Raises:
        InputError: there is no such command, or it was one once.
    """
    if name is None or name.startswith("-"):
        return
    if name in MOVED:
        raise InputError(f"{name} is now {MOVED[name]}")
    if name not in COMMANDS:
        raise InputError(f"No such command '{name}'; {suggest(name, COMMANDS)}")
    given = {word.partition("=")[0] for word in words}
    if not _NEEDS_NONE.isdisjoint(given):
        return
    request = next(iter(requests_of(name)), None)
    if request is not None and (request.isolated or issubclass(request, InWorker)):
        from workbench.jobs.worker_process import allow_copy, prepare

        if not (alone and allow_copy()):
            prepare(modules_of(request))


def _study_of_its_own(name: str | None, words: Sequence[str]) -> type[Request[Any, Any]] | None:
    """Return the request behind `run` where a study among the words is for it, as its options are others."""
    studies = requests_of("run") if name == "run" and "--example" not in words else ()
    return next((request for request in studies if any(request.takes([word]) for word in words)), None)


def _complain(message: str, error: WorkbenchError | None = None) -> int:
    sys.stderr.write(f"workbench: {one_line(message)}\n")
    if error is None:
        tell_error(message)
    else:
        from workbench.show.cases import mistakes_of

        for mistake in mistakes_of(error):
            tell_error(asked.complaint(mistake.message), mistake.file, line=mistake.line)
    return BAD_INPUT

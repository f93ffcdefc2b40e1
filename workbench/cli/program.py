"""The program's commands, each imported and built when it is first needed.

Importing all of them, and reading their options, takes several times as long as one, and longer than a small analysis.
"""

from __future__ import annotations

import inspect
import os
import re
from collections.abc import Callable
from functools import cache
from typing import Annotated, Any

import typer
import typer.core

from workbench import __version__
from workbench.commands import REQUESTS, request_of
from workbench.core.records.named import named
from workbench.errors import one_line
from workbench.requests.request import Request

__all__ = ["COMMANDS", "command_of", "completing", "function_of", "options_of", "program", "said"]

_FUNCTIONS = {"run": "cli.run:run", "ui": "cli.ui:ui"}
# Of requests, and of functions that typer calls.
COMMANDS = (*(name for one in REQUESTS for name in (("run", one) if one == "blocks" else (one,))), "ui")


_WANTED = {"float_parsing": "a number", "int_parsing": "a whole number"}  # what pydantic refuses
_NO_PARTS = r"No such option: (--scheduler\S*).*"
_COMPLETE = "_WORKBENCH_COMPLETE"  # set by the shell scripts that typer installs
_IDLE = r" \(Possible options: --help\)|--help, "  # what typer proposes for any word


class _Command(typer.core.TyperCommand):
    """A command whose line of usage has its argument as the texts have it: MODEL, not {MODEL}."""

    def collect_usage_pieces(self, ctx: Any) -> list[str]:  # noqa: ANN401 - typer's own class is not public
        """Return the words behind the command's name."""
        return [re.sub(r"^\{(.*)\}(\.\.\.)?$", r"\1", piece) for piece in super().collect_usage_pieces(ctx)]


def program(name: str | None, own: type[Request[Any, Any]] | None = None) -> Any:  # noqa: ANN401 - typer's own class of a group is not public
    """Return the program with one command alone; if there is none of that name, with the help of all of them.

    Args:
        name: of the command.
        own: request of a command that is not one of the package's; None: it is.
    """
    app = typer.Typer(
        name="workbench",
        help="Analyse FMUs: time histories, operating points, linear models, frequency responses; identify; build.",
        no_args_is_help=True,
        add_completion=name not in COMMANDS or bool(completing()),
        rich_markup_mode="markdown",
        context_settings={"help_option_names": ["-h", "--help"]},
        pretty_exceptions_enable=False,
    )
    app.callback()(_options)
    if own is not None or name in COMMANDS:
        app.command(name, cls=_Command)(function_of(str(name), own))
        return typer.main.get_command(app)
    for other in COMMANDS:
        app.command(other)(_words(other))
    return typer.main.get_command(app)


def completing() -> list[str]:
    """Return the words of a command line that a shell asks to complete; none: the program was called as usual."""
    if _COMPLETE not in os.environ:
        return []
    return (os.environ.get("COMP_WORDS") or os.environ.get("_TYPER_COMPLETE_ARGS") or "workbench").split()


def function_of(name: str, own: type[Request[Any, Any]] | None = None) -> Callable[..., int | None]:
    """Return the command as typer takes it.

    Args:
        name: of the command.
        own: see `program`.
    """
    found: Callable[..., Any] = own or _declared(name)
    if not isinstance(found, type):
        return found
    from workbench.cli.derive import command
    from workbench.cli.questions import before

    return command(found, before(name))


def _declared(name: str) -> Any:  # noqa: ANN401 - a class or a function
    return named(f"workbench.{_FUNCTIONS[name]}") if name in _FUNCTIONS else request_of(name)


def _words(name: str) -> Callable[[], None]:
    """Return what has the command's help and no options."""

    def shown() -> None:
        pass

    shown.__doc__ = inspect.cleandoc(_declared(name).__doc__ or "").split("\n\n")[0]
    return shown


def _show_version(wanted: bool) -> None:  # noqa: FBT001 - typer calls it so
    if wanted:
        typer.echo(f"workbench {__version__}")
        raise typer.Exit


def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version and stop.")
    ] = False,
) -> None:
    """Analyse FMUs: time histories, operating points, linear models, frequency responses, identification; build FMUs.

    MODEL is an `.fmu`, an unpacked FMU folder, or a bundled one: `fmu:Rudder` (FMI 2.0), `fmu:Rudder@3` (FMI 3.0).

    Example: `workbench nfr fmu:Rudder --input delC --output del --band 0.5:20 --amplitude 1,4 --plot bode.png`
    """


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
    refused: Any = error.__cause__  # pydantic's, where a value is not of its type
    for first in refused.errors() if hasattr(refused, "errors") else ():
        if wanted := _WANTED.get(first["type"]):
            flag = next(iter(getattr(getattr(error, "param", None), "opts", [])), "")
            return f"{flag}: '{first['input']}' is not {wanted}"
    text = re.sub(_IDLE, "", one_line(error.format_message()).replace(": Value error, ", ": "))
    where = getattr(error, "ctx", None)
    if text.startswith("Missing ") and where is not None:
        text = f"{text.rstrip('.')}; {where.command_path} --help has an example"
    return re.sub(_NO_PARTS, r"\1: this command has no parts that could run on a cluster; leave it out", text)


@cache
def command_of(name: str) -> Any:  # noqa: ANN401 - typer's own class of a command is not public
    """Return a command as it parses its words.

    Args:
        name: one of `COMMANDS`.
    """
    return program(name).commands[name]

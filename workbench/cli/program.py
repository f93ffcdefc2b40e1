"""The program's commands, each imported and built when it is first needed.

Importing all of them, and reading their options, takes several times as long as one, and longer than a small analysis.
"""

from __future__ import annotations

import inspect
import os
import re
from collections.abc import Callable
from typing import Annotated, Any

import typer
import typer.core

from workbench import __version__
from workbench.commands import COMMANDS, GROUPS, requests_of
from workbench.core.records.named import named
from workbench.core.records.option import in_unit
from workbench.errors import one_line
from workbench.requests.request import Request

__all__ = ["COMMANDS", "completing", "function_of", "options_of", "program", "said"]

_FUNCTIONS = {"run": "cli.run:run", "schema": "cli.schema:schema", "ui": "cli.ui:ui"}

_WANTED = {"float_parsing": "a number", "int_parsing": "a whole number"}  # what pydantic refuses
_NO_PARTS = r"No such option: (--scheduler\S*).*"
_WIDEST = 120  # characters of a line of help
_COMPLETE = "_WORKBENCH_COMPLETE"  # set by the shell scripts that typer installs
_IDLE = r" \(Possible options: --help\)|--help, "  # what typer proposes for any word


class _Plain:
    """Help as plain text: what typer draws with rich takes three times as long as all the rest of `--help`."""

    help: str | None

    def format_help_text(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401 - typer's own class is not public
        """Write the paragraphs; a line to copy stays one line."""
        for text in inspect.cleandoc(self.help or "").split("\n\n"):
            formatter.write_paragraph()
            with formatter.indentation():
                if text.startswith("Example"):
                    formatter.write(f"  {_unquoted(text)}\n")
                else:
                    formatter.write_text(_unquoted(text))


class _PlainCommand(_Plain, typer.core.TyperCommand):
    """A command whose line of usage has its argument as the texts have it, MODEL, and whose options have headings."""

    def collect_usage_pieces(self, ctx: Any) -> list[str]:  # noqa: ANN401 - as above
        """Return the words behind the command's name."""
        return [re.sub(r"^\{(.*)\}(\.\.\.)?$", r"\1", piece) for piece in super().collect_usage_pieces(ctx)]

    def format_options(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401 - as above
        """Write the options under the headings of the parts that declare them."""
        rows: dict[str, list[tuple[str, str]]] = {}
        for one in self.get_params(ctx):
            if record := one.get_help_record(ctx):
                argument = one.param_type_name == "argument"
                heading = getattr(one, "rich_help_panel", None) or ("Arguments" if argument else "Options")
                name = str(one.metavar) if argument else record[0]
                rows.setdefault(heading, []).append((name, _unquoted(record[1])))
        for heading, records in rows.items():
            with formatter.section(heading):
                formatter.write_dl(records)


class _Program(_Plain, typer.core.TyperGroup):
    """All commands, each with its first sentence in full."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401 - as above
        """Write the commands."""
        for group, names in GROUPS.items():
            with formatter.section(group):
                formatter.write_dl([(name, _unquoted(self.commands[name].help or "")) for name in names])


def _unquoted(text: str) -> str:
    return text.replace("`", "")


def program(name: str | None, own: type[Request[Any, Any]] | None = None) -> Any:  # noqa: ANN401 - as above
    """Return a command alone, which is quick; if there is none of that name, the program with the help of all of them.

    Args:
        name: of the command.
        own: request of a command that is not one of the package's; None: it is.
    """
    alone = own is not None or (name in COMMANDS and not completing())
    app = typer.Typer(
        cls=_Program,
        name="workbench",
        add_completion=not alone,
        rich_markup_mode=None,
        context_settings={"help_option_names": ["-h", "--help"], "max_content_width": _WIDEST},
        pretty_exceptions_enable=False,
    )
    if not alone:
        app.callback()(_options)
    for one in [str(name)] if own is not None or name in COMMANDS else COMMANDS:
        app.command(one, cls=_PlainCommand)(function_of(one, own) if one == name else _words(one))
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
    if own is None and name in _FUNCTIONS:
        function: Callable[..., int | None] = named(f"workbench.{_FUNCTIONS[name]}")
        return function
    from workbench.cli.derive import command
    from workbench.cli.questions import before

    return command(requests_of(name) if own is None else [own], before(name))


def _words(name: str) -> Callable[[], None]:
    """Return what has the command's help and no options."""

    def shown() -> None:
        pass

    declared = function_of(name) if name in _FUNCTIONS else requests_of(name)[0]
    shown.__doc__ = inspect.cleandoc(declared.__doc__ or "").split("\n\n")[0]
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


def options_of(command: Any) -> dict[str, str]:  # noqa: ANN401 - see `program`
    """Return what the options of a command are called: name in Python → on the command line.

    Args:
        command: as `program` returns it.
    """
    return {str(p.name): str(p.opts[0]) for p in command.params if p.opts[0].startswith("--")}


def said(error: typer.TyperException) -> str:
    """Return what is wrong with a command line, in one line and without the words of the libraries underneath."""
    refused: Any = error.__cause__  # pydantic's, where a value is not of its type
    for first in refused.errors() if hasattr(refused, "errors") else ():
        if wanted := _WANTED.get(first["type"]):
            given = getattr(error, "param", None)
            flag = next(iter(getattr(given, "opts", [])), "")
            unit = re.search(r"\[([^]]+)\]\.?$", getattr(given, "help", "") or "")
            return in_unit(f"{flag}: '{first['input']}' is not {wanted}", unit[1] if unit else "")
    text = re.sub(_IDLE, "", one_line(error.format_message()).replace(": Value error, ", ": "))
    where = getattr(error, "ctx", None)
    if text.startswith("Missing ") and where is not None:
        text = f"{text.rstrip('.')}; {where.command_path} --help has an example"
    return re.sub(_NO_PARTS, r"\1: this command has no parts that could run on a cluster; leave it out", text)

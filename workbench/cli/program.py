"""The program's commands, each imported and built when it is first needed.

Importing all of them, and reading their options, takes several times as long as one, and longer than a small analysis.
"""

from __future__ import annotations

import inspect
import os
import re
from typing import Any

import click

from workbench import __version__
from workbench.cli.plain import unquoted, write_text
from workbench.commands import COMMANDS, GROUPS, REQUESTS, requests_of
from workbench.core.records.named import named
from workbench.core.records.option import options_of as declared_options
from workbench.core.records.plug_ins import plug_ins
from workbench.errors import close_names, one_line
from workbench.requests.request import Request

__all__ = ["BEGINNING", "COMMANDS", "command_of", "completing", "options_of", "program", "said"]

_OWN = {"run": "cli.run:run", "schema": "cli.schema:schema", "ui": "cli.ui:ui"}  # no requests

# Of plug-ins that are not commands: what the name is, and the table that has it.
_OTHERS = {
    "blocks": ("Block of system files.", "system.block_table.registry:BLOCKS"),
    "requirements": ("Kind of requirement in studies.", "study.requirements:KINDS"),
    "readers": ("Files of recorded data.", "data.experiment.formats:READERS"),
}
_NUMBERS = {"integer": "a whole number", "float": "a number"}  # click's word → ours
_NO_PARTS = r"No such option '?(--scheduler[\w-]*).*"
_COMPLETE = "_WORKBENCH_COMPLETE"  # set by the scripts for shells

# Of every command: a sentence to read may be wider than click's 80 characters.
SETTINGS = {"help_option_names": ["-h", "--help"], "max_content_width": 120, "show_default": True}


class _Program(click.Group):
    """All commands, each with its first sentence in full."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return their names, in the order of the help."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return one of them, built now."""
        return command_of(cmd_name) if cmd_name in COMMANDS else None

    def format_help_text(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write what the program is for."""
        write_text(self.help or "", formatter)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the commands in their groups."""
        for group, names in GROUPS.items():
            with formatter.section(group):
                formatter.write_dl([(name, unquoted(_first_words(name))) for name in names])
        if added := _added():
            with formatter.section("From other packages"):
                formatter.write_dl(added)


def _added() -> list[tuple[str, str]]:
    """Return what plug-ins can be used, in words, and whose."""
    found = [(p, unquoted(_first_words(p.name))) for p in REQUESTS.added()]
    others = dict.fromkeys(p.kind for p in plug_ins() if p.kind in _OTHERS)  # without any, no table is imported
    usable = {p for kind in others for p in named(f"workbench.{_OTHERS[kind][1]}").added()}
    found += [(p, _OTHERS[p.kind][0]) for p in plug_ins() if p in usable]
    return [(p.name, f"{words} ({p.package})") for p, words in found]


def _first_words(name: str) -> str:
    """Return the first paragraph of what a command does."""
    text = named(f"workbench.{_OWN[name]}").help if name in _OWN else requests_of(name)[0].__doc__
    return inspect.cleandoc(text or "").split("\n\n")[0]


def program(name: str | None, own: type[Request[Any, Any]] | None = None) -> click.Command:
    """Return a command alone, which is quick; if there is none of that name, the program with the help of all of them.

    Args:
        name: of the command.
        own: request of a command that is not one of the package's; None: it is.
    """
    if name is not None and (own is not None or (name in COMMANDS and not completing())):
        return command_of(name, own)
    return _Program("workbench", help=_HELP, params=[_VERSION], context_settings=SETTINGS)


def completing() -> list[str]:
    """Return the words of a command line that a shell asks to complete; none: the program was called as usual."""
    if _COMPLETE not in os.environ:
        return []
    return (os.environ.get("COMP_WORDS") or "workbench").split()


def command_of(name: str, own: type[Request[Any, Any]] | None = None) -> click.Command:
    """Return a command.

    Args:
        name: of the command.
        own: see `program`.
    """
    if own is None and name in _OWN:
        result: click.Command = named(f"workbench.{_OWN[name]}")
    else:
        from workbench.cli.derive import command
        from workbench.cli.questions import before

        result = command(requests_of(name) if own is None else [own], before(name))
        if own is None and (package := REQUESTS.package_of(next(iter(COMMANDS[name])))):
            result.help = f"{result.help}\n\nFrom the package {package}."
    result.name, result.context_settings = name, SETTINGS
    return result


def _show_version(context: click.Context, parameter: click.Parameter, wanted: bool) -> None:  # noqa: FBT001, ARG001 - click calls it so
    if wanted:
        click.echo(f"workbench {__version__}")
        context.exit()


# What `workbench` says that is given nothing.
BEGINNING = f"""\
FMI workbench {__version__}: see how an FMU behaves.

Begin with your file, or with fmu:Rudder, a bundled one:
  workbench info actuator.fmu    what it is, who made it, its inputs and outputs
  workbench check actuator.fmu   does it do what it declares?
  workbench nfr actuator.fmu --input U --output Y --band 0.1:10 --amplitude 1

workbench --help lists all commands; workbench nfr --help has an example and
the options of one; workbench ui opens the browser.
"""

_VERSION = click.Option(
    ["--version"], is_flag=True, callback=_show_version, is_eager=True, expose_value=False,
    help="Show the version and stop.",
)  # fmt: skip

_HELP = """
    Analyse FMUs: time histories, operating points, linear models, frequency responses, identification; build FMUs.

    MODEL is an `.fmu`, an unpacked FMU folder, or a bundled one: `fmu:Rudder` (FMI 2.0), `fmu:Rudder@3` (FMI 3.0).

    Example: `workbench nfr fmu:Rudder --input delC --output del --band 0.5:20 --amplitude 1,4 --plot bode.png`
    """


def options_of(command: click.Command) -> dict[str, str]:
    """Return what the options of a command are called: name in Python → on the command line.

    Args:
        command: as `program` returns it.
    """
    return {str(p.name): p.opts[0] for p in command.params if p.opts[0].startswith("--")}


def said(error: click.ClickException) -> str:
    """Return what is wrong with a command line, in one line.

    Args:
        error: click's.
    """
    text = one_line(error.format_message())
    text = re.sub(r"^Invalid value for '(--[\w-]+)'", r"\1", text)
    text = re.sub(r"a valid (integer|float)( range)?\.", lambda kind: _NUMBERS[kind[1]], text)
    where = getattr(error, "ctx", None)
    if isinstance(error, click.NoSuchOption) and where is not None:
        text = _no_such(error.option_name, where)
    if isinstance(error, click.MissingParameter) and where is not None:
        meant = str(getattr(error.param, "help", None)).split(". ")[0].rstrip(".")
        text = f"{text.rstrip('.')} ({meant}); {where.command_path} --help has an example"
    return re.sub(_NO_PARTS, r"\1: this command has no parts that could run on a cluster; leave it out", text)


def _no_such(flag: str, where: click.Context) -> str:
    """Return what is said of an option that a command has not: near ones, or where it is."""
    name = flag.lstrip("-").replace("-", "_")
    command = where.command.name or ""
    for request in requests_of(command) if command in COMMANDS else ():
        if any(d.name == name and d.option.python for d in declared_options(request)):
            called = request.called or request.command.replace("-", "_")
            return f"No such option '{flag}'; only Python has it: wb.{called}(…, {name}=…)"
    known = (flag for p in where.command.params for flag in p.opts if flag.startswith("--"))
    near = close_names(flag.lstrip("-"), (flag.lstrip("-") for flag in known))
    words = f"did you mean {', '.join(f'--{one}' for one in near)}? " if near else ""
    return f"No such option '{flag}'; {words}{where.command_path} --help-all lists all"

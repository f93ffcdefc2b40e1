"""A page for each command, generated from what `--help` shows."""

from __future__ import annotations

import re
from collections.abc import Iterator
from html import escape

import click

from workbench.cli.program import COMMANDS, program

__all__ = ["command_names", "command_page"]

_EXTRA = re.compile(r"\s*\[(?:required|default: [^\]]*|[^\]]*;\s*(?:required|default[^\]]*))\]$")


def command_names() -> list[str]:
    """Return the names of all commands, in the order of `workbench --help`."""
    return list(COMMANDS)


def command_page(name: str) -> str:
    """Return the Markdown of a command's page.

    Args:
        name: of the command.
    """
    command = program(name)
    context = click.Context(command, info_name=name)
    usage = " ".join(["workbench", name, *command.collect_usage_pieces(context)])
    head = [f"# {name}", "", *_help(command.help or ""), "```bash", usage, "```", ""]
    return "\n".join([*head, *_tables(command, context)])


def _help(text: str) -> Iterator[str]:
    """The command's own words; examples as blocks of their own."""
    for paragraph in text.split("\n\n"):
        words = " ".join(paragraph.split())
        if words.startswith(("Example:", "Examples:")):
            yield from ("**Example**" if words.startswith("Example:") else "**Examples**", "")
            for code in re.findall(r"`([^`]+)`", words):
                yield from ("```bash", code, "```", "")
        else:
            yield from (words, "")


def _tables(command: click.Command, context: click.Context) -> Iterator[str]:
    arguments = [p for p in command.params if isinstance(p, click.Argument)]
    options = [p for p in command.params if isinstance(p, click.Option) and not p.hidden]
    for title, parameters in (("Arguments", arguments), ("Options", options)):
        if not parameters:
            continue
        yield from (f"## {title}", "", f"| {title[:-1].lower()} | meaning | default |", "|---|---|---|")
        for parameter in parameters:
            yield _row(parameter, context)
        yield ""


def _row(parameter: click.Parameter, context: click.Context) -> str:
    names, meaning = parameter.get_help_record(context) or ("", "")
    if isinstance(parameter, click.Argument):
        names = parameter.make_metavar(context)
    default = "required" if parameter.required else _default(parameter, context)
    # In a table a bar ends the cell, even between backticks.
    name = f"<code>{escape(names).replace('|', '&#124;')}</code>"
    return f"| {name} | {_cell(_EXTRA.sub('', meaning))} | {default} |"


def _default(parameter: click.Parameter, context: click.Context) -> str:
    value = parameter.get_default(context)
    if value is False or not isinstance(value, str | int | float):
        return ""
    if value is True and parameter.secondary_opts:
        return f"`{parameter.opts[0]}`"
    return f"`{value}`"


def _cell(text: str) -> str:
    return text.replace("|", r"\|").replace("\n", " ")

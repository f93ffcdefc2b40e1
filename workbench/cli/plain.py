"""Commands of click whose help begins with the options that matter most, and whose lines to copy stay one line."""

from __future__ import annotations

import inspect
from textwrap import wrap
from typing import Any

import click

__all__ = ["GroupedOption", "PlainCommand", "unquoted", "write_text"]


_MANY = 14  # options; a command with more describes the first of them, and names the rest
_IN_FULL = "workbench.help_all"  # in the context's `meta`: all options are described


class GroupedOption(click.Option):
    """An option under a heading of its own, None where it is not given; else as `click.Option`."""

    def __init__(
        self,
        declarations: list[str],
        *,
        group: str = "",
        first: bool = False,
        **rest: Any,  # noqa: ANN401 - click's own
    ) -> None:
        super().__init__(declarations, **rest)
        self.group = group
        self.first = first or self.required

    def process_value(self, ctx: click.Context, value: Any) -> Any:  # noqa: ANN401 - click's own
        """Return what was given; several texts as a list."""
        result = super().process_value(ctx, value)
        flags = {flag for parameter in ctx.command.params for flag in parameter.opts}
        for text in result if isinstance(result, tuple) else (result,):
            if text in flags:
                raise click.UsageError(f"{self.opts[0]} needs a value, but {text} follows", ctx)
        return (list(result) or None) if isinstance(result, tuple) else result


def _help_all(context: click.Context, parameter: click.Parameter, wanted: bool) -> None:  # noqa: FBT001, ARG001 - click calls it so
    if wanted:
        context.meta[_IN_FULL] = True
        click.echo(context.get_help())
        context.exit()


_HELP_ALL = click.Option(
    ["--help-all"], is_flag=True, callback=_help_all, is_eager=True, expose_value=False,
    help="Show all options, in their groups, and exit.",
)  # fmt: skip


class PlainCommand(click.Command):
    """A command whose options have the headings of the parts that declare them; of many, the first are described."""

    def get_params(self, ctx: click.Context) -> list[click.Parameter]:
        """Return the parameters, those of help last."""
        return [*super().get_params(ctx), _HELP_ALL]

    def format_help_text(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write what the command does."""
        write_text(self.help or "", formatter)

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options under their headings; of many, the first ones, and the names of the rest."""
        options = [p for p in self.get_params(ctx) if isinstance(p, click.Option) and not p.hidden]
        own = [p for p in options if isinstance(p, GroupedOption)]
        shortened = len(own) > _MANY and not ctx.meta.get(_IN_FULL)
        rest = [p for p in own if shortened and not p.first]
        rows: dict[str, list[tuple[str, str]]] = {}
        for one in options:
            record = one.get_help_record(ctx)
            if one not in rest and record is not None and (shortened or one is not _HELP_ALL):
                group = "" if shortened else getattr(one, "group", "")
                rows.setdefault(group or "Options", []).append((record[0], unquoted(record[1])))
        for heading, records in rows.items():
            with formatter.section(heading):
                formatter.write_dl(records)
        if rest:
            indent = "  "
            with formatter.section("More options, described by --help-all"):
                names = wrap(", ".join(p.opts[0] for p in rest), formatter.width - len(indent), break_on_hyphens=False)
                formatter.write("".join(f"{indent}{line}\n" for line in names))


def write_text(text: str, formatter: click.HelpFormatter) -> None:
    """Write paragraphs; an example stays one line, to be copied.

    Args:
        text: as a docstring has it.
        formatter: where it is written.
    """
    for paragraph in inspect.cleandoc(text).split("\n\n"):
        formatter.write_paragraph()
        with formatter.indentation():
            if paragraph.startswith("Example"):
                formatter.write(f"  {unquoted(paragraph)}\n")
            else:
                formatter.write_text(unquoted(paragraph))


def unquoted(text: str) -> str:
    """Return a text without the marks of code, which a page of the docs shows and a terminal does not.

    Args:
        text: Markdown.
    """
    return text.replace("`", "")

"""Commands of click whose help has headings, and whose lines to copy stay one line."""

from __future__ import annotations

import inspect
from typing import Any

import click

__all__ = ["GroupedOption", "PlainCommand", "unquoted", "write_text"]


class GroupedOption(click.Option):
    """An option under a heading of its own, None where it is not given; else as `click.Option`."""

    def __init__(self, declarations: list[str], *, group: str = "", **rest: Any) -> None:  # noqa: ANN401 - click's own
        super().__init__(declarations, **rest)
        self.group = group

    def process_value(self, ctx: click.Context, value: Any) -> Any:  # noqa: ANN401 - click's own
        """Return what was given; several texts as a list."""
        result = super().process_value(ctx, value)
        flags = {flag for parameter in ctx.command.params for flag in parameter.opts}
        for text in result if isinstance(result, tuple) else (result,):
            if text in flags:
                raise click.UsageError(f"{self.opts[0]} needs a value, but {text} follows", ctx)
        return (list(result) or None) if isinstance(result, tuple) else result


class PlainCommand(click.Command):
    """A command whose options have the headings of the parts that declare them."""

    def format_help_text(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write what the command does."""
        write_text(self.help or "", formatter)

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options under their headings."""
        rows: dict[str, list[tuple[str, str]]] = {}
        for one in self.get_params(ctx):
            record = one.get_help_record(ctx)
            if record is not None and isinstance(one, click.Option):
                rows.setdefault(getattr(one, "group", "") or "Options", []).append((record[0], unquoted(record[1])))
        for heading, records in rows.items():
            with formatter.section(heading):
                formatter.write_dl(records)


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

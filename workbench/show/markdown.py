"""A page as Markdown, for the summary that GitHub shows of a job."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from html import escape

from workbench.errors import unbroken
from workbench.show.page import Page, PageTable, Section
from workbench.show.verdicts import tone, worst_first

__all__ = ["markdown_of"]

_SIGNS = {"good": "✅", "watch": "⚠️", "poor": "❌"}
_MOST_ROWS = 60  # of a table, as in a terminal; a summary has a limit of its own, 1 MiB
_SPECIAL = re.compile(r"[\\`*_\[\]<>|~&$@#]")  # names come from files that somebody else wrote


def markdown_of(page: Page) -> str:
    """Return what a page says: verdicts first, the tables folded, without its pictures and how it was made.

    Args:
        page: what a result says of itself.
    """
    return "\n".join(_page(page)) + "\n"


def _page(page: Page) -> Iterator[str]:
    yield from (f"## {_text(page.title)}", "", _text(page.lead), "")
    yield from (f"- {_SIGNS.get(tone(v.word), '')} {_text(v.word)}: {_text(v.text)}" for v in worst_first(page.summary))
    yield ""
    for section in page.sections:
        if section.tables and not section.explains:
            yield from _section(section)


def _section(section: Section) -> Iterator[str]:
    yield from (f"<details><summary>{escape(unbroken(section.title))}</summary>", "")  # HTML, where no Markdown is read
    for table in section.tables:
        yield from _table(table)
    yield from (*(f"- {_text(item)}" for item in section.items), "</details>", "")


def _table(table: PageTable) -> Iterator[str]:
    yield _row([_text(heading) for heading in table.headings])
    yield _row(["--:" if k in table.at_right else "---" for k in range(len(table.headings))])
    yield from (_row([_text(cell) for cell in row]) for row in table.rows[:_MOST_ROWS])
    yield ""
    if len(table.rows) > _MOST_ROWS:
        yield from (f"{len(table.rows) - _MOST_ROWS} more rows are in the report.", "")


def _row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _text(text: str) -> str:
    return _SPECIAL.sub(r"\\\g<0>", unbroken(text))

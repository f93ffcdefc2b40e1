"""A page as text: for a terminal, whose width it keeps, and for a pipe, where no row is broken."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise, zip_longest

from workbench.errors import shortened, unbroken
from workbench.show.page import Page, PageTable, Section
from workbench.show.verdicts import worst_first

__all__ = ["section_text", "text_of"]

_GAP = "  "
_MOST_WORDS = 60  # of a column in a pipe: sentences go on below
_LEAST_WORDS = 30  # a column of sentences is made no narrower
_MOST_IN_CELL = 1000  # [characters]
_MOST_ROWS = 60  # of a table; more belong into a file


def text_of(page: Page, width: int | None, how: str = "") -> str:
    """Return what a page says, without its pictures and without how it was made.

    Args:
        page: what a result says of itself.
        width: of the terminal [characters]; None: lines may be as long as they are, as in a pipe.
        how: it was made, behind the title.
    """
    lines = [line.rstrip() for line in _page(page, width, how)]
    return "\n".join(line for before, line in pairwise(["", *lines, ""]) if before or line) + "\n"


def section_text(section: Section, width: int | None) -> str:
    """Return what a section says.

    Args:
        section: of a page.
        width: see `text_of`.
    """
    return "\n".join(_section(section, width)) + "\n"


def _page(page: Page, width: int | None, how: str) -> Iterator[str]:
    yield unbroken(f"{page.title} ({how})" if how else page.title)
    verdicts = [f"{verdict.word}: {verdict.text}" for verdict in worst_first(page.summary)]
    facts = [f"{name}: {value}" for name, value in page.facts.items()]
    for text in (*filter(None, [page.lead]), *facts, *verdicts):
        yield from _folded(text, width)
    for section in page.sections:
        if not section.explains:
            yield from _section(section, width)
    left_out = ", ".join(section.title for section in page.sections if section.explains)
    if page.shown_by and left_out:
        yield ""
        yield from _folded(f"{page.shown_by} also shows: {left_out}", width)


def _section(section: Section, width: int | None) -> Iterator[str]:
    lines = [
        *section.paragraphs,
        *(f"{v.word}: {v.text}" for v in section.verdicts),
        *(f"- {item}" for item in section.items),
    ]
    if lines or section.tables:
        yield ""
        yield unbroken(section.title)
    for line in lines:
        yield from _folded(line, width)
    for table in section.tables:
        yield from _table(table, width)
    for part in section.parts:
        if not part.explains:
            yield from _section(part, width)


def _folded(text: str, width: int | None) -> list[str]:
    """Break a text between words only; breaks of its own are spelt out, so that no name feigns a line."""
    text = unbroken(text)
    if width is None or len(text) <= width:
        return [text]
    return textwrap.wrap(text, width, subsequent_indent=_GAP, break_long_words=False, break_on_hyphens=False)


def _table(table: PageTable, width: int | None) -> Iterator[str]:
    if not table.rows:
        return
    if table.title:
        yield from _folded(table.title, None)
    if table.bars:
        barred = [(*row, bar) for row, bar in zip(table.rows, table.bars, strict=True)]
        table = replace(table, headings=(*table.headings, ""), rows=barred, right=sorted(table.at_right), bars=())
    headings = [_cell(text) for text in table.headings]
    rows = [[_cell(text) for text in row] for row in table.rows[: table.most or _MOST_ROWS]]
    sizes = _sizes(table, [headings, *rows], width)
    for columns in _blocks(sizes, width):
        yield from _row(headings, columns, sizes, table.at_right)
        yield _GAP.join("─" * sizes[k] for k in columns)
        for row in rows:
            yield from _row(row, columns, sizes, table.at_right)
        yield ""
    if len(table.rows) > len(rows):
        yield f"{len(table.rows) - len(rows)} more rows: the JSON has all"


def _cell(text: str) -> str:
    return shortened(unbroken(text), line=_MOST_IN_CELL)


def _sizes(table: PageTable, rows: Sequence[Sequence[str]], width: int | None) -> list[int]:
    """Return the width of each column; the widest one of words gives way where that fits the table into the line.

    Only sentences are wide enough for that, which are broken between words.
    """
    sizes = [max(len(r[k]) for r in rows) for k in range(len(table.headings))]
    words = [k for k in range(len(sizes)) if k not in table.at_right]
    if width is None:
        return [min(size, _MOST_WORDS) if k in words else size for k, size in enumerate(sizes)]
    if not words:
        return sizes
    widest = max(words, key=sizes.__getitem__)
    room = width - sum(sizes) - len(_GAP) * (len(sizes) - 1) + sizes[widest]
    if _LEAST_WORDS <= room < sizes[widest]:
        sizes[widest] = room
    return sizes


def _blocks(sizes: Sequence[int], width: int | None) -> Iterator[list[int]]:
    """Yield the columns that stand side by side; the first one, which names the rows, stands in every block."""
    block, used = [0], sizes[0]
    for k in range(1, len(sizes)):
        if width is not None and len(block) > 1 and used + len(_GAP) + sizes[k] > width:
            yield block
            block, used = [0], sizes[0]
        block.append(k)
        used += len(_GAP) + sizes[k]
    yield block


def _row(cells: Sequence[str], columns: Sequence[int], sizes: Sequence[int], right: frozenset[int]) -> Iterator[str]:
    parts = [_folded(cells[k], sizes[k]) for k in columns]
    for line in zip_longest(*parts, fillvalue=""):
        yield _GAP.join(
            text.rjust(sizes[k]) if k in right else text.ljust(sizes[k]) for k, text in zip(columns, line, strict=True)
        )

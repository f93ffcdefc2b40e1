"""A page as text: for a terminal, whose width it keeps, and for a pipe, where no row is broken."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

from workbench.report.page import Page, Section, Table
from workbench.report.tones import worst_first

__all__ = ["text_of"]

_GAP = "  "
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


def _page(page: Page, width: int | None, how: str) -> Iterator[str]:
    yield f"{page.title} ({how})" if how else page.title
    if page.lead:
        yield page.lead
    for name, value in page.facts.items():
        yield f"{name}: {value}"
    for verdict in worst_first(page.summary):
        yield f"{verdict.word}: {verdict.text}"
    for section in page.sections:
        yield from _section(section, width)


def _section(section: Section, width: int | None) -> Iterator[str]:
    lines = [
        *section.paragraphs,
        *(f"{v.word}: {v.text}" for v in section.verdicts),
        *(f"- {item}" for item in section.items),
    ]
    if lines or section.tables:
        yield ""
        yield section.title
    yield from lines
    for table in section.tables:
        yield from _table(table, width)
    for part in section.parts:
        yield from _section(part, width)


def _table(table: Table, width: int | None) -> Iterator[str]:
    if not table.rows:
        return
    if table.title:
        yield table.title
    rows = table.rows[:_MOST_ROWS]
    sizes = [max(len(r[k]) for r in (table.headings, *rows)) for k in range(len(table.headings))]
    for columns in _blocks(sizes, width):
        yield _row(table.headings, columns, sizes, table.at_right)
        yield _GAP.join("─" * sizes[k] for k in columns)
        yield from (_row(row, columns, sizes, table.at_right) for row in rows)
        yield ""
    if len(table.rows) > len(rows):
        yield f"{len(table.rows) - len(rows)} more rows: --csv writes all"


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


def _row(cells: Sequence[str], columns: Sequence[int], sizes: Sequence[int], right: frozenset[int]) -> str:
    return _GAP.join(cells[k].rjust(sizes[k]) if k in right else cells[k].ljust(sizes[k]) for k in columns)

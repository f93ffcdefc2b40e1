"""What a page says, ready for JSON: verdicts with their tones, tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from workbench.show.page import PageTable
from workbench.show.result import page_of
from workbench.show.verdicts import Verdict, tone, worst_first

__all__ = ["headline_of", "tables_told", "verdicts_told"]


def headline_of(record: object) -> dict[str, Any]:
    """Return what the page of a record says first: its `lead`, its `verdicts`, and its `notes`.

    Args:
        record: that has a page; what an early end has left may be too incomplete for one.
    """
    try:
        page = page_of(record)
    except Exception as error:  # noqa: BLE001 - the record is shown without it
        words = f"this result has no headline: {type(error).__name__}: {error}"
        return {"lead": "", "verdicts": verdicts_told([Verdict("unknown", words)]), "notes": []}
    return {"lead": page.lead, "verdicts": verdicts_told(page.summary), "notes": list(map(str, page.notes))}


def verdicts_told(verdicts: Sequence[Verdict]) -> list[dict[str, str]]:
    """Return verdicts by `word`, `tone` ("good", "watch", "poor" or "") and `text`, the violated first."""
    return [{"word": v.word, "tone": tone(v.word), "text": v.text} for v in worst_first(verdicts)]


def tables_told(tables: Sequence[PageTable]) -> list[dict[str, Any]]:
    """Return tables by `title`, `headings` and `rows`."""
    return [{"title": t.title, "headings": list(t.headings), "rows": [list(row) for row in t.rows]} for t in tables]

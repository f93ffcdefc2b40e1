"""What a page says, ready for JSON: verdicts with their tones, tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from workbench.show.page import PageTable
from workbench.show.verdicts import Verdict, tone, worst_first

__all__ = ["tables_told", "verdicts_told"]


def verdicts_told(verdicts: Sequence[Verdict]) -> list[dict[str, str]]:
    """Return verdicts by `word`, `tone` ("good", "watch", "poor" or "") and `text`, the violated first."""
    return [{"word": v.word, "tone": tone(v.word), "text": v.text} for v in worst_first(verdicts)]


def tables_told(tables: Sequence[PageTable]) -> list[dict[str, Any]]:
    """Return tables by `title`, `headings` and `rows`."""
    return [{"title": t.title, "headings": list(t.headings), "rows": [list(row) for row in t.rows]} for t in tables]

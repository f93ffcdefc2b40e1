"""What a page says, ready for JSON: verdicts with their tones, sections with their tables and pictures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from workbench.show.page import PageTable, Section
from workbench.show.result import page_of
from workbench.show.svg import svg_of
from workbench.show.verdicts import Verdict, tone, worst_first
from workbench.ui.marks import brief_of
from workbench.ui.modes import modes_of
from workbench.ui.panels import panels_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["headline_of", "sections_told", "tables_told", "verdicts_told"]


def headline_of(record: object) -> dict[str, Any]:
    """Return what the page of a record says first: its `lead`, its `verdicts`, its `notes`, its number (`brief`).

    Args:
        record: that has a page; what an early end has left may be too incomplete for one.
    """
    try:
        page = page_of(record)
        brief = brief_of(record)
    except Exception as error:  # noqa: BLE001 - the record is shown without it
        words = f"this result has no headline: {type(error).__name__}: {error}"
        return {"lead": "", "verdicts": verdicts_told([Verdict("unknown", words)]), "notes": [], "brief": ""}
    verdicts, notes = verdicts_told(page.summary), list(map(str, page.notes))
    return {"lead": page.lead, "verdicts": verdicts, "notes": notes, "brief": brief}


def sections_told(record: object) -> dict[str, Any]:
    """Return what a record's page says below its headline, ready for JSON.

    `facts`, `sections` with their pictures as `panels_of` says or as `svg`, `modes`, see `modes_of`, and `wrong`: why
    there is none of these.

    Args:
        record: that has a page; what an early end has left may be too incomplete for one.
    """
    try:
        page = page_of(record)
        facts = [[name, str(value)] for name, value in page.facts.items()]
        return {"facts": facts, "sections": _told(page.sections), "modes": modes_of(record), "wrong": ""}
    except Exception as error:  # noqa: BLE001 - the record's data are there without it
        words = f"this result has no page: {type(error).__name__}: {error}"
        return {"facts": [], "sections": [], "modes": [], "wrong": words}


def _told(sections: Sequence[Section]) -> list[dict[str, Any]]:
    return [
        {
            "title": s.title,
            "paragraphs": list(map(str, s.paragraphs)),
            "items": list(map(str, s.items)),
            "verdicts": [{"word": v.word, "tone": tone(v.word), "text": v.text} for v in s.verdicts],
            "tables": tables_told(s.tables),
            "code": list(s.code),
            "folded": s.folded or s.explains,
            "pictures": [{"words": words, **_picture(draw, words)} for draw, words in s.figures],
            "parts": _told(s.parts),
        }
        for s in sections
    ]


def _picture(draw: Callable[[], Figure], words: str) -> dict[str, Any]:
    figure = draw()
    panels = panels_of(figure) if hasattr(figure, "axes") else None  # some draw text
    return {"panels": panels} if panels else {"svg": svg_of(figure, "f", words)}


def verdicts_told(verdicts: Sequence[Verdict]) -> list[dict[str, str]]:
    """Return verdicts by `word`, `tone` ("good", "watch", "poor" or "") and `text`, the violated first."""
    return [{"word": v.word, "tone": tone(v.word), "text": v.text} for v in worst_first(verdicts)]


def tables_told(tables: Sequence[PageTable]) -> list[dict[str, Any]]:
    """Return tables by `title`, `headings`, `rows`, and `tones` of the column whose word colours its cell."""
    return [
        {
            "title": t.title,
            "headings": list(t.headings),
            "rows": [list(row) for row in t.rows],
            "verdict": t.verdict,
            "tones": [] if t.verdict is None else [tone(row[t.verdict]) for row in t.rows],
        }
        for t in tables
    ]

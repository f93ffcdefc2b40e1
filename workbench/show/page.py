"""A report as one self-contained HTML page: pictures inline, no network; for a phone, in the dark and printed."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from workbench.core.machine.files import replacing
from workbench.core.records.record import plain
from workbench.errors import InputError, shortened, visible
from workbench.show.svg import svg_of
from workbench.show.verdicts import Verdict, counted, tone, worst_first

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["SUFFIXES", "Page", "PageTable", "Section", "write_page"]

SUFFIXES = (".html", ".htm")
_LONG = 5  # a page of so many sections begins with a list of them
_SENTENCE = 28  # longer cells are sentences [characters]
_PHONE, _FEW_ROWS = 44, 6  # characters beside each other on 390 px; rows that are read one by one
_MANY = 3  # so many verdicts are counted

# What stands in a column of numbers: signs, digits, a unit of one sign, or that there is none.
_NUMBER = re.compile(r"^[+\-−±<>≤≥≈]?\s*(\d[\d.,]*(e[+\-−]?\d+)?|∞|inf|nan)?\s*[%°]?$|^[–-]$", re.IGNORECASE)


@dataclass(frozen=True)
class PageTable:
    """Rows under headings.

    Attributes:
        headings: of the columns, with units.
        rows: cells as text.
        verdict: number of the column whose word colours its cell (a word of `verdicts.TONES`: "good", "watch", "poor",
            "passed", "failed", …); None: no colours.
        title: above the table.
        right: numbers of the columns that stand at the right edge; None: those that hold numbers only.
        bars: one for each row, which a terminal draws behind it; other pages have a picture instead.
        most: rows that a terminal shows; None: as many as of any table.
    """

    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    verdict: int | None = None
    title: str = ""
    right: Sequence[int] | None = None
    bars: Sequence[str] = ()
    most: int | None = None

    @property
    def at_right(self) -> frozenset[int]:
        """Numbers of the columns that stand at the right edge."""
        if self.right is not None:
            return frozenset(self.right)
        return frozenset(i for i in range(len(self.headings)) if self._holds_numbers(i))

    @property
    def folds(self) -> bool:
        """Whether each row becomes a card on a phone: a column holds sentences, or few rows are wider than it is."""
        if len(self.headings) <= 2:
            return False
        words = [k for k in range(len(self.headings)) if k not in self.at_right]
        if any(len(r[k]) > _SENTENCE for r in self.rows for k in words if k < len(r)):
            return True
        longest = [max(map(len, heading.split() or [""])) for heading in self.headings]
        for row in self.rows:
            longest = [max(n, len(cell)) for n, cell in zip(longest, row, strict=False)]
        return len(self.rows) <= _FEW_ROWS and sum(longest) + 2 * len(longest) > _PHONE

    def _holds_numbers(self, column: int) -> bool:
        cells = [row[column] for row in self.rows if column < len(row)]
        return any(cells) and all(_is_number(cell) for cell in cells)


def _is_number(cell: str) -> bool:
    return bool(_NUMBER.match(cell.strip()))


@dataclass(frozen=True)
class Section:
    """One part of a page.

    Attributes:
        title: its heading.
        paragraphs: text, one paragraph each.
        items: lines of a list.
        tables: below the text.
        figures: (what draws the picture, what it shows); drawn when the page is written as HTML.
        verdicts: lines with coloured words, below the paragraphs, in the order given.
        code: command lines or code, one block each, below the text.
        parts: sections inside this one.
        folded: shown by its heading alone until it is opened; always open in print.
        explains: whether it is background, an explanation or a list that the files have: a terminal leaves it out.
    """

    title: str
    paragraphs: Sequence[str] = ()
    items: Sequence[str] = ()
    tables: Sequence[PageTable] = ()
    figures: Sequence[tuple[Callable[[], Figure], str]] = ()
    verdicts: Sequence[Verdict] = ()
    code: Sequence[str] = ()
    parts: Sequence[Section] = ()
    folded: bool = False
    explains: bool = False


@dataclass(frozen=True)
class Page:
    """A report.

    Attributes:
        title: of the page.
        lead: what was found, in a sentence or two.
        facts: name → value: model, versions, settings; "command" and "call" are shown as code.
        sections: in order.
        data: the result in full, embedded as JSON; what JSON has no number for becomes null.
        summary: verdicts at the top; the violated come first, whatever their order here.
        notes: warnings and remarks, below the lead.
        kind: what kind of page it is, above the title: the command's name.
        verdicts: all of them, where the summary puts several into one line; the metadata beside the page has them.
        signed: who agreed when, by role; for the metadata, too.
        shown_by: option with which a terminal shows the sections that it leaves out; empty: there is none.
    """

    title: str
    lead: str
    facts: Mapping[str, str]
    sections: Sequence[Section]
    data: Mapping[str, Any] = field(default_factory=dict)
    summary: Sequence[Verdict] = ()
    notes: Sequence[str] = ()
    kind: str = ""
    verdicts: Sequence[Verdict] = ()
    signed: Mapping[str, str] = field(default_factory=dict)
    shown_by: str = ""


def write_page(page: Page, path: str | Path) -> None:
    """Write a page.

    Args:
        page: what it says.
        path: of the file, .html.

    Raises:
        InputError: another suffix, or the file cannot be written.
    """
    target = Path(path)
    if target.suffix.lower() not in SUFFIXES:
        raise InputError(f"{target}: a report is a page; name it {SUFFIXES[0]}")
    text = _render(page, target.stem)
    with replacing(target) as part:
        part.write_text(visible(text), encoding="utf-8")


def _render(page: Page, name: str) -> str:
    import jinja2  # noqa: PLC0415  only reports need it

    loader = jinja2.PackageLoader("workbench.show", "templates")
    environment = jinja2.Environment(
        loader=loader, autoescape=True, trim_blocks=True, lstrip_blocks=True, finalize=_shown
    )
    environment.filters["tone"] = tone
    return environment.get_template("page.html").render(
        page=page,
        name=name,
        sections=[_filled(section, f"s{i}") for i, section in enumerate(page.sections, start=1)],
        summary=worst_first(page.summary),
        count=counted(page.verdicts or page.summary) if len(page.summary) >= _MANY else "",
        contents=len(page.sections) >= _LONG,
        data=_embedded(page.data),
    )


def _shown(value: Any) -> Any:  # noqa: ANN401 - whatever a template shows; pictures and data are marked as safe
    return shortened(value) if type(value) is str else value


def _filled(section: Section, name: str) -> dict[str, Any]:
    """Return a section and those inside it with names, and with pictures as text."""
    figures = [(svg_of(draw(), f"{name}f{k}", words), words) for k, (draw, words) in enumerate(section.figures)]
    parts = [_filled(part, f"{name}p{k}") for k, part in enumerate(section.parts)]
    return {"section": section, "name": name, "figures": figures, "parts": parts}


def _embedded(data: Mapping[str, Any]) -> str:
    text = json.dumps(plain(data), ensure_ascii=False, allow_nan=False)
    # Neither "</script>" nor "<!--" may stand in the script element that holds the data.
    return text.replace("<", "\\u003c")

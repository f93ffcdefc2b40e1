"""A report as one self-contained HTML page: pictures inline, no network; for a phone, in the dark and printed."""

from __future__ import annotations

import io
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from workbench.errors import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Page", "Section", "Table", "write_page"]

_SUFFIXES = (".html", ".htm")


@dataclass(frozen=True)
class Table:
    """Rows under headings.

    Attributes:
        headings: of the columns, with units.
        rows: cells as text.
        verdict: number of the column whose word colours the row ("good", "watch", "poor", …); None: no colours.
    """

    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    verdict: int | None = None


@dataclass(frozen=True)
class Section:
    """One part of a page.

    Attributes:
        title: its heading.
        paragraphs: text, one paragraph each.
        items: lines of a list.
        tables: below the text.
        figures: (picture, what it shows).
    """

    title: str
    paragraphs: Sequence[str] = ()
    items: Sequence[str] = ()
    tables: Sequence[Table] = ()
    figures: Sequence[tuple[Figure, str]] = ()


@dataclass(frozen=True)
class Page:
    """A report.

    Attributes:
        title: of the page.
        lead: what was found, in a sentence or two.
        facts: name → value: model, versions, settings, the command to run it again.
        sections: in order.
        data: the result in full, embedded as JSON.
    """

    title: str
    lead: str
    facts: Mapping[str, str]
    sections: Sequence[Section]
    data: Mapping[str, Any] = field(default_factory=dict)


def write_page(page: Page, path: str | Path) -> None:
    """Write a page.

    Args:
        page: what it says.
        path: of the file, .html.

    Raises:
        InputError: another suffix, or the file cannot be written.
    """
    import jinja2  # noqa: PLC0415  only reports need it

    target = Path(path)
    if target.suffix.lower() not in _SUFFIXES:
        raise InputError(f"{target}: a report is a page; name it .html")
    loader = jinja2.PackageLoader("workbench.report", "templates")
    environment = jinja2.Environment(loader=loader, autoescape=True, trim_blocks=True, lstrip_blocks=True)
    sections = [
        {"section": s, "figures": [(_svg(f, f"s{i}f{k}"), words) for k, (f, words) in enumerate(s.figures)]}
        for i, s in enumerate(page.sections)
    ]
    # "</" would end the script element in which the data stand.
    data = json.dumps(page.data, allow_nan=False).replace("</", "<\\/")
    text = environment.get_template("page.html").render(page=page, sections=sections, data=data)
    try:
        target.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"{target}: cannot be written: {error.strerror or error}") from None


def _svg(figure: Figure, prefix: str) -> str:
    """Return a picture as SVG text; its names begin with `prefix`, so that several pictures fit into one page."""
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None})
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r'\bid="', f'id="{prefix}-', text)
    text = re.sub(r'(href="#|url\(#)', rf"\1{prefix}-", text)
    return re.sub(r'<svg ([^>]*?)width="[^"]*" height="[^"]*"', r"<svg \1", text, count=1) or text

"""Reading a report as a parser does: elements, references, names, the embedded data."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, field
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import workbench as wb
from workbench.show.page import Page, PageTable, Section

VOID = {"meta", "link", "br", "hr", "img", "input"}
# What may fetch something, and the words of style sheets that do.
FETCHING = ("src", "href", "xlink:href", "action", "data", "poster", "srcset")
REMOTE = re.compile(r"https?:|@import|//cdn|url\(\s*['\"]?(?!#)")


@dataclass
class Element:
    tag: str
    attributes: dict[str, str]
    text: str = ""


@dataclass
class PageReader(HTMLParser):
    """Keeps every element with its text; an end without its beginning is an error, as is one left open."""

    elements: list[Element] = field(default_factory=list)
    open: list[Element] = field(default_factory=list)

    def __post_init__(self) -> None:
        super().__init__(convert_charrefs=True)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        element = Element(tag, {name: value or "" for name, value in attrs})
        self.elements.append(element)
        if tag not in VOID:
            self.open.append(element)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append(Element(tag, {name: value or "" for name, value in attrs}))

    def handle_endtag(self, tag: str) -> None:
        begun = self.open.pop()
        assert begun.tag == tag, f"</{tag}> ends <{begun.tag}>"

    def handle_data(self, data: str) -> None:
        for element in self.open:
            element.text += data


def read_page(path: Path) -> PageReader:
    reader = PageReader()
    reader.feed(path.read_text(encoding="utf-8"))
    reader.close()
    assert not reader.open, [e.tag for e in reader.open]
    return reader


def data_of(page: PageReader) -> dict[str, Any]:
    (script,) = [e for e in page.elements if e.attributes.get("id") == "data"]
    assert script.attributes["type"] == "application/json"
    found: dict[str, Any] = json.loads(script.text)
    return found


def facts_of_page(page: PageReader) -> dict[str, str]:
    names = [e.text for e in page.elements if e.tag == "dt"]
    values = [e.text for e in page.elements if e.tag == "dd"]
    assert len(names) == len(values)
    return dict(zip(names, values, strict=True))


def check_page_file(path: Path) -> PageReader:
    """Assert what holds for every page: well-formed, alone, names given once, every reference inside it."""
    page = read_page(path)
    names = [e.attributes["id"] for e in page.elements if "id" in e.attributes]
    assert len(names) == len(set(names))
    for element in page.elements:
        for key in FETCHING:
            value = element.attributes.get(key, "")
            own = value.startswith("data:image/") or (value.startswith("#") and value[1:] in names)
            assert not value or own, (element.tag, key, value)
        assert not REMOTE.search(element.attributes.get("style", "")), element.attributes["style"]
        if element.tag == "style":
            assert not REMOTE.search(element.text)
        for target in re.findall(r"url\(#([^)]+)\)", " ".join(element.attributes.values())):
            assert target in names
    assert len([e for e in page.elements if e.tag == "h1"]) == 1
    assert any(e.attributes.get("name") == "viewport" for e in page.elements)
    return page


def page(**more: Any) -> Page:  # noqa: ANN401
    """Return a small page."""
    sections = [Section("S", tables=[PageTable(("what", "value [Hz]"), [("a", "1.5"), ("b", "–"), ("c", "-2e-3")])])]
    return Page(**{"title": "A & <B>", "lead": "lead", "facts": {}, "sections": sections, **more})


def changed_lag() -> wb.NfrResult:
    """Measure the lag with twice its time constant: what a report tells of a model that is not as its FMU has it."""
    with wb.load("fmu:FirstOrderLag", start_values={"tau": 2.0}) as model:
        return wb.nfr(model, "u", "y", [0.1, 0.2], [1.0], in_process=True)

"""Reports on a phone: no page is wider than its window, no row taller than what it says."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from workbench.show.page import Page, PageTable, Section, write_page

if TYPE_CHECKING:
    from playwright.sync_api import Browser
    from playwright.sync_api import Page as Tab

NUMBERS = [f"{1.2345678 * k:.8g}" for k in range(1, 8)]
WORDS = "piston.pressure, servo valve"  # short enough not to be a sentence
HASH = "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08"


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    heads = ("mode", *(f"value number {k} [rad/s]" for k in range(7)), "states that take part")
    tables = [
        PageTable(heads, [(str(k), *NUMBERS, WORDS) for k in range(12)], title="numbers", right=range(8)),
        PageTable(
            ("question", "verdict", "evidence"), [("noise", "good", "words " * 20)], verdict=1, title="sentences"
        ),
        PageTable(("file", "SHA-256"), [("system:failed_aileron_limited", HASH)], title="hash"),
    ]
    path = tmp_path_factory.mktemp("phone") / "p.html"
    write_page(Page(title="T" * 60, lead="lead", facts={"SHA-256": HASH}, sections=[Section("S", tables=tables)]), path)
    return path


@pytest.fixture
def tab(browser: Browser, written: Path) -> Iterator[Tab]:
    context = browser.new_context(viewport={"width": 390, "height": 844})
    opened = context.new_page()
    opened.goto(written.as_uri())
    yield opened
    context.close()


@pytest.mark.parametrize("width", [320, 390, 1200])
def test_no_page_is_wider_than_its_window(tab: Tab, width: int) -> None:
    tab.set_viewport_size({"width": width, "height": 844})
    assert tab.evaluate("innerWidth") == width
    assert tab.evaluate("document.documentElement.scrollWidth") <= width


def test_rows_of_numbers_are_as_low_as_a_line(tab: Tab) -> None:
    rows = "[...document.querySelector('table').tBodies[0].rows].map(r => r.getBoundingClientRect().height)"
    line = tab.evaluate("parseFloat(getComputedStyle(document.querySelector('td')).lineHeight)")
    assert max(tab.evaluate(rows)) < 2.0 * line


def test_the_first_column_stays_while_the_others_move(tab: Tab) -> None:
    tab.evaluate("document.querySelector('.scroll').scrollLeft = 200")
    first, box = (f"document.querySelector('.scroll{part}').getBoundingClientRect().left" for part in (" td", ""))
    assert tab.evaluate("document.querySelector('.scroll').scrollLeft") == 200
    assert tab.evaluate(first) == pytest.approx(tab.evaluate(box), abs=1.0)

"""Pages of the browser workbench in a real browser, and what tests do on all of them."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from tests.ui_server import Ui

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

__all__ = ["LONG", "expect", "go", "look", "measure", "page", "picture", "run_nfr"]

LONG = 120_000.0  # nothing takes so long that works, however busy the machine is [ms]
# Pictures of the pages go here, for whoever wants to look at them.
PICTURES = os.environ.get("WORKBENCH_SCREENSHOTS")


def expect(what: Any) -> Any:  # noqa: ANN401 - Playwright's
    """Return Playwright's expectation of a page or a part of it, with patience; most tests need no Playwright."""
    from playwright.sync_api import expect as expected

    expected.set_options(timeout=LONG)
    return expected(what)


class Told(list[str]):
    """What went wrong in a page, and what it asked other hosts for."""


@pytest.fixture
def page(browser: Browser, ui: Ui) -> Iterator[Page]:
    context = browser.new_context(viewport={"width": 1200, "height": 900})
    context.set_default_timeout(LONG)
    opened = context.new_page()
    wrong = Told()
    opened.on("pageerror", lambda error: wrong.append(str(error)))
    opened.on("request", lambda r: wrong.append(r.url) if not r.url.startswith((ui.base, "data:", "blob:")) else None)
    opened.goto(ui.address)
    expect(opened.locator("h1")).to_be_visible()
    yield opened
    context.close()
    assert not wrong


def look(page: Page, ui: Ui, where: str) -> None:
    page.goto(f"{ui.base}/#/{where}")
    expect(page.locator("main")).to_have_attribute("data-shown", f"#/{where}")
    expect(page.locator("h1")).to_be_visible()


def go(page: Page, link: str, title: str) -> None:
    """Follow a link; until the other page is there, this one is still shown."""
    page.get_by_role("link", name=link, exact=True).click()
    expect(page.locator("h1")).to_have_text(title)


def picture(page: Page, name: str) -> None:
    if PICTURES:
        page.screenshot(path=Path(PICTURES) / f"{name}.png")


def run_nfr(page: Page) -> None:
    """Run what the form says, to its end; what ran before is shown until then."""
    runs = page.locator("a[data-work]", has_text="nfr")
    before = runs.count()
    page.click("text=Run nfr")
    expect(runs).to_have_count(before + 1)
    expect(runs.first).to_contain_text("done")
    expect(page.locator("strong", has_text=re.compile("^done$"))).to_be_visible()


def measure(page: Page, ui: Ui, model: str = "fmu:Rudder", band: str = "0.5:20", amplitudes: str = "1,4") -> None:
    look(page, ui, f"open/{model}/measure/nfr")
    page.fill("#field-amplitudes", amplitudes)
    page.fill("#field-band", band)
    run_nfr(page)

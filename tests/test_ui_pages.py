"""Every page of the browser workbench: it can be read, holds what is large, and outlives its tab and its server."""

from __future__ import annotations

import math
import re
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.ui_pages import LONG, expect, look, measure, picture
from tests.ui_server import ROOT, Ui, browser_workbench

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page, Route

pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
pytest.importorskip("starlette", reason="the extra 'ui' is not installed")


@pytest.fixture(scope="module")
def ui(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Ui]:
    folder = tmp_path_factory.mktemp("root")
    rows = (f"{0.1 * k:g},{k % 2},{math.sin(0.1 * k):g}" for k in range(200))
    (folder / "record.csv").write_text("\n".join([f"time [s],u [deg],{'y' * 300} [m/s2]", *rows]))
    with browser_workbench(folder) as server:
        yield server


MANY = 5000
LEFT, RIGHT = 68, 14  # beside the axes of a picture [pixel]


def test_the_nearest_of_many_points_is_found(page: Page, ui: Ui) -> None:
    low, high = 0.1, 1000.0
    frequency = [low * (high / low) ** (k / (MANY - 1)) for k in range(MANY)]
    curve = {
        "label": "many", "kind": "measured", "input_unit": "", "output_unit": "", "frequency_hz": frequency,
        "re": [1.0] * MANY, "im": [0.0] * MANY, "status": ["settled"] * MANY, "settings": {},
    }  # fmt: skip

    def with_a_store(route: Route) -> None:
        answer = route.fetch()
        start = answer.json()
        start["files"].append({"name": "many", "kind": "store"})
        route.fulfill(response=answer, json=start)

    page.route("**/api/start", with_a_store)
    page.route(
        "**/api/store?name=many", lambda route: route.fulfill(json={"name": "many", "curves": [curve], "notes": []})
    )
    page.goto(f"{ui.base}/#/open/many")
    page.reload()
    expect(page.locator("h1")).to_have_text("Store many")
    canvas = page.locator("main canvas").first
    margin = (high / low) ** 0.03
    ends = (low / margin, high * margin)
    for share in (0.1, 0.37, 0.5, 0.93):
        box = canvas.bounding_box()  # narrower beside a point
        assert box is not None
        wide = box["width"] - LEFT - RIGHT
        there = ends[0] * (ends[1] / ends[0]) ** share
        canvas.hover(position={"x": LEFT + share * wide, "y": 120})  # the curve is some way below or above
        expect(page.locator(".readout").first).to_contain_text("many: frequency")
        read = float(page.locator(".readout").first.inner_text().split("frequency ")[1].split(" Hz")[0])
        assert abs(math.log(read / there)) < 1.5 * math.log(ends[1] / ends[0]) / wide  # a pixel and a half
        canvas.click(position={"x": LEFT + share * wide, "y": 125})
        expect(page.locator("[aria-label='The point'] h2")).to_contain_text("Point at")
        asked = float(page.locator("[aria-label='The point'] h2").inner_text().split()[2])
        assert asked == pytest.approx(read, rel=1e-3)


def test_what_is_filled_in_stays(page: Page, ui: Ui) -> None:
    look(page, ui, "open/fmu:Rudder/measure/nfr")
    page.fill("#field-amplitudes", "3,5")
    page.click("#theme")
    expect(page.locator("#field-amplitudes")).to_have_value("3,5")
    look(page, ui, "open/fmu:Rudder/measure/trim")
    look(page, ui, "open/fmu:Rudder/measure/nfr")
    assert page.input_value("#field-amplitudes") == "3,5"
    look(page, ui, "system/new/fmu:Rudder")
    page.click("text=+ gain")
    expect(page.locator("#toml")).to_have_value(re.compile("gain2 = 1.0"))
    page.click("#theme")
    look(page, ui, "compare")
    look(page, ui, "system/new/fmu:Rudder")
    assert "gain2 = 1.0" in page.input_value("#toml")


def test_what_a_model_cannot_have_is_not_offered(page: Page, ui: Ui) -> None:
    choices = page.locator("#command option")
    with (
        zipfile.ZipFile(ROOT / "fmus" / "fmi2" / "Rudder.fmu") as rudder,
        zipfile.ZipFile(ui.folder / "Closed.fmu", "w") as closed,
    ):
        for name in rudder.namelist():
            words = b'causality="input" variability="continuous"', b'causality="parameter" variability="tunable"'
            closed.writestr(name, rudder.read(name).replace(*words) if name.endswith(".xml") else rudder.read(name))
    look(page, ui, "open/Closed.fmu")
    offered = set(page.locator(".intents a code").all_inner_texts())
    assert {"trim", "simulate"} <= offered
    assert not {"nfr", "bla", "excite", "loop", "limit-cycle", "delays", "blocks", "fit"} & offered
    page.click("summary:has-text('this model cannot answer')")
    expect(page.locator("dl", has_text="excite")).to_contain_text("it needs an input, and this model has none")
    look(page, ui, "open/system%3Arudder_loop/measure/loop")
    assert {"loop", "limit-cycle", "nfr"} <= {choice.get_attribute("value") for choice in choices.all()}


def test_what_a_record_doubts_stands_on_the_page(page: Page, ui: Ui) -> None:
    look(page, ui, "open/fmu:AileronDamper/measure/lin")
    page.click("text=Run lin")
    said = page.get_by_label("What was found")
    expect(said.locator("strong.watch").first).to_have_text("doubtful")
    assert "chosen by auto" not in said.inner_text()
    picture(page, "doubtful")


def test_a_refresh_in_the_middle_and_another_tab_see_the_same(browser: Browser, tmp_path: Path) -> None:
    # The server keeps what was asked last: so long a run has a server of its own.
    with browser_workbench(tmp_path) as server, browser.new_context() as context:
        context.set_default_timeout(LONG)
        page = context.new_page()
        page.goto(server.address)
        expect(page.locator("h1")).to_be_visible()
        look(page, server, "open/fmu:Rudder/measure/nfr")
        for name, value in {
            "amplitudes": "0.1,0.5,1,2,4,8",
            "band": "0.02:20",
            "ratio": "1.005",  # so many points that it runs still when both pages have come up
            "method": "settle",
            "errcrit": "1e-6",
        }.items():
            field = page.locator(f"#field-{name}")
            if not field.is_visible():
                page.click("summary:has-text('More')")
            field.select_option(value) if name == "method" else field.fill(value)
        page.click("text=Run nfr")
        expect(page.locator(".legend li").first).to_be_visible()
        page.reload()
        expect(page.get_by_role("button", name="Stop")).to_be_visible()
        other = page.context.new_page()
        other.goto(page.url)
        other.get_by_role("button", name="Stop").click()
        for one in (page, other):
            expect(one.locator("strong", has_text="stopped")).to_be_visible()
            expect(one.locator(".legend li").first).to_contain_text(" deg")
        # The last events of what was stopped may reach one before the other.
        shown = other.locator(".legend li").all_inner_texts()
        for _ in range(200):
            if page.locator(".legend li").all_inner_texts() == shown:
                break
            page.wait_for_timeout(50)
            shown = other.locator(".legend li").all_inner_texts()
        assert page.locator(".legend li").all_inner_texts() == shown
        other.close()
        page.click("text=Go on")  # what was asked came back with the page
        expect(page.locator("strong", has_text="running")).to_be_visible()
        page.get_by_role("button", name="Stop").click()
        expect(page.locator("strong", has_text="stopped")).to_be_visible()


def test_the_end_of_the_server_is_told(browser: Browser, tmp_path: Path) -> None:
    with browser_workbench(tmp_path) as server:
        page = browser.new_page()
        page.goto(server.address)
        expect(page.locator("h1")).to_be_visible()
        server.process.kill()
        page.wait_for_selector("#gone", timeout=LONG)
        assert page.locator("#gone").inner_text().strip()
        page.close()


def test_a_model_of_many_variables_scrolls(page: Page, ui: Ui) -> None:
    with (
        zipfile.ZipFile(ROOT / "fmus" / "fmi2" / "Rudder.fmu") as rudder,
        zipfile.ZipFile(ui.folder / "Many.fmu", "w") as many,
    ):
        for name in rudder.namelist():
            content = rudder.read(name)
            if name == "modelDescription.xml":
                more = "".join(
                    f'<ScalarVariable name="extra[{k}]" valueReference="{1000 + k}" causality="parameter" '
                    f'variability="fixed" initial="exact"><Real start="{k}"/></ScalarVariable>' for k in range(2000)
                )  # fmt: skip
                content = content.replace(b"</ModelVariables>", more.encode() + b"</ModelVariables>")
            many.writestr(name, content)
    look(page, ui, "open/Many.fmu")
    expect(page.locator("h2", has_text="variables")).to_contain_text("20")
    assert page.locator(".window .line").count() < 80
    page.locator(".window").evaluate("e => { e.scrollTop = e.scrollHeight; }")
    expect(page.locator(".window")).to_contain_text("extra[1999]")
    # A field for a variable searches all of them.
    look(page, ui, "open/Many.fmu/measure/modes")
    field = page.locator("#field-vary")
    field.press_sequentially("1999]")
    expect(page.locator(".picker li")).to_have_count(1)
    field.press("ArrowDown")
    field.press("Enter")
    expect(field).to_have_value("extra[1999]=")
    expect(page.locator(".picker li")).to_have_count(0)


# What a screen reader would read as "button", and no more.
UNNAMED = """
    [...document.querySelectorAll('button, a, input, select, textarea')]
        .filter(e => !(e.textContent.trim() || e.getAttribute('aria-label') || (e.labels && e.labels.length)))
        .map(e => e.outerHTML.slice(0, 90))
"""
PAGES = {
    "welcome": "",
    "card": "open/fmu:Rudder",
    "point": "open/fmu:Rudder/point",
    "measure": "open/fmu:Rudder/measure/nfr",
    "diagram": "system/system%3Arudder_loop",
    "tune": "tune/system%3Arudder_loop",
    "compare": "compare",
    "keep": "keep",
    "data": "open/record.csv",
    "study": "open/study%3Arudder_loop",
    "build": "build/system%3Arudder_loop",
    "tuning": "open/system%3Arudder_loop/measure/tune",
    "calibrate": "open/fmu:Rudder/measure/calibrate",
}


AXE = ROOT / "tests" / "js" / "node_modules" / "axe-core" / "axe.min.js"


@pytest.mark.skipif(not AXE.exists(), reason="axe-core is not installed; `scripts/dev.py test` does it where npm is")
@pytest.mark.parametrize("theme", ["light", "dark"])
def test_axe_finds_nothing(page: Page, ui: Ui, theme: str) -> None:
    page.evaluate("theme => localStorage.setItem('theme', theme)", theme)
    page.reload()
    measure(page, ui)
    expect(page.locator(".legend li")).to_have_count(2)
    for where in [None, *PAGES.values()]:
        if where is not None:
            look(page, ui, where)
        page.wait_for_load_state("load")
        page.evaluate(AXE.read_text(encoding="utf-8"))
        found = page.evaluate("async () => (await axe.run()).violations")
        assert not found, (where, [(v["id"], v["impact"], v["nodes"][0]["html"][:200]) for v in found])


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("width", [1200, 800])
def test_every_page_fits_and_can_be_read(page: Page, ui: Ui, theme: str, width: int) -> None:
    page.evaluate("theme => localStorage.setItem('theme', theme)", theme)
    page.set_viewport_size({"width": width, "height": 900})
    page.reload()
    for name, where in PAGES.items():
        look(page, ui, where)
        expect(page.locator("main h1")).not_to_have_text("This cannot be shown")
        page.wait_for_load_state("load")
        wide = page.evaluate("document.documentElement.scrollWidth")
        assert wide <= width, name
        unnamed = page.evaluate(UNNAMED)
        assert unnamed == [], name
        picture(page, f"{name}-{theme}-{width}")

"""The browser workbench in a real browser: what a person does with it, from the card to the study."""

from __future__ import annotations

import json
import math
import os
import re
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.hostile_fmus import build_hostile
from tests.ui_server import Ui, browser_workbench

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page, Route

api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
pytest.importorskip("starlette", reason="the extra 'ui' is not installed")

ROOT = Path(__file__).resolve().parents[1]
LONG = 120_000.0  # nothing takes so long that works, however busy the machine is [ms]
api.expect.set_options(timeout=LONG)
# Pictures of the pages go here, for whoever wants to look at them.
PICTURES = os.environ.get("WORKBENCH_SCREENSHOTS")


@pytest.fixture(scope="module")
def ui(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Ui]:
    with browser_workbench(tmp_path_factory.mktemp("root")) as server:
        yield server


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
    api.expect(opened.locator("h1")).to_be_visible()
    yield opened
    context.close()
    assert not wrong


def look(page: Page, ui: Ui, where: str) -> None:
    page.goto(f"{ui.base}/#/{where}")
    api.expect(page.locator("main")).to_have_attribute("data-shown", f"#/{where}")
    api.expect(page.locator("h1")).to_be_visible()


def go(page: Page, link: str, title: str) -> None:
    """Follow a link; until the other page is there, this one is still shown."""
    page.get_by_role("link", name=link, exact=True).click()
    api.expect(page.locator("h1")).to_have_text(title)


def picture(page: Page, name: str) -> None:
    if PICTURES:
        page.screenshot(path=Path(PICTURES) / f"{name}.png")


def run_nfr(page: Page) -> None:
    """Run what the form says, to its end; what ran before is shown until then."""
    runs = page.locator("a[data-work]", has_text="nfr")
    before = runs.count()
    page.click("text=Run nfr")
    api.expect(runs).to_have_count(before + 1)
    api.expect(runs.first).to_contain_text("done")
    api.expect(page.locator("strong", has_text=re.compile("^done$"))).to_be_visible()


def measure(page: Page, ui: Ui, model: str = "fmu:Rudder", band: str = "0.5:20", amplitudes: str = "1,4") -> None:
    look(page, ui, f"open/{model}/measure/nfr")
    page.fill("#field-amplitudes", amplitudes)
    page.fill("#field-band", band)
    run_nfr(page)


def test_the_token_leaves_the_address(page: Page, ui: Ui) -> None:
    api.expect(page).to_have_url(f"{ui.base}/")
    assert "token" not in page.evaluate("location.href + document.referrer")
    page.reload()
    api.expect(page.locator("h1")).to_be_visible()


def test_a_card_says_what_a_model_is_and_whether_it_is_sound(page: Page, ui: Ui) -> None:
    page.click("a[data-name='Rudder.fmu']")
    api.expect(page.locator("h1")).to_have_text("Rudder")
    api.expect(page.locator("text=The whole check")).to_be_visible()
    page.fill("[aria-label='Search variables']", "supply")
    api.expect(page.locator(".window .line")).to_have_count(1)
    api.expect(page.locator(".window .line")).to_contain_text("pS")
    assert page.locator(".window .line").inner_text().split()[:4] == ["pS", "input", "2.06e7", "Pa"]


def test_an_operating_point_follows_its_inputs_and_is_kept(page: Page, ui: Ui) -> None:
    look(page, ui, "open/fmu:Rudder/point")
    api.expect(page.locator("text=At rest.")).to_be_visible()
    valve = page.get_by_label("bypass, slider")
    assert (valve.get_attribute("min"), valve.get_attribute("max")) == ("0", "1")  # as the FMU declares
    page.fill("#knob-delC", "2")
    page.press("#knob-delC", "Enter")
    row = page.locator("tr", has=page.locator("th", has_text=re.compile("^del$"))).locator("td").first
    api.expect(row).to_have_text(re.compile(r"^(2|1\.99\d*|2\.00\d*)$"))
    page.click("text=Keep this point")
    api.expect(page.locator("#kept")).to_contain_text("point-1.json")
    kept = json.loads((ui.folder / "point-1.json").read_text())
    assert abs(kept["operating_point"]["u"]["delC"] - 2.0) < 1e-12


def test_a_response_is_measured_and_its_points_are_asked(page: Page, ui: Ui) -> None:
    measure(page, ui)
    api.expect(page.locator(".legend li")).to_have_count(2)
    canvas = page.locator("canvas").first
    canvas.focus()
    for _ in range(5):
        page.keyboard.press("ArrowRight")
    api.expect(page.locator(".readout").first).to_contain_text("1 deg")
    page.keyboard.press("Enter")
    asked = page.locator("[aria-label='The point']")
    for words in ("Harmonics of the output", "Floquet multipliers", "Neighbours", "error, 95 %", "solved"):
        api.expect(asked).to_contain_text(words)
    canvas.hover(position={"x": 300, "y": 60})
    page.mouse.move(1, 1)  # a pointer that passes over the picture takes nothing away
    api.expect(page.locator(".readout").first).to_contain_text("1 deg: frequency 1.0368 Hz")
    page.click("text=Input and output over a period")
    api.expect(asked.locator("canvas")).to_have_count(1)
    api.expect(asked).to_contain_text("offset=0")
    page.get_by_role("button", name="Linear model").click()
    api.expect(page.locator(".legend").first).to_contain_text("lin: del by delC")
    # The point is the one under the cursor.
    assert page.locator(".readout").first.inner_text().startswith("1 deg: frequency 1.0368 Hz")
    assert asked.inner_text().startswith("Point at 1.0368 Hz")
    picture(page, "measured")
    page.click("summary:has-text('Export')")
    with page.expect_popup() as popup:
        page.get_by_role("link", name="Report", exact=True).click()
    api.expect(popup.value.locator("h1")).to_be_visible()


def test_a_band_is_drawn_with_the_mouse(page: Page, ui: Ui) -> None:
    measure(page, ui, amplitudes="1")
    page.get_by_role("button", name="Band", exact=True).click()
    box = page.locator("canvas").first.bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 100)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.8 * box["width"], box["y"] + 110, steps=5)
    page.mouse.up()
    low, high = (float(text) for text in page.input_value("#field-band").split(":"))
    assert 0.5 < low < high < 20.0
    # It ends with the band, which stays in sight: its ground is not that of the picture beside it.
    api.expect(page.get_by_role("button", name="Band", exact=True)).to_have_attribute("aria-pressed", "false")
    page.mouse.move(1, 1)
    page.wait_for_function(
        """() => { const c = document.querySelector("canvas.plot"), r = c.width / c.clientWidth;
        const at = (share) => String(c.getContext("2d").getImageData(share * c.width, c.height - 52 * r, 1, 1).data);
        return at(0.61) !== at(0.3); }"""
    )


def test_what_is_wrong_stands_at_its_field(page: Page, ui: Ui) -> None:
    look(page, ui, "open/fmu:Rudder/measure/nfr")
    page.fill("#field-amplitudes", "")
    page.fill("#field-band", "20")
    page.click("text=Run nfr")
    api.expect(page.locator("#field-amplitudes-wrong")).to_be_visible()
    api.expect(page.locator("#field-band-wrong")).to_contain_text("LO:HI")
    api.expect(page.locator("#field-band")).to_have_attribute("aria-invalid", "true")
    assert page.locator("[aria-invalid='true']").count() == 2  # no other field is blamed


def test_a_crash_is_a_message(page: Page, ui: Ui) -> None:
    fmu = build_hostile(ui.folder, "segfault")
    look(page, ui, f"open/{fmu.name}/measure/simulate")
    page.fill("#field-stop", "1")
    page.click("text=Run simulate")
    api.expect(page.locator("[aria-label='Result'] p.bad").first).to_contain_text("segmentation fault")
    assert ui.process.poll() is None  # the server lives on


def test_a_loop_is_closed_and_its_gain_dragged(page: Page, ui: Ui) -> None:
    look(page, ui, "system/new/Rudder.fmu")
    api.expect(page.locator("svg.diagram g")).to_have_count(3)
    page.click("text=+ gain")
    api.expect(page.locator("svg.diagram g")).to_have_count(4)
    page.locator("[aria-label='output gain.y']").click()
    page.locator("[aria-label='input gain2.u']").click()
    api.expect(page.locator("#toml")).to_have_value(re.compile('"gain2.u" = "gain.y"'))
    page.locator("[aria-label='output gain2.y']").click()
    page.locator("[aria-label='input plant.delC']").click()
    api.expect(page.locator("#toml")).to_have_value(re.compile('"plant.delC" = "gain2.y"'))
    text = page.input_value("#toml").replace("gain2 = 1.0", 'gain2 = {gain = 1.0, units = {u = "deg", y = "deg"}}')
    page.fill("#toml", text)
    picture(page, "diagram")
    page.click("text=Write and measure the loop")
    api.expect(page.locator("#field-open")).to_have_value("plant.del")
    api.expect(page.locator("a[data-name='loop.toml']")).to_be_visible()
    page.click("text=Run loop")
    page.get_by_role("link", name="Tune it", exact=True).click()
    margin = page.locator(".numbers .figure").first
    api.expect(margin).to_contain_text("dB")
    before = margin.inner_text()
    knob = page.get_by_label("loop gain, slider")
    knob.fill("0.3")  # decades
    api.expect(margin).not_to_have_text(before)
    assert abs(float(before.split()[0]) - float(margin.inner_text().split()[0]) - 6.0) < 0.11
    picture(page, "loop")
    knob.fill("1.5")
    api.expect(page.locator("main")).to_contain_text("more than 10 away from the step after")
    api.expect(page.locator(".verdict")).to_contain_text("the margins are then meaningless")
    picture(page, "loop-unstable")
    page.get_by_role("button", name="Undo").click()
    api.expect(page.locator(".verdict strong")).to_have_text("stable")
    page.on("dialog", lambda dialog: dialog.accept())
    page.click("text=Write into the system")
    api.expect(knob).to_have_value("0")  # the file has it now
    # The block that carries the whole loop has the factor; all else in the file is as it was.
    assert "gain = {gain = 1.9953" in (ui.folder / "loop.toml").read_text()
    assert "gain2 = {gain = 1.0" in (ui.folder / "loop.toml").read_text()


def test_runs_are_laid_over_each_other_and_compared(page: Page, ui: Ui) -> None:
    measure(page, ui, band="1:4")
    run = page.locator(".runs li").first
    run.get_by_role("checkbox").check()
    api.expect(page.locator(".legend li")).to_have_count(2)  # its own picture shows it once
    measure(page, ui, band="1:4", amplitudes="2")
    api.expect(page.locator(".legend li")).to_have_count(3)
    api.expect(page.locator(".legend li").last).to_contain_text("nfr")
    hide = page.locator(".legend button").last
    hide.click()
    api.expect(hide).to_have_attribute("aria-pressed", "false")
    page.fill("[aria-label='Name of the run']", "small")
    page.press("[aria-label='Name of the run']", "Enter")
    api.expect(run).to_contain_text("small")
    run.hover()
    run.get_by_role("button", name="Throw small away").click()
    api.expect(page.locator(".runs li", has_text="small")).to_have_count(0)
    go(page, "Compare", "Compare")
    api.expect(page.locator(".legend li").first).to_contain_text("nfr")
    api.expect(page.locator("main")).to_contain_text("dB at")
    api.expect(page.locator("main canvas")).to_have_count(4)
    # The same frequencies at both amplitudes, and the difference that their responses have.
    rows = [row.split("\t") for row in page.locator("main tbody tr").all_inner_texts()]
    least = min(rows, key=lambda row: float(row[1]))
    assert f"at most {float(least[1]):.3g} dB at {float(least[0]):.3g} Hz" in page.locator("main").inner_text()
    picture(page, "compare")


def test_a_store_appears_at_once(page: Page, ui: Ui) -> None:
    look(page, ui, "open/fmu:Rudder/measure/nfr")
    page.fill("#field-amplitudes", "1,4")
    page.fill("#field-band", "1:4")
    page.click("summary:has-text('More')")
    page.fill("#field-store", "runs")
    run_nfr(page)
    page.click("a[data-name='runs']")
    api.expect(page.locator("h1")).to_have_text("Store runs")
    api.expect(page.locator(".legend li")).to_have_count(2)
    assert [text[-11:] for text in page.locator(".legend li").all_inner_texts()] == ["amplitude 1", "amplitude 4"]
    picture(page, "store")


def saved(page: Page, button: str) -> bytes:
    page.click("summary:has-text('Export')")
    with page.expect_download() as download:
        page.get_by_role("button", name=button, exact=True).click()
    return Path(download.value.path()).read_bytes()


def test_pictures_are_saved_with_what_their_curves_are(page: Page, ui: Ui) -> None:
    measure(page, ui, band="0.5:2", amplitudes="1")
    drawing = saved(page, "SVG").decode()
    for words in ("gain [dB]", "phase [deg]", "frequency [Hz]", "1 deg"):
        assert words in drawing
    width, height = (int(size) for size in re.findall(r'^<svg[^>]* width="(\d+)" height="(\d+)"', drawing)[0])
    image = saved(page, "PNG")
    assert image.startswith(b"\x89PNG")
    assert [int.from_bytes(image[at : at + 4], "big") for at in (16, 20)] == [2 * width, 2 * height]
    heading, first, *_ = saved(page, "CSV").decode().splitlines()
    assert heading == "curve,frequency_hz,gain,gain_db,phase_deg,error,status,stable"
    assert first.startswith('"1 deg",0.5,')


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
    api.expect(page.locator("h1")).to_have_text("Store many")
    canvas = page.locator("main canvas").first
    margin = (high / low) ** 0.03
    ends = (low / margin, high * margin)
    for share in (0.1, 0.37, 0.5, 0.93):
        box = canvas.bounding_box()  # narrower beside a point
        assert box is not None
        wide = box["width"] - LEFT - RIGHT
        there = ends[0] * (ends[1] / ends[0]) ** share
        canvas.hover(position={"x": LEFT + share * wide, "y": 120})  # the curve is some way below or above
        api.expect(page.locator(".readout").first).to_contain_text("many: frequency")
        read = float(page.locator(".readout").first.inner_text().split("frequency ")[1].split(" Hz")[0])
        assert abs(math.log(read / there)) < 1.5 * math.log(ends[1] / ends[0]) / wide  # a pixel and a half
        canvas.click(position={"x": LEFT + share * wide, "y": 125})
        api.expect(page.locator("[aria-label='The point'] h2")).to_contain_text("Point at")
        asked = float(page.locator("[aria-label='The point'] h2").inner_text().split()[2])
        assert asked == pytest.approx(read, rel=1e-3)


def test_what_is_filled_in_stays(page: Page, ui: Ui) -> None:
    look(page, ui, "open/fmu:Rudder/measure/nfr")
    page.fill("#field-amplitudes", "3,5")
    page.click("#theme")
    api.expect(page.locator("#field-amplitudes")).to_have_value("3,5")
    look(page, ui, "open/fmu:Rudder/measure/trim")
    look(page, ui, "open/fmu:Rudder/measure/nfr")
    assert page.input_value("#field-amplitudes") == "3,5"
    look(page, ui, "system/new/fmu:Rudder")
    page.click("text=+ gain")
    api.expect(page.locator("#toml")).to_have_value(re.compile("gain2 = 1.0"))
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
    api.expect(page.locator("dl", has_text="excite")).to_contain_text("it needs an input, and this model has none")
    look(page, ui, "open/system%3Arudder_loop/measure/loop")
    assert {"loop", "limit-cycle", "nfr"} <= {choice.get_attribute("value") for choice in choices.all()}


def test_what_a_record_doubts_stands_on_the_page(page: Page, ui: Ui) -> None:
    look(page, ui, "open/fmu:AileronDamper/measure/lin")
    page.click("text=Run lin")
    said = page.get_by_label("What was found")
    api.expect(said.locator("strong.watch").first).to_have_text("doubtful")
    assert "chosen by auto" not in said.inner_text()
    picture(page, "doubtful")


def test_a_component_is_taken_away_in_the_diagram(page: Page, ui: Ui) -> None:
    look(page, ui, "system/new/fmu:FirstOrderLag")
    page.locator("main summary").click()
    page.get_by_role("button", name="remove gain and its wires").click()
    api.expect(page.locator("svg.diagram g")).to_have_count(2)
    assert "gain" not in page.input_value("#toml")
    page.locator("#toml").press_sequentially("\nx")
    api.expect(page.locator("#toml-wrong")).to_contain_text("not TOML yet")
    api.expect(page.locator("svg.diagram g")).to_have_count(2)  # the picture stays


def test_a_session_is_kept_as_a_study(page: Page, ui: Ui) -> None:
    measure(page, ui, band="1:4", amplitudes="1")
    go(page, "Keep", "This session as a study")
    api.expect(page.locator("textarea")).to_have_value(re.compile(r'command = "nfr"'))
    page.click("text=Write into the folder")
    api.expect(page.locator("#said")).to_contain_text("Wrote session.toml")
    assert (ui.folder / "session.toml").exists()


ENVELOPE = """
models.lag = "fmu:FirstOrderLag"
analyses.rest = {command = "trim", model = "lag", u0 = {u = 2.0}}
envelope.parameters = {"lag.tau" = {range = [0.5, 2.0], steps = 3}}
requirements = [{name = "gain", analysis = "rest", kind = "value", path = "y.y", max = 2.5}]
"""


def test_an_envelope_is_a_map_whose_points_are_asked(page: Page, ui: Ui) -> None:
    (ui.folder / "lags.toml").write_text(ENVELOPE)
    page.reload()
    look(page, ui, "open/lags.toml")
    page.click("text=Run the envelope")
    canvas = page.get_by_label("Envelope. Arrow keys")
    api.expect(canvas).to_be_visible()
    canvas.focus()
    page.keyboard.press("ArrowRight")
    page.keyboard.press("Enter")
    asked = page.locator(".beside > [role=status]")
    api.expect(asked).to_contain_text("lag.tau")
    # At rest y = u = 2, whatever tau is, and 2.5 is allowed.
    assert re.fullmatch(r"met 2\b.*", asked.locator("p").first.inner_text())
    assert re.search(r"Margin 0\.5\b", asked.inner_text())
    picture(page, "envelope")


def test_a_refresh_in_the_middle_and_another_tab_see_the_same(browser: Browser, tmp_path: Path) -> None:
    # The server keeps what was asked last: so long a run has a server of its own.
    with browser_workbench(tmp_path) as server, browser.new_context() as context:
        context.set_default_timeout(LONG)
        page = context.new_page()
        page.goto(server.address)
        api.expect(page.locator("h1")).to_be_visible()
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
        api.expect(page.locator(".legend li").first).to_be_visible()
        page.reload()
        api.expect(page.get_by_role("button", name="Stop")).to_be_visible()
        other = page.context.new_page()
        other.goto(page.url)
        other.get_by_role("button", name="Stop").click()
        for one in (page, other):
            api.expect(one.locator("strong", has_text="stopped")).to_be_visible()
            api.expect(one.locator(".legend li").first).to_contain_text(" deg")
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
        api.expect(page.locator("strong", has_text="running")).to_be_visible()
        page.get_by_role("button", name="Stop").click()
        api.expect(page.locator("strong", has_text="stopped")).to_be_visible()


def test_the_end_of_the_server_is_told(browser: Browser, tmp_path: Path) -> None:
    with browser_workbench(tmp_path) as server:
        page = browser.new_page()
        page.goto(server.address)
        api.expect(page.locator("h1")).to_be_visible()
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
    api.expect(page.locator("h2", has_text="variables")).to_contain_text("20")
    assert page.locator(".window .line").count() < 80
    page.locator(".window").evaluate("e => { e.scrollTop = e.scrollHeight; }")
    api.expect(page.locator(".window")).to_contain_text("extra[1999]")
    # A field for a variable searches all of them.
    look(page, ui, "open/Many.fmu/measure/modes")
    field = page.locator("#field-vary")
    field.press_sequentially("1999]")
    api.expect(page.locator(".picker li")).to_have_count(1)
    field.press("ArrowDown")
    field.press("Enter")
    api.expect(field).to_have_value("extra[1999]=")
    api.expect(page.locator(".picker li")).to_have_count(0)


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
}


AXE = ROOT / "tests" / "js" / "node_modules" / "axe-core" / "axe.min.js"


@pytest.mark.skipif(not AXE.exists(), reason="axe-core is not installed; `scripts/dev.py test` does it where npm is")
@pytest.mark.parametrize("theme", ["light", "dark"])
def test_axe_finds_nothing_serious(page: Page, ui: Ui, theme: str) -> None:
    page.evaluate("theme => localStorage.setItem('theme', theme)", theme)
    page.reload()
    measure(page, ui)
    api.expect(page.locator(".legend li")).to_have_count(2)
    for where in [None, *PAGES.values()]:
        if where is not None:
            look(page, ui, where)
        page.wait_for_load_state("load")
        page.evaluate(AXE.read_text(encoding="utf-8"))
        found = page.evaluate("async () => (await axe.run()).violations")
        serious = [v for v in found if v["impact"] in {"serious", "critical"}]
        assert not serious, (where, [(v["id"], v["nodes"][0]["html"][:200]) for v in serious])


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("width", [1200, 800])
def test_every_page_fits_and_can_be_read(page: Page, ui: Ui, theme: str, width: int) -> None:
    page.evaluate("theme => localStorage.setItem('theme', theme)", theme)
    page.set_viewport_size({"width": width, "height": 900})
    page.reload()
    for name, where in PAGES.items():
        look(page, ui, where)
        api.expect(page.locator("main h1")).not_to_have_text("This cannot be shown")
        page.wait_for_load_state("load")
        wide = page.evaluate("document.documentElement.scrollWidth")
        assert wide <= width, name
        unnamed = page.evaluate(UNNAMED)
        assert unnamed == [], name
        picture(page, f"{name}-{theme}-{width}")

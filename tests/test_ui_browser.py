"""The browser workbench in a real browser: what a person does with it, from the card to the study."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.hostile_fmus import build_hostile
from tests.ui_pages import expect, go, look, measure, picture, run_nfr
from tests.ui_server import Ui, browser_workbench

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
pytest.importorskip("starlette", reason="the extra 'ui' is not installed")


@pytest.fixture(scope="module")
def ui(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Ui]:
    with browser_workbench(tmp_path_factory.mktemp("root")) as server:
        yield server


def test_the_token_leaves_the_address(page: Page, ui: Ui) -> None:
    expect(page).to_have_url(f"{ui.base}/")
    assert "token" not in page.evaluate("location.href + document.referrer")
    page.reload()
    expect(page.locator("h1")).to_be_visible()


def test_a_card_says_what_a_model_is_and_whether_it_is_sound(page: Page, ui: Ui) -> None:
    page.click("a[data-name='Rudder.fmu']")
    expect(page.locator("h1")).to_have_text("Rudder")
    expect(page.locator("text=The whole check")).to_be_visible()
    page.fill("[aria-label='Search variables']", "supply")
    expect(page.locator(".window .line")).to_have_count(1)
    expect(page.locator(".window .line")).to_contain_text("pS")
    assert page.locator(".window .line").inner_text().split()[:4] == ["pS", "input", "2.06e7", "Pa"]


def test_an_operating_point_follows_its_inputs_and_is_kept(page: Page, ui: Ui) -> None:
    look(page, ui, "open/fmu:Rudder/point")
    expect(page.locator("text=At rest.")).to_be_visible()
    valve = page.get_by_label("bypass, slider")
    assert (valve.get_attribute("min"), valve.get_attribute("max")) == ("0", "1")  # as the FMU declares
    page.fill("#knob-delC", "2")
    page.press("#knob-delC", "Enter")
    row = page.locator("tr", has=page.locator("th", has_text=re.compile("^del$"))).locator("td").first
    expect(row).to_have_text(re.compile(r"^(2|1\.99\d*|2\.00\d*)$"))
    page.click("text=Keep this point")
    expect(page.locator("#kept")).to_contain_text("point-1.json")
    kept = json.loads((ui.folder / "point-1.json").read_text())
    assert abs(kept["operating_point"]["u"]["delC"] - 2.0) < 1e-12


def test_a_response_is_measured_and_its_points_are_asked(page: Page, ui: Ui) -> None:
    measure(page, ui)
    expect(page.locator(".legend li")).to_have_count(2)
    canvas = page.locator("canvas").first
    canvas.focus()
    for _ in range(5):
        page.keyboard.press("ArrowRight")
    expect(page.locator(".readout").first).to_contain_text("1 deg")
    page.keyboard.press("Enter")
    asked = page.locator("[aria-label='The point']")
    for words in ("Harmonics of the output", "Floquet multipliers", "Neighbours", "error, 95 %", "solved"):
        expect(asked).to_contain_text(words)
    canvas.hover(position={"x": 300, "y": 60})
    page.mouse.move(1, 1)  # a pointer that passes over the picture takes nothing away
    expect(page.locator(".readout").first).to_contain_text("1 deg: frequency 1.0368 Hz")
    page.click("text=Input and output over a period")
    expect(asked.locator("canvas")).to_have_count(1)
    expect(asked).to_contain_text("offset=0")
    page.get_by_role("button", name="Linear model").click()
    expect(page.locator(".legend").first).to_contain_text("lin: del by delC")
    # The point is the one under the cursor.
    assert page.locator(".readout").first.inner_text().startswith("1 deg: frequency 1.0368 Hz")
    assert asked.inner_text().startswith("Point at 1.0368 Hz")
    picture(page, "measured")
    page.click("summary:has-text('Export')")
    with page.expect_popup() as popup:
        page.get_by_role("link", name="Report", exact=True).click()
    expect(popup.value.locator("h1")).to_be_visible()


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
    expect(page.get_by_role("button", name="Band", exact=True)).to_have_attribute("aria-pressed", "false")
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
    expect(page.locator("#field-amplitudes-wrong")).to_be_visible()
    expect(page.locator("#field-band-wrong")).to_contain_text("LO:HI")
    expect(page.locator("#field-band")).to_have_attribute("aria-invalid", "true")
    assert page.locator("[aria-invalid='true']").count() == 2  # no other field is blamed


def test_a_crash_is_a_message(page: Page, ui: Ui) -> None:
    fmu = build_hostile(ui.folder, "segfault")
    look(page, ui, f"open/{fmu.name}/measure/simulate")
    page.fill("#field-stop", "1")
    page.click("text=Run simulate")
    expect(page.locator("[aria-label='Result'] p.bad").first).to_contain_text("segmentation fault")
    assert ui.process.poll() is None  # the server lives on


def test_a_loop_is_closed_and_its_gain_dragged(page: Page, ui: Ui) -> None:
    look(page, ui, "system/new/Rudder.fmu")
    expect(page.locator("svg.diagram rect")).to_have_count(3)
    page.click("text=+ gain")
    expect(page.locator("svg.diagram rect")).to_have_count(4)
    page.locator("[aria-label='output gain.y']").click()
    page.locator("[aria-label='input gain2.u']").click()
    expect(page.locator("#toml")).to_have_value(re.compile('"gain2.u" = "gain.y"'))
    page.locator("[aria-label='output gain2.y']").click()
    page.locator("[aria-label='input plant.delC']").click()
    expect(page.locator("#toml")).to_have_value(re.compile('"plant.delC" = "gain2.y"'))
    text = page.input_value("#toml").replace("gain2 = 1.0", 'gain2 = {gain = 1.0, units = {u = "deg", y = "deg"}}')
    page.fill("#toml", text)
    picture(page, "diagram")
    page.click("text=Write and measure the loop")
    expect(page.locator("#field-open")).to_have_value("plant.del")
    expect(page.locator("a[data-name='loop.toml']")).to_be_visible()
    page.click("text=Run loop")
    page.get_by_role("link", name="Tune it", exact=True).click()
    margin = page.locator(".numbers .figure").first
    expect(margin).to_contain_text("dB")
    before = margin.inner_text()
    knob = page.get_by_label("loop gain, slider")
    knob.fill("0.3")  # decades
    expect(margin).not_to_have_text(before)
    assert abs(float(before.split()[0]) - float(margin.inner_text().split()[0]) - 6.0) < 0.11
    picture(page, "loop")
    knob.fill("1.5")
    expect(page.locator("main")).to_contain_text("more than 10 away from the step after")
    expect(page.locator(".verdict")).to_contain_text("the margins are then meaningless")
    picture(page, "loop-unstable")
    page.get_by_role("button", name="Undo").click()
    expect(page.locator(".verdict strong")).to_have_text("stable")
    page.on("dialog", lambda dialog: dialog.accept())
    page.click("text=Write into the system")
    expect(knob).to_have_value("0")  # the file has it now
    # The block that carries the whole loop has the factor; all else in the file is as it was.
    assert "gain = {gain = 1.9953" in (ui.folder / "loop.toml").read_text()
    assert "gain2 = {gain = 1.0" in (ui.folder / "loop.toml").read_text()


def test_runs_are_laid_over_each_other_and_compared(page: Page, ui: Ui) -> None:
    measure(page, ui, band="1:4")
    run = page.locator(".runs li").first
    run.get_by_role("checkbox").check()
    expect(page.locator(".legend li")).to_have_count(2)  # its own picture shows it once
    measure(page, ui, band="1:4", amplitudes="2")
    expect(page.locator(".legend li")).to_have_count(3)
    expect(page.locator(".legend li").last).to_contain_text("nfr")
    hide = page.locator(".legend button").last
    hide.click()
    expect(hide).to_have_attribute("aria-pressed", "false")
    page.fill("[aria-label='Name of the run']", "small")
    page.press("[aria-label='Name of the run']", "Enter")
    expect(run).to_contain_text("small")
    run.hover()
    run.get_by_role("button", name="Throw small away").click()
    expect(page.locator(".runs li", has_text="small")).to_have_count(0)
    go(page, "Compare", "Compare")
    expect(page.locator(".legend li").first).to_contain_text("nfr")
    expect(page.locator("main")).to_contain_text("dB at")
    expect(page.locator("main canvas")).to_have_count(4)
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
    expect(page.locator("h1")).to_have_text("Store runs")
    expect(page.locator(".legend li")).to_have_count(2)
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


def test_a_component_is_taken_away_in_the_diagram(page: Page, ui: Ui) -> None:
    look(page, ui, "system/new/fmu:FirstOrderLag")
    page.locator("main summary").click()
    page.get_by_role("button", name="remove gain and its wires").click()
    expect(page.locator("svg.diagram rect")).to_have_count(2)
    assert "gain" not in page.input_value("#toml")
    page.locator("#toml").press_sequentially("\nx")
    expect(page.locator("#toml-wrong")).to_contain_text("not TOML yet")
    expect(page.locator("svg.diagram rect")).to_have_count(2)  # the picture stays


def test_a_session_is_kept_as_a_study(page: Page, ui: Ui) -> None:
    measure(page, ui, band="1:4", amplitudes="1")
    go(page, "Keep", "This session as a study")
    expect(page.locator("textarea")).to_have_value(re.compile(r'command = "nfr"'))
    page.click("text=Write into the folder")
    expect(page.locator("#said")).to_contain_text("Wrote session.toml")
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
    page.get_by_role("button", name="Run", exact=True).click()
    canvas = page.get_by_label("Envelope. Arrow keys")
    expect(canvas).to_be_visible()
    canvas.focus()
    page.keyboard.press("ArrowRight")
    page.keyboard.press("Enter")
    asked = page.locator(".beside > [role=status]")
    expect(asked).to_contain_text("lag.tau")
    # At rest y = u = 2, whatever tau is, and 2.5 is allowed.
    assert re.fullmatch(r"met 2\b.*", asked.locator("p").first.inner_text())
    assert re.search(r"Margin 0\.5$", asked.inner_text(), re.MULTILINE)
    # The colours are told by their margins: what is much of one only a person knows.
    expect(page.locator(".legend li", has_text=re.compile(r"^met, margin 0\.5$"))).to_have_count(1)
    picture(page, "envelope")

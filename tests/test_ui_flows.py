"""Files of data, studies and loops in a real browser: what a person does with them."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

import workbench as wb
from tests.ui_pages import expect, look, picture
from tests.ui_server import REST_STUDY, Ui, browser_workbench

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
pytest.importorskip("starlette", reason="the extra 'ui' is not installed")

# The lag has its bandwidth at 1/(2 π tau): at the second of two points it is 0.08 Hz.
ENVELOPE = """models.lag = "fmu:FirstOrderLag"

[analyses.linear]
command = "lin"
model = "lag"

[[requirements]]
name = "fast"
analysis = "linear"
kind = "bandwidth"
min = 0.1

[envelope]
requirement = "fast"
plan = "grid"
search = 0

[envelope.parameters]
"lag.tau" = {range = [1.0, 2.0], steps = 2}
"""

LEFT, RIGHT = 68, 14  # beside the axes of a picture [pixel]


@pytest.fixture(scope="module")
def ui(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Ui]:
    folder = tmp_path_factory.mktemp("root")
    record(folder / "lag.csv")
    (folder / "study.toml").write_text(REST_STUDY)
    loop = (Path(__file__).resolve().parents[1] / "systems" / "rudder_loop.toml").read_text()
    (folder / "loop.toml").write_text(loop)
    with browser_workbench(folder) as server:
        yield server


def record(file: Path) -> None:
    u = np.sign(np.random.default_rng(2).normal(size=1500))
    y = np.zeros(len(u))
    for k in range(len(u) - 1):
        y[k + 1] = 0.8 * y[k] + 0.2 * u[k]
    wb.make_experiment(0.1, u, y, input_names=["u"], output_names=["y"]).to_csv(file)


def test_a_model_is_identified_from_a_file_that_was_looked_at(page: Page, ui: Ui) -> None:
    page.click("a[data-name='lag.csv']")
    expect(page.locator("h1")).to_have_text("lag.csv")
    expect(page.locator("main")).to_contain_text("1500 samples, every 0.1 s")
    expect(page.get_by_label("u: role")).to_have_value("input")
    canvas = page.locator("main canvas").first
    expect(canvas).to_be_visible()
    canvas.focus()
    with page.expect_response("**/api/data") as answer:  # of what is looked at closer there are more samples
        page.keyboard.press("+")
    assert json.loads(answer.value.request.post_data or "")["end"] < 149.9
    page.fill("#field-order", "1")
    page.click("text=Run identify")
    expect(page.get_by_label("What was found")).to_contain_text("order 1")
    expect(page.locator(".result .legend").first).to_contain_text("identified: y by u")
    expect(page.locator("a[data-work]").first).to_contain_text("fit 100 %")
    picture(page, "identified")
    page.click("text=Make an FMU")
    expect(page.locator("h1")).to_have_text(re.compile(r"^identify-\d+\.json$"))
    expect(page.locator("#field-out")).to_have_value(re.compile(r"^identify-\d+\.fmu$"))


def test_parameters_of_a_model_are_told_by_a_file_with_their_regions(page: Page, ui: Ui) -> None:
    look(page, ui, "open/lag.csv")
    page.select_option("#model", "fmu:FirstOrderLag")
    page.get_by_role("button", name="Calibrate …").click()
    expect(page.locator("#field-data")).to_have_value("lag.csv")
    expect(page.locator("#field-inputs")).to_have_value("u")
    page.click("text=Run calibrate")  # nothing is free
    expect(page.locator("#field-free-wrong")).to_contain_text("needed")
    page.click("#field-free")
    page.keyboard.type("tau")
    page.keyboard.type("=0.1:10")
    page.click("text=Run calibrate")
    expect(page.get_by_label("What was found").locator(".lead")).to_contain_text("The data tell the value")
    row = page.locator("tr", has=page.get_by_role("rowheader", name="tau [s]")).locator("td")
    value, low, high = (float(row.nth(k).inner_text()) for k in (1, 3, 4))
    assert value == pytest.approx(-0.1 / np.log(0.8), rel=1e-4)  # the record is a lag with this pole, sampled
    assert low <= value <= high
    expect(page.locator("a[data-work]").first).to_contain_text(f"tau = {value:.4g}")
    picture(page, "calibrated")


def test_a_study_is_written_with_its_verdicts_beside(page: Page, ui: Ui) -> None:
    look(page, ui, "open/study.toml")
    text = page.get_by_label("Study file")
    table = page.get_by_role("region", name="Requirements").locator("tbody tr")
    expect(table).to_have_count(1)
    expect(table.first).to_contain_text("not run")
    text.press("Control+End")
    text.press_sequentially('[[requirements]]\nname = "less"\nkind = "val')
    expect(page.locator("#completions li").first).to_have_text("value")
    text.press("Enter")
    text.press("End")
    text.press_sequentially("\npath = ")
    text.press("Escape")
    text.press_sequentially('"y.y"\nmax = 1.5')
    mistakes = page.get_by_label("Mistakes")
    expect(mistakes).to_contain_text("analysis")
    expect(page.get_by_role("button", name="Run", exact=True)).to_be_disabled()
    text.press_sequentially('\nanalysis = "rest"\n')
    expect(table).to_have_count(2)
    expect(mistakes.locator("li")).to_have_count(0)
    page.get_by_role("button", name="Run", exact=True).click()
    expect(table.first).to_contain_text("passed")
    expect(table.last).to_contain_text("violated")
    expect(page.get_by_label("What was found")).to_contain_text("less")
    assert 'name = "less"' in (ui.folder / "study.toml").read_text()
    picture(page, "study")
    table.first.get_by_role("button").click()  # goes to its line
    assert text.evaluate("e => e.value.slice(e.selectionStart, e.selectionEnd)") == "[[requirements]]"


def test_a_block_goes_into_the_wire_that_is_chosen(page: Page, ui: Ui) -> None:
    look(page, ui, "system/loop.toml")
    boxes = page.locator("svg.diagram rect")
    before = boxes.count()
    wire = page.get_by_role("button", name=re.compile("^wire from .* to plant.delC$"))
    wire.focus()
    page.keyboard.press("Enter")
    expect(wire).to_have_attribute("aria-pressed", "true")
    page.click("text=+ saturation")
    expect(boxes).to_have_count(before + 1)
    put = page.get_by_role("button", name="wire from saturation.y to plant.delC")
    expect(put).to_have_count(1)
    x, y = put.evaluate(
        """g => { const p = g.querySelector(".reach"), m = p.getPointAtLength(p.getTotalLength() / 2).matrixTransform(
        p.getScreenCTM()), r = document.querySelector(".drawing").getBoundingClientRect();
        return [m.x - r.x, m.y - r.y]; }"""
    )
    page.locator("button", has_text="+ notch").drag_to(page.locator(".drawing"), target_position={"x": x, "y": y})
    expect(page.get_by_role("button", name="wire from notch.y to plant.delC")).to_have_count(1)
    assert boxes.count() == before + 2
    picture(page, "wires")


def test_a_pole_is_dragged_along_the_locus(page: Page, ui: Ui) -> None:
    look(page, ui, "tune/system%3Arudder_loop")
    canvas = page.locator("canvas[aria-label^='Root locus']")
    gain = page.get_by_label("loop gain ×")
    expect(gain).to_have_value("1")
    # A place of the locus of a larger gain, in pixels of the picture, and the pole that leads there.
    page.wait_for_function("() => document.querySelector('.verdict').dataset.ms")
    expect(page.locator(".numbers .figure").first).to_contain_text("dB")
    told = page.evaluate(
        """async () => (await (await fetch("/api/tune", { method: "POST", body: JSON.stringify(
        { name: "system:rudder_loop", open: "plant.del", values: {}, locus: true }) })).json())"""
    )
    poles = [complex(*p) for p in zip(told["poles"]["re"], told["poles"]["im"], strict=True)]
    start = max((p for p in poles if p.imag > 0.0), key=lambda p: p.real)
    locus = list(zip(told["locus"]["gain"], told["locus"]["re"], told["locus"]["im"], strict=True))
    wanted = min((row for row in locus if 1.2 < row[0] < 1.6), key=lambda row: abs(complex(*row[1:]) - start))
    box = canvas.bounding_box()
    assert box is not None
    size = 4.0 * 2.0 * np.pi * told["margins"]["gain_crossovers"][-1]["frequency_hz"]

    def at(place: complex) -> tuple[float, float]:
        (low, high), (bottom, top) = (-size, size / 4.0), (-size, size)
        (low, high), (bottom, top) = ((a - 0.06 * (b - a), b + 0.06 * (b - a)) for a, b in ((low, high), (bottom, top)))
        x = LEFT + (place.real - low) / (high - low) * (box["width"] - LEFT - RIGHT)
        y = box["height"] - 40 - (place.imag - bottom) / (top - bottom) * (box["height"] - 40 - 10)
        return box["x"] + x, box["y"] + y

    page.mouse.move(*at(start))
    page.mouse.down()
    page.mouse.move(*at(complex(*wanted[1:])), steps=4)
    page.mouse.up()
    expect(gain).not_to_have_value("1")
    assert float(gain.input_value()) == pytest.approx(wanted[0], rel=0.1)
    page.keyboard.press("Control+z")
    expect(gain).to_have_value("1")


def test_a_controller_is_found_for_wanted_margins_and_written_down(page: Page, ui: Ui) -> None:
    (ui.folder / "slow.toml").write_text((ui.folder / "loop.toml").read_text().replace("gain = 2.0", "gain = 0.5"))
    page.reload()
    look(page, ui, "tune/slow.toml")
    gain = page.locator("[id='tune-gain.gain']")
    expect(gain).to_have_value("0.5")
    margin = page.locator(".numbers .figure").nth(1)
    page.wait_for_function("() => document.querySelector('.verdict').dataset.ms")
    page.fill("#wanted-hz", "20")
    page.get_by_label("gain.gain: find it").uncheck()  # nothing is free: said, and nothing is changed
    page.get_by_role("button", name="Find it").click()
    found = page.locator(".found")
    expect(found).to_contain_text("is needed")
    page.get_by_label("gain.gain: find it").check()
    page.get_by_role("button", name="Find it").click()
    expect(found).to_contain_text("2 of 3 requirements met")  # of 20 Hz there is no talk with 45°
    expect(found).to_contain_text("violated crossover")
    expect(found).to_contain_text("Held back by: phase margin")
    expect(margin).to_have_text("45 °")
    expect(margin).to_have_class(re.compile("good"))
    expect(page.locator(".numbers .figure").nth(3)).to_have_class(re.compile("bad"))
    value = gain.input_value()
    assert float(value) > 0.5
    picture(page, "found")
    wanted = (ui.folder / "slow_wanted.toml").read_text()
    assert "min = 45.0" in wanted
    page.keyboard.press("Control+z")
    expect(gain).to_have_value("0.5")
    page.fill("#wanted-hz", "2")
    page.on("dialog", lambda dialog: pytest.fail(f"asked: {dialog.message}"))  # what it wrote itself it writes anew
    page.get_by_role("button", name="Find it").click()
    expect(found).to_contain_text("3 of 3 requirements met")
    assert float(gain.input_value()) == pytest.approx(float(value), rel=1e-6)  # of a search that came from elsewhere
    page.get_by_role("button", name="Write into the system").click()
    expect(page.locator("#said")).to_contain_text("Wrote slow.toml")
    text = (ui.folder / "slow.toml").read_text()
    (written,) = re.findall(r"gain = \{gain = ([\d.]+)", text)
    assert float(written) == pytest.approx(float(value), rel=1e-4)
    assert text.startswith("# The bundled rudder")
    with wb.load(ui.folder / "slow.toml") as model:
        linear = wb.loop(model, open="plant.del").linear
    assert linear is not None
    margins = linear.margins
    assert 45.0 <= margins.phase_margin_deg < 45.001  # met, as the page says: no digit is lost on the way


def test_what_is_wanted_is_of_the_file_that_was_written(page: Page, ui: Ui) -> None:
    look(page, ui, "tune/system%3Arudder_loop")
    page.wait_for_function("() => document.querySelector('.verdict').dataset.ms")
    page.fill("#wanted-hz", "5.5")  # faster than it is
    page.get_by_role("button", name="Find it").click()
    expect(page.locator(".found")).to_contain_text("requirements met")
    study = ui.folder / "rudder_loop_wanted.toml"
    assert tomllib.loads(study.read_text())["models"]["loop"] == "system:rudder_loop"
    page.get_by_role("button", name="Write into the system").click()
    expect(page.locator("main")).to_have_attribute("data-shown", "#/tune/rudder_loop.toml/plant.del")
    page.wait_for_function("() => document.querySelector('.verdict').dataset.ms")
    expect(page.locator("#wanted-hz")).to_have_value("5.5")
    assert tomllib.loads(study.read_text())["models"]["loop"] == "rudder_loop.toml"
    (crossover,) = [c for c in wb.run_study(study).checked if c.requirement.name == "crossover"]
    assert crossover.finding.passed  # the bundled loop is slower


def test_a_loop_at_real_amplitudes_says_where_it_crosses(page: Page, ui: Ui) -> None:
    look(page, ui, "tune/system%3Arudder_loop")
    page.fill("#wanted-hz", "6.84")
    page.fill("#amplitude", "10")
    page.press("#amplitude", "Enter")
    crossover = page.locator(".numbers > div").nth(3).locator(".dim", has_text="at 10 deg")
    expect(crossover.locator(".bad")).to_have_text(re.compile(r"^[\d.]+$"))
    hz = float(crossover.locator(".bad").inner_text())
    with wb.load("system:rudder_loop") as model:
        around = wb.loop(model, open="plant.del", frequencies=[0.97 * hz, 1.03 * hz], amplitudes=[10.0]).curves[0]
    assert abs(around.value[0]) > 1.0 > abs(around.value[-1])
    picture(page, "amplitudes")


def test_one_click_runs_a_study_that_cannot_be_written(page: Page, ui: Ui) -> None:
    look(page, ui, "open/study%3Arudder_specification")
    runs = page.locator("a[data-work]", has_text="study:rudder_specification")
    expect(runs).to_have_count(0)
    page.get_by_role("button", name="Run", exact=True).click()
    expect(runs).to_have_count(1)
    expect(page.get_by_label("Result").locator(".run")).to_be_visible()
    page.get_by_role("button", name="Stop").click()
    expect(runs).to_contain_text("stopped")
    copy = ui.folder / "rudder_specification.toml"
    assert not copy.exists()
    page.get_by_label("Study file").press("Control+Home")
    page.get_by_label("Study file").press_sequentially("# mine\n")
    page.get_by_role("button", name="Run", exact=True).click()  # the copy is run by the same click
    expect(page.locator("a[data-work]", has_text="rudder_specification.toml")).to_have_count(1)
    assert copy.read_text().startswith("# mine\n")
    page.get_by_role("button", name="Stop").click()
    expect(page.locator("h1")).to_have_text("rudder_specification.toml")


def test_a_page_of_a_server_that_ended_says_where_the_new_one_is(browser: Browser, tmp_path: Path) -> None:
    with browser_workbench(tmp_path) as server:
        page = browser.new_context().new_page()
        page.goto(server.address)
        expect(page.locator("h1")).to_be_visible()
        expect(page.locator("#gone")).to_be_hidden()
        server.process.kill()
        expect(page.locator("#gone")).to_be_visible()
        assert "open the address that it printed" in page.locator("#gone").inner_text()
        page.context.close()


def test_an_envelope_says_where_it_fails_and_names_of_any_length_leave_room(page: Page, ui: Ui) -> None:
    long = "n" * 300
    (ui.folder / "long.toml").write_text((ui.folder / "loop.toml").read_text().replace('"rudder_loop"', f'"{long}"'))
    (ui.folder / "mapped.toml").write_text(ENVELOPE)
    page.reload()
    page.set_viewport_size({"width": 800, "height": 900})
    look(page, ui, "tune/long.toml")
    title = page.locator("h1")
    expect(title).to_have_attribute("title", long)
    head, sliders, gain = (
        place.bounding_box() for place in (title, page.locator(".sliders"), page.locator(".tiles canvas").first)
    )
    assert head is not None
    assert sliders is not None
    assert gain is not None
    assert head["height"] < 60  # two lines
    assert gain["x"] > sliders["x"] + sliders["width"]  # beside them, also where it is narrow
    look(page, ui, "open/mapped.toml")
    page.get_by_role("button", name="Run", exact=True).click()
    row = page.get_by_role("region", name="Requirements").locator("tbody tr").first
    expect(row).to_contain_text("see the map")
    expect(page.locator(".study")).to_contain_text("is met at 1 of 2 points")
    expect(page.get_by_label("Result").locator("canvas").first).to_be_in_viewport()
    picture(page, "envelope")

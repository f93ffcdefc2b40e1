"""Loops that are tuned in the browser: what they are at other values, on a server that outlives their FMUs."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import pytest

from tests.hostile_fmus import build_hostile
from tests.ui_server import Ui, browser_workbench

pytest.importorskip("starlette", reason="the extra 'ui' is not installed")


@pytest.fixture(scope="module")
def ui(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Ui]:
    with browser_workbench(tmp_path_factory.mktemp("root")) as server:
        yield server


LOOP = {"name": "system:rudder_loop", "open": "plant.del"}


def tuned(ui: Ui, **values: float) -> Any:  # noqa: ANN401 - JSON
    named = {name.replace("_", " ") if name == "loop_gain" else "gain.gain": value for name, value in values.items()}
    answer = ui.ask("POST", "/api/tune", {**LOOP, "values": named, "locus": True})
    assert answer.status == 200, answer.body
    return answer.json


def test_a_loop_at_other_values(ui: Ui) -> None:
    begun = ui.ask("POST", "/api/tune", LOOP).json
    (parameter,) = begun["parameters"]
    assert (parameter["name"], parameter["value"], parameter["quick"]) == ("gain.gain", 2.0, True)
    full = ui.ended(ui.begin("loop", "system:rudder_loop", open="plant.del"))
    margin = full["record"]["linear"]["margins"]["gain_margin_db"]
    assert tuned(ui)["margins"]["gain_margin_db"] == pytest.approx(margin, abs=1e-6)
    less = margin - 20.0 * math.log10(1.5)
    for more in (tuned(ui, gain=3.0), tuned(ui, loop_gain=1.5)):
        assert more["margins"]["gain_margin_db"] == pytest.approx(less, abs=1e-6)
    critical = 10 ** (margin / 20)
    for share, verdict in ((0.99, "stable"), (1.01, "unstable")):
        beside = tuned(ui, loop_gain=share * critical)
        assert beside["margins"]["closed_loop"] == beside["verdict"]["word"] == verdict
    for value in ("x", 0, -1, None, True, [1.0]):
        assert ui.ask("POST", "/api/tune", {**LOOP, "values": {"loop gain": value}}).status == 422
    for wrong in ({"name": "../x.toml"}, {"open": "nothing.y"}, {"values": {"no.such": 1.0}}):
        assert ui.ask("POST", "/api/tune", {**LOOP, "values": {}, **wrong}).status in {404, 422}


def test_an_unstable_loop_has_no_margins_and_a_step_that_is_cut(ui: Ui) -> None:
    margin = tuned(ui)["margins"]["gain_margin_db"]
    found = tuned(ui, loop_gain=4.0)
    assert "unstable" in found["verdict"]["text"]
    assert "meaningless" in found["verdict"]["text"]
    assert found["margins"]["phase_margin_deg"] is None
    (crossing,) = found["margins"]["phase_crossovers"]  # so far may the gain fall before it is stable
    assert crossing["db"] == pytest.approx(margin - 20.0 * math.log10(4.0), abs=1e-6)
    # It leaves when the growing motion, exp(σ t) in envelope, is about ten times the step; until then it is shown.
    step, growth = found["step"], max(found["poles"]["re"])
    assert step["left_s"] == step["time"][-1]
    assert 10.0 < abs(step["value"][-1] - 1.0) < 12.0
    assert max(abs(v - 1.0) for v in step["value"][:-2]) <= 10.0
    assert 0.2 < step["left_s"] * growth < 4.0


def test_a_root_locus_begins_at_the_poles_of_the_open_loop_and_passes_those_of_the_closed_one(ui: Ui) -> None:
    found = tuned(ui)
    (begin, now, all_of_it) = (
        [complex(re, im) for re, im in zip(found[key]["re"], found[key]["im"], strict=True)]
        for key in ("open_poles", "poles", "locus")
    )
    for pole in begin:
        assert min(abs(pole - p) for p in all_of_it[: len(begin)]) < 0.05 * abs(pole) + 1e-6
    for pole in now:
        assert min(abs(pole - p) for p in all_of_it) < 0.05 * abs(pole) + 1e-6


def test_a_tuned_loop_is_measured_with_its_values_and_written_with_its_comments(ui: Ui) -> None:
    asked = {
        **LOOP,
        "values": {"gain.gain": 3.0},
        "measure": {"open": "plant.del", "amplitudes": "1", "frequencies": "4"},
    }
    work = ui.ask("POST", "/api/tune", asked).json
    assert work["aside"]
    full = ui.ended(work["number"])
    assert full["state"] == "done", full["failure"]
    margins = full["record"]["linear"]["margins"]
    assert margins["gain_margin_db"] == pytest.approx(tuned(ui, gain=3.0)["margins"]["gain_margin_db"], abs=1e-6)
    text = ui.get("/api/text?name=system:rudder_loop")["text"]
    sent = {"name": "system:rudder_loop", "text": text, "change": ["set", "gain.gain", "3.5"]}
    changed = ui.ask("POST", "/api/diagram", sent).json["text"]
    assert changed == text.replace("gain = 2.0", "gain = 3.5")


CRASHES = """
[components]
plant = "segfault-at-start.fmu"
gain = 2.0
[connections]
"gain.u" = "plant.y"
"plant.u" = {from = "gain.y", gain = -1.0}
"""


def test_a_crash_of_an_fmu_leaves_the_server_and_is_a_message(ui: Ui) -> None:
    build_hostile(ui.folder, "segfault-at-start")
    (ui.folder / "crashes.toml").write_text(CRASHES)
    asked = {"name": "crashes.toml", "open": "plant.y"}
    for sent in (asked, {**asked, "values": {}}):
        answer = ui.ask("POST", "/api/tune", sent)
        assert answer.status == 422
        assert "segmentation fault" in answer.json["message"]
    assert ui.process.poll() is None
    assert tuned(ui)["margins"]["closed_loop"] == "stable"

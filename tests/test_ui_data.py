"""Files in the browser: recorded data are looked at and identified, studies checked and run, FMUs made."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import workbench as wb
from tests.ui_server import REST_STUDY, Ui, browser_workbench
from workbench.ui.recorded import thinned

pytest.importorskip("starlette", reason="the extra 'ui' is not installed")

DT, POLE, SAMPLES = 0.1, 0.8, 4000


@pytest.fixture(scope="module")
def ui(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Ui]:
    folder = tmp_path_factory.mktemp("root") / "inside"
    folder.mkdir()
    (folder.parent / "outside.csv").write_text("time [s],u,y\n0,0,0\n1,1,1\n2,0,1\n")
    u = np.sign(np.random.default_rng(1).normal(size=SAMPLES))
    y = np.zeros(SAMPLES)
    for k in range(SAMPLES - 1):
        y[k + 1] = POLE * y[k] + (1.0 - POLE) * u[k]
    wb.make_experiment(DT, u, y, input_names=["u"], output_names=["y"], output_units=["deg"]).to_csv(folder / "lag.csv")
    with browser_workbench(folder) as server:
        yield server


# -- data -----------------------------------------------------------------------------------------------


def test_extremes_of_a_thinned_signal_are_those_of_the_signal() -> None:
    time = np.arange(100_000.0)
    values = np.sin(time / 500.0)
    values[31_234], values[77_000] = 9.0, np.nan
    x, y = thinned(time, values, 1000.0, 90_000.0)
    assert len(x) == len(y) == 2000
    assert np.all(np.diff(x) >= 0.0)
    assert (np.nanmax(y), x[np.nanargmax(y)]) == (9.0, 31_234.0)
    x, y = thinned(time, values, 200.0, 300.0)
    assert (x[0], x[-1], len(y)) == (199.0, 301.0, 103)  # all of them, and one beyond each end


def test_a_record_says_what_it_holds(ui: Ui) -> None:
    assert {"name": "lag.csv", "kind": "data"} in ui.get("/api/files")["files"]
    found = ui.ask("POST", "/api/data", {"name": "lag.csv", "channels": ["y"], "begin": 10.0, "end": 12.0}).json
    assert found["time"] == {"begin": 0.0, "end": pytest.approx(DT * (SAMPLES - 1)), "samples": SAMPLES, "dt": DT}
    u, y = found["channels"]
    assert (u["name"], u["values"], u["least"], u["most"]) == ("u", 2, -1.0, 1.0)
    assert (y["unit"], y["missing"]) == ("deg", 0)
    assert list(found["signals"]) == ["y"]
    assert len(found["signals"]["y"]["x"]) == pytest.approx(23, abs=1)
    for name in ("../outside.csv", "no.csv", ""):
        assert ui.ask("POST", "/api/data", {"name": name}).status == 404
    (ui.folder / "bare.csv").write_text("u,y\n0,1\n1,2\n2,3\n")
    answer = ui.ask("POST", "/api/data", {"name": "bare.csv"})
    assert (answer.status, "dt" in answer.json["message"]) == (422, True)
    assert ui.ask("POST", "/api/data", {"name": "bare.csv", "dt": 0.5}).json["time"]["end"] == 1.0
    (ui.folder / "words.csv").write_text("nothing but words\n")
    assert ui.ask("POST", "/api/data", {"name": "words.csv"}).status == 422


def test_a_table_of_a_frequency_response_is_shown_and_fitted_as_one(ui: Ui) -> None:
    f = np.geomspace(0.01, 10.0, 25)
    value = 1.0 / (2j * np.pi * f + 1.0)
    rows = zip(f, np.abs(value), np.degrees(np.angle(value)), strict=True)
    lines = ["frequency [Hz],gain,phase [deg]", *(",".join(map(repr, map(float, row))) for row in rows)]
    (ui.folder / "response.csv").write_text("\n".join(lines))
    (curve,) = ui.ask("POST", "/api/data", {"name": "response.csv"}).json["curves"]
    assert curve["re"] == pytest.approx(value.real.tolist())
    full = ui.ended(ui.begin("fit", "response.csv", order="1"))
    assert full["state"] == "done", full["failure"]
    assert full["record"]["A"] == [[pytest.approx(-1.0, rel=1e-4)]]
    measured, fitted = full["curves"]
    assert (measured["kind"], fitted["kind"]) == ("measured", "linear")
    assert fitted["im"] == pytest.approx(measured["im"], rel=1e-3)


def test_a_model_is_identified_from_a_file(ui: Ui) -> None:
    full = ui.ended(ui.begin("identify", "lag.csv", inputs="u", outputs="y", order="1"))
    assert full["state"] == "done", full["failure"]
    (pole,) = full["record"]["poles"]
    assert pole[0] == pytest.approx(POLE, abs=1e-6)
    (curve,) = full["curves"]
    at = np.array(curve["frequency_hz"])
    z = np.exp(2j * np.pi * at * DT)
    found = np.array(curve["re"]) + 1j * np.array(curve["im"])
    assert np.abs(found - (1.0 - POLE) / (z - POLE)).max() < 1e-4
    wrong = {"command": "identify", "subject": ["../outside.csv"], "values": {}}
    assert ui.ask("POST", "/api/works", wrong).status == 404
    other = {"command": "identify", "subject": ["lag.csv"], "values": {"validation": "../outside.csv"}}
    assert "not in this folder" in ui.ask("POST", "/api/works", other).json["fields"]["validation"]


# -- studies --------------------------------------------------------------------------------------------

STUDY = f"""
{REST_STUDY}
[[requirements]]
name = "more"
analysis = "rest"
kind = "value"
path = "y.y"
max = 1.5
"""


def checked(ui: Ui, text: str) -> dict[str, list[dict[str, object]]]:
    answer = ui.ask("POST", "/api/study", {"name": "study.toml", "text": text})
    assert answer.status == 200, answer.body
    found: dict[str, list[dict[str, object]]] = answer.json
    return found


def test_a_draft_is_checked_line_by_line(ui: Ui) -> None:
    found = checked(ui, STUDY)
    assert found["mistakes"] == []
    assert [(r["name"], r["kind"], r["line"]) for r in found["requirements"]] == [
        ("gain", "value", 9),
        ("more", "value", 16),
    ]
    assert found["analyses"] == [{"name": "rest", "command": "trim"}]
    wrong = checked(ui, STUDY.replace("max = 1.5", "maxx = 1.5").replace('command = "trim"', 'command = "trimm"'))
    assert sorted(m["line"] for m in wrong["mistakes"]) == [5, 21]  # type: ignore[type-var]
    assert all("\n" not in str(m["message"]) for m in wrong["mistakes"])
    assert checked(ui, "[analyses")["mistakes"]
    for text in (
        STUDY.replace("fmu:FirstOrderLag", "../other.fmu"),
        STUDY.replace("fmu:FirstOrderLag", "../outside.csv"),
    ):
        assert ui.ask("POST", "/api/study", {"name": "study.toml", "text": text}).status == 404
    assert ui.ask("POST", "/api/study", {"name": "../study.toml", "text": STUDY}).status == 404
    assert "requirements" in ui.get("/api/study/schema")["properties"]


def test_a_study_runs_with_verdicts_that_come_one_by_one_and_outlives_the_server(tmp_path: Path) -> None:
    folder = tmp_path / "root"
    folder.mkdir()
    (folder / "study.toml").write_text(STUDY)
    with browser_workbench(folder) as server:
        number = server.begin("run", "study.toml")
        full = server.ended(number)
        assert (full["state"], full["well"]) == ("done", False)
        rows = {row["name"]: row["verdict"] for point in full["points"] for row in point["requirements"]}
        assert rows == {"gain": "passed", "more": "violated"}
        assert full["line"] == "workbench run study.toml"
        assert [r["passed"] for r in full["record"]["requirements"]] == [True, False]
        page = server.get(f"/api/works/{number}/page")
        report = server.ask("GET", f"/api/works/{number}/report.html")
        assert report.status == 200
        assert server.ask("GET", f"/api/works/{number}/data.csv").body.startswith(b"requirement,")
        server.process.kill()
    with browser_workbench(folder) as server:
        again = server.get(f"/api/works/{number}")
        assert again["record"] == full["record"]
        assert again["points"] == full["points"]
        assert server.get(f"/api/works/{number}/page") == page
        assert server.ask("GET", f"/api/works/{number}/report.html").body == report.body
        assert server.ended(server.begin("run", "study.toml"))["record"]["reused"] == 1


def test_a_draft_does_not_replace_what_was_changed_meanwhile(ui: Ui) -> None:
    (ui.folder / "own.toml").write_text(STUDY)
    sent = {"name": "own.toml", "text": STUDY.replace("2.5", "3.5"), "was": STUDY}
    (ui.folder / "own.toml").write_text(STUDY.replace("2.5", "4.5"))
    answer = ui.ask("POST", "/api/text", sent)
    assert (answer.status, answer.json["message"]) == (409, "own.toml was changed meanwhile")
    (ui.folder / "own.toml").write_text(STUDY)
    assert ui.ask("POST", "/api/text", sent).status == 200
    assert (ui.folder / "own.toml").read_text() == sent["text"]


# -- FMUs -----------------------------------------------------------------------------------------------


def test_an_fmu_is_made_of_what_was_found_and_overwrites_nothing(ui: Ui) -> None:
    number = ui.begin("lin", "fmu:FirstOrderLag")
    ui.ended(number)
    assert ui.ask("POST", f"/api/works/{number}/keep", {"name": "lin.json"}).status == 200
    (kept,) = [f for f in ui.get("/api/files")["files"] if f["name"] == "lin.json"]
    assert (kept["kind"], kept["command"]) == ("record", "lin")
    (ui.folder / "there.fmu").write_bytes(b"precious")
    for out, words in (("there.fmu", "exists already"), ("../x.fmu", "not in this folder"), ("", "needed")):
        asked = {"command": "export", "subject": ["lin.json"], "values": {"out": out, "platforms": "host"}}
        answer = ui.ask("POST", "/api/works", asked)
        assert (answer.status, words in answer.json["fields"]["out"]) == (422, True), answer.body
    assert (ui.folder / "there.fmu").read_bytes() == b"precious"
    full = ui.ended(ui.begin("export", "lin.json", out="made.fmu", name="no name", platforms="host"))
    assert full["state"] == "failed"
    assert "no name" in full["failure"]["message"]
    assert not (ui.folder / "made.fmu").exists()

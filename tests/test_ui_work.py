"""Work that the server does for a browser: what it gives, and what is kept of it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from urllib.parse import quote

import pytest

import workbench as wb
from tests.hostile_fmus import build_hostile
from tests.ui_server import POINTS, Ui, browser_workbench
from workbench.study.read import read_study

pytest.importorskip("starlette", reason="the extra 'ui' is not installed")


@pytest.fixture(scope="module")
def ui(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Ui]:
    with browser_workbench(tmp_path_factory.mktemp("root")) as server:
        yield server


# -- work ---------------------------------------------------------------------------------------------


def test_what_is_measured_is_what_the_function_measures(ui: Ui) -> None:
    number = ui.begin("nfr", "Rudder.fmu", **POINTS)
    full = ui.ended(number)
    assert full["state"] == "done", full["failure"]
    assert full["line"] == "workbench nfr Rudder.fmu --input=delC --output=del --freq=1,2,4 --amplitude=1"
    assert full["call"].splitlines()[0] == "model = wb.load('Rudder.fmu', tolerance=1e-08)"
    (curve,) = full["curves"]
    with wb.load("fmu:Rudder", tolerance=1e-8) as model:  # as the command opens it
        result = wb.nfr(model, "delC", "del", [1.0, 2.0, 4.0], [1.0])
    assert curve["re"] == result.response[0].real.tolist()
    assert curve["im"] == result.response[0].imag.tolist()
    assert all(abs(offset) < 1e-6 for offset in result.offset[0])  # nothing but rounding
    assert all(words.startswith("<") for words in curve["offset"])
    assert [p["frequency"] for p in sorted(full["points"], key=lambda p: p["frequency"])] == [1.0, 2.0, 4.0]
    for path, kind in {"report.html": "text/html", "picture.svg": "image/svg", "data.csv": "text/csv"}.items():
        answer = ui.ask("GET", f"/api/works/{number}/{path}")
        assert answer.status == 200
        assert answer.headers["content-type"].startswith(kind)
        assert len(answer.body) > 200
    assert ui.get(f"/api/works/{number}/data.json")["frequency_hz"] == [1.0, 2.0, 4.0]


def test_the_call_does_the_same(ui: Ui, monkeypatch: pytest.MonkeyPatch) -> None:
    full = ui.ended(ui.begin("nfr", "Rudder.fmu", **POINTS))
    monkeypatch.chdir(ui.folder)
    names: dict[str, object] = {"wb": wb}
    exec(full["call"], names)  # noqa: S102 - what a person would copy
    result = names["result"]
    assert isinstance(result, wb.NfrResult)
    assert result.response[0].real.tolist() == full["curves"][0]["re"]


def test_fields_are_told_what_is_wrong(ui: Ui) -> None:
    values = {"input": "delC", "output": "", "band": "0.5", "amplitudes": "x", "errcrit": "-1", "nonsense": "1"}
    answer = ui.ask("POST", "/api/works", {"command": "nfr", "subject": ["fmu:Rudder"], "values": values})
    assert answer.status == 422
    assert set(answer.json["fields"]) == {"output", "band", "amplitudes", "errcrit", "nonsense"}
    assert answer.json["fields"]["band"] == "'0.5' is not of the form LO:HI, as in 0.1:10 [Hz]"


@pytest.mark.parametrize("body", [b"", b"[", b"[1]", b"null", b"[" * 5000, b"{}" * 5, "ü".encode("latin-1")])
def test_nonsense_is_one_line(ui: Ui, body: bytes) -> None:
    answer = ui.ask("POST", "/api/works", body)
    assert answer.status == 422
    assert len(answer.json["message"].splitlines()) == 1


def test_other_commands_are_not_offered(ui: Ui) -> None:
    for command in ("blocks", "compare", "reproduce", "schema", "nonsense", None):
        answer = ui.ask("POST", "/api/works", {"command": command, "subject": ["fmu:Rudder"], "values": {}})
        assert answer.status == 422
        assert "not offered here" in answer.json["message"]


def test_a_crash_is_a_message(ui: Ui) -> None:
    fmu = build_hostile(ui.folder, "segfault")
    full = ui.ended(ui.begin("simulate", fmu.name, stop="1"))
    assert full["state"] == "failed"
    assert full["failure"]["kind"] == "crashed"
    assert "segmentation fault" in full["failure"]["message"]
    assert ui.ended(ui.begin("trim", "fmu:Rudder"))["state"] == "done"


def test_work_is_stopped_and_keeps_what_it_has(ui: Ui) -> None:
    band = {"band": "0.01:10", "ratio": "1.01", "method": "settle", "errcrit": "1e-7", "max_periods": "100"}
    number = ui.begin("nfr", "fmu:Rudder", input="delC", output="del", amplitudes="0.1,1,4,8", **band)
    for event in ui.events():
        if event["work"] == number and event["event"] == "progress":
            break
    assert ui.ask("POST", f"/api/works/{number}/stop", {}).status == 200
    full = ui.ended(number)
    assert full["state"] == "stopped"
    assert 1 <= len(full["points"]) < len(full["record"]["frequency_hz"])
    assert full["curves"]


def test_a_page_that_comes_back_is_told_what_it_missed(ui: Ui) -> None:
    number = ui.begin("nfr", "fmu:Rudder", **POINTS)
    all_of_it = list(ui._until(number))
    assert [e["id"] for e in all_of_it] == list(range(1, len(all_of_it) + 1))
    middle = all_of_it[-3]["id"]
    again = [next(stream) for stream in [ui.events(middle)] for _ in range(2)]
    assert again == all_of_it[-2:]


def test_what_a_store_holds_is_shown(ui: Ui) -> None:
    full = ui.ended(ui.begin("nfr", "Rudder.fmu", **POINTS, store="kept"))
    (curve,) = ui.get("/api/store?name=kept")["curves"]
    assert curve["re"] == full["curves"][0]["re"]
    assert curve["frequency_hz"] == [1.0, 2.0, 4.0]
    assert curve["settings"]["input"] == "delC"
    for name, status in {"none": 404, "..": 404, "Rudder.fmu": 422, "": 404}.items():
        assert ui.ask("GET", f"/api/store?name={name}").status == status


def test_what_a_page_tries_is_in_no_study_until_it_is_kept(ui: Ui) -> None:
    asked = {"command": "trim", "subject": ["fmu:Rudder"], "values": {"u0": ["delC=3"]}, "aside": True}
    number = ui.ask("POST", "/api/works", asked).json["number"]
    assert ui.ended(number)["aside"]
    assert "delC=3" not in ui.ask("GET", "/api/study.toml").body.decode()
    assert ui.ask("POST", f"/api/works/{number}/keep", {"name": "three.json"}).status == 200
    assert "delC=3" in ui.ask("GET", "/api/study.toml").body.decode()
    (point,) = [file for file in ui.get("/api/files")["files"] if file["name"] == "three.json"]
    assert point == {"name": "three.json", "kind": "point", "command": "trim", "model": "Rudder"}


def test_a_file_that_is_there_is_not_overwritten_by_a_record(ui: Ui) -> None:
    (ui.folder / "precious.json").write_text('{"work": "of years"}')
    number = ui.ask("POST", "/api/works", {"command": "trim", "subject": ["fmu:Rudder"], "values": {}}).json["number"]
    ui.ended(number)
    answer = ui.ask("POST", f"/api/works/{number}/keep", {"name": "precious.json"})
    assert (answer.status, answer.json["message"]) == (409, "precious.json exists already; choose another name")
    assert (ui.folder / "precious.json").read_text() == '{"work": "of years"}'
    assert ui.ask("POST", f"/api/works/{number}/keep", {"name": "another.json"}).status == 200


@pytest.mark.parametrize("digits", ["9" * 5000, "1" * 19, "²"])
def test_numbers_of_very_many_digits_are_told(ui: Ui, digits: str) -> None:
    for path in (f"/api/works/{quote(digits)}", f"/api/works/{quote(digits)}/report.html"):
        assert ui.ask("GET", path).status == 404
    for path in ("stop", "keep"):
        assert ui.ask("POST", f"/api/works/{quote(digits)}/{path}", {}).status == 404
    for name, value in (("frequencies", digits), ("errcrit", digits), ("max_periods", digits)):
        asked = {"command": "nfr", "subject": ["fmu:Rudder"], "values": {**POINTS, name: value}}
        answer = ui.ask("POST", "/api/works", asked)
        assert answer.status in {201, 422}, name
        if answer.status == 201:
            assert ui.ended(answer.json["number"])["state"] in {"failed", "done"}
    for body in (digits, f'{{"name": {digits}}}'):
        assert ui.ask("POST", "/api/text", body.encode()).status == 422


def test_the_call_has_no_empty_options(ui: Ui) -> None:
    call = ui.ended(ui.begin("lin", "fmu:Rudder", inputs=["delC"], outputs=["del"]))["call"]
    assert "{}" not in call


def test_a_session_is_a_study(ui: Ui, tmp_path: Path) -> None:
    ui.ended(ui.begin("nfr", "fmu:Rudder", **POINTS))
    ui.ended(ui.begin("lin", "fmu:Rudder", inputs=["delC"], outputs=["del"]))
    text = ui.ask("GET", "/api/study.toml").body.decode()
    file = ui.folder / "session.toml"
    file.write_text(text)
    study = read_study(file)
    assert {a.command.name for a in study.analyses.values()} >= {"nfr", "lin"}


def test_a_session_says_what_is_not_in_its_study(ui: Ui) -> None:
    lin = ui.begin("lin", "fmu:Rudder", inputs=["delC"], outputs=["del"])
    ui.ended(lin)
    delays = ui.begin("delays", "system:rudder_loop")
    ui.ended(delays)
    crashed = ui.begin("simulate", "fmu:FirstOrderLag", stop="-1")
    ui.ended(crashed)
    has, no_study, no_result, *_ = ui.ask("GET", "/api/study.toml").body.decode().splitlines()
    assert f"lin {lin}" in has
    assert f"delays {delays}" in no_study
    assert "one model" in no_study
    assert f"simulate {crashed}" in no_result
    assert not {f"delays {delays}", f"simulate {crashed}"} & set(has.split(": ")[1].rstrip(".").split(", "))


def test_a_session_without_analyses_is_no_study(tmp_path: Path) -> None:
    with browser_workbench(tmp_path) as server:
        asked = {"command": "check", "subject": ["fmu:FirstOrderLag"], "values": {}, "aside": True}  # as a card does
        assert server.ended(server.ask("POST", "/api/works", asked).json["number"])["state"] == "done"
        assert server.ask("GET", "/api/study.toml").body == b""


def test_what_turns_out_to_be_wrong_is_said_of_its_field(ui: Ui) -> None:
    failure = ui.ended(ui.begin("simulate", "fmu:FirstOrderLag", stop="-1"))["failure"]
    assert failure["field"] == "stop", failure
    assert "--" not in failure["message"]


# -- what records give ------------------------------------------------------------------------------


def test_every_analysis_has_sections_whose_pictures_are_data(ui: Ui) -> None:
    number = ui.begin("lin", "fmu:Rudder", inputs=["delC"])
    ui.ended(number)
    page = ui.get(f"/api/works/{number}/page")
    first, *others = page["sections"]
    panels = first["pictures"][0]["panels"]
    assert [p["y"]["label"] for p in panels] == ["gain [dB]", "phase [deg]", "step response [deg]"]
    assert [p["x"]["log"] for p in panels] == [True, True, False]
    assert all(len(c["x"]) == len(c["y"]) > 10 for p in panels for c in p["curves"])
    assert "Poles" in [section["title"] for section in others]
    least = min(page["modes"], key=lambda mode: mode["damping"])
    assert f"{least['hz']:.3g} Hz" in ui.get(f"/api/works/{number}")["brief"]
    assert all(abs(sum(share for _, share in mode["states"]) - 1.0) < 0.2 for mode in page["modes"])


def test_a_run_is_named_and_thrown_away(ui: Ui) -> None:
    number = ui.begin("trim", "fmu:Rudder")
    assert ui.ended(number)["brief"] == "at rest"
    assert ui.ask("POST", f"/api/works/{number}/name", {"name": " hover "}).status == 200
    assert ui.get(f"/api/works/{number}")["name"] == "hover"
    assert ui.ask("POST", f"/api/works/{number}/remove").status == 200
    assert ui.ended(ui.begin("info", "Rudder.fmu"))["number"] > number  # whose events are still told
    assert ui.ask("GET", f"/api/works/{number}").status == 404
    assert number not in [work["number"] for work in ui.get("/api/start")["works"]]


# -- what is kept -----------------------------------------------------------------------------


def test_what_is_finished_outlives_a_server_that_is_killed(tmp_path: Path) -> None:
    folder = tmp_path / "root"
    folder.mkdir()
    sweep = {"band": "0.5:10", "ratio": "1.1", "method": "settle", "errcrit": "1e-6", "max_periods": "60"}
    with browser_workbench(folder) as server:
        done = server.ended(server.begin("nfr", "fmu:Rudder", **POINTS))
        report = server.ask("GET", f"/api/works/{done['number']}/report.html").body
        cut = server.begin("nfr", "fmu:Rudder", input="delC", output="del", amplitudes="1,4", **sweep)
        for event in server.events():
            if event["work"] == cut and event["event"] == "progress" and event["done"] >= 4:
                break
        server.process.kill()
    with browser_workbench(folder) as server:
        again = server.get(f"/api/works/{done['number']}")
        (before,), (after,) = done["curves"], again["curves"]
        for part in ("re", "im", "error"):
            assert after[part] == pytest.approx(before[part], rel=1e-12, abs=1e-15)
        for name in ("state", "points", "line", "call", "seconds", "lead", "verdicts"):
            assert again[name] == done[name], name
        assert server.ask("GET", f"/api/works/{done['number']}/report.html").body == report
        listed = {work["number"]: work for work in server.get("/api/start")["works"]}
        assert (listed[cut]["state"], listed[cut]["goes_on"]) == ("stopped", True)
        assert 4 <= listed[cut]["done"] < listed[cut]["total"]  # points kept
        number = server.ask("POST", f"/api/works/{cut}/go-on", {}).json["number"]
        first = next(e for e in server.events() if e["work"] == number and e["event"] == "progress")
        assert first["done"] > 4  # those of before are not measured again
        assert server.ended(number)["state"] == "done"
        assert server.ask("POST", f"/api/works/{cut}/go-on", {}).status == 422
        assert server.get(f"/api/works/{cut}")["later"] == number
        assert {"work": cut, "later": number}.items() <= next(e for e in server.events() if e["work"] == cut).items()


def test_a_report_says_when_it_ran_for_how_long_and_by_which_call(ui: Ui) -> None:
    full = ui.ended(ui.begin("nfr", "Rudder.fmu", **POINTS))
    first = ui.ask("GET", f"/api/works/{full['number']}/report.html").body
    text = first.decode()
    assert "<dt>run</dt>" in text, (full["state"], full["failure"], text[:400])
    seconds = float(text.partition("<dt>run</dt><dd>")[2].partition(" s,")[0])
    assert 0.3 * full["seconds"] < seconds <= full["seconds"] + 0.01
    assert ui.ask("GET", f"/api/works/{full['number']}/report.html").body == first  # written once


def test_what_is_doubtful_is_said_beside_the_result(ui: Ui) -> None:
    full = ui.ended(ui.begin("lin", "fmu:AileronDamper"))
    doubts = full["record"]["doubtful"]
    assert doubts
    for doubt in doubts:
        assert any(v["tone"] == "watch" and doubt["reason"] in v["text"] for v in full["verdicts"])
    assert full["chosen"]
    assert not any("chosen by auto" in text for text in full["remarks"])

"""The server of the browser workbench: who may speak to it, what it opens, what work it does."""

from __future__ import annotations

import json
import math
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import quote

import pytest

import workbench as wb
from tests.hostile_fmus import build_hostile
from tests.platforms import posix_signals
from tests.programs import ended
from tests.ui_server import Ui, browser_workbench
from workbench.cli.app import run
from workbench.study.read import read_study

pytest.importorskip("starlette", reason="the extra 'ui' is not installed")

POINTS = {"input": "delC", "output": "del", "frequencies": "1,2,4", "amplitudes": "1"}


@pytest.fixture(scope="module")
def ui(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Ui]:
    folder = tmp_path_factory.mktemp("root") / "inside"
    folder.mkdir()
    (folder.parent / "outside.fmu").write_bytes(b"nothing")
    if hasattr(os, "symlink"):
        (folder / "link.fmu").symlink_to(folder.parent / "outside.fmu")
    with browser_workbench(folder) as server:
        yield server


# -- who may speak to it ------------------------------------------------------------------------------


@pytest.mark.parametrize("path", ["/", "/api/start", "/api/works/1", "/static/main.js", "/api/events"])
@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "evil.example"},
        {"Host": "evil.example:80"},
        {"Host": ""},
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Cookie": ""},
        {"Cookie": "workbench=x"},
    ],
    ids=str,
)
def test_strangers_are_refused(ui: Ui, path: str, headers: dict[str, str]) -> None:
    assert ui.ask("GET", path, **headers).status in {400, 403}


def test_a_page_from_elsewhere_cannot_begin_work(ui: Ui) -> None:
    asked = {"command": "nfr", "subject": ["fmu:Rudder"], "values": POINTS}
    for origin in ("", "http://evil.example", f"https://{ui.host}", f"http://{ui.host}.evil.example"):
        assert ui.ask("POST", "/api/works", asked, Origin=origin).status == 403
    for wrong in ("/?token=wrong", "/?token=", "/"):
        assert ui.ask("GET", wrong, Cookie="").status == 403


@pytest.mark.parametrize(
    "path",
    [
        "/api/works", "/api/works/1/stop", "/api/works/1/keep", "/api/works/1/name", "/api/works/1/remove", "/api/text",
        "/api/diagram", "/api/tune",
    ],
)  # fmt: skip
def test_what_changes_something_is_taken_from_this_page_only(ui: Ui, path: str) -> None:
    assert ui.ask("POST", path, {}, Origin="").status == 403
    assert ui.ask("POST", path, {}, Origin=f"http://{ui.host}.evil.example").status == 403
    assert ui.ask("POST", path, {}, Cookie="").status == 403
    if path != "/api/text":  # which is read, too
        assert ui.ask("GET", path).status == 405


def test_the_token_counts_in_the_address_alone(ui: Ui) -> None:
    token = ui.address.partition("token=")[2].partition("#")[0]
    for headers in ({"Referer": ui.address}, {"Authorization": f"Bearer {token}"}, {"X_Token": token}):
        assert ui.ask("GET", "/api/start", Cookie="", **headers).status == 403
    assert ui.ask("POST", "/api/text", {"token": token, "name": "x.toml", "text": ""}, Cookie="").status == 403


def test_every_answer_says_what_a_page_may_load(ui: Ui) -> None:
    for path in ("/", "/static/main.js", "/api/start", "/nothing"):
        headers = ui.ask("GET", path).headers
        assert "default-src 'none'" in headers["content-security-policy"]
        assert "unsafe" not in headers["content-security-policy"]
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["referrer-policy"] == "no-referrer"
    cookie = ui.ask("GET", f"/?{ui.address.partition('?')[2]}").headers["set-cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie


def test_only_this_machine_is_answered(ui: Ui) -> None:
    port = int(ui.host.partition(":")[2])
    with socket.socket() as probe:
        probe.settimeout(5)
        assert probe.connect_ex(("127.0.0.1", port)) == 0
    names = {found[4][0] for found in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)}
    for name in names - {"127.0.0.1"}:
        with socket.socket() as probe:
            probe.settimeout(5)
            assert probe.connect_ex((name, port)) != 0


# -- what it opens ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name",
    ["../outside.fmu", "link.fmu", "/etc/passwd", "..", "", "no.fmu", "\0", "x" * 5000, "./../inside/../outside.fmu"],
)
def test_nothing_outside_the_folder_is_opened(ui: Ui, name: str) -> None:
    for command in ("info", "nfr", "check"):
        answer = ui.ask("POST", "/api/works", {"command": command, "subject": [name], "values": POINTS})
        assert answer.status == 404, (command, answer.body)
        assert "not in this folder" in answer.json["message"]


def test_a_file_option_stays_inside_too(ui: Ui) -> None:
    for option in ("at", "store"):
        asked = {"command": "nfr", "subject": ["Rudder.fmu"], "values": {**POINTS, option: "../elsewhere"}}
        answer = ui.ask("POST", "/api/works", asked)
        assert answer.status == 422
        assert "not in this folder" in answer.json["fields"][option]


def test_a_file_that_an_option_names_stays_inside(ui: Ui) -> None:
    (ui.folder.parent / "outside.csv").write_text("0,0\n1,1\n")
    (ui.folder / "inside.csv").write_text("0,0\n1,1\n")
    table = {"stop": "1", "inputs": ["delC=../outside.csv"]}
    answer = ui.ask("POST", "/api/works", {"command": "simulate", "subject": ["Rudder.fmu"], "values": table})
    assert answer.json["fields"] == {"inputs": "../outside.csv: not in this folder"}
    full = ui.ended(ui.begin("simulate", "Rudder.fmu", stop="1", inputs=["delC=inside.csv"]))
    assert full["state"] == "done", full["failure"]
    design = {"block": "damper", "target": "aircraft.inner_aileron", "orders": "36,29", "actuator": "../outside.fmu"}
    asked = {"command": "feed-forward", "subject": ["system:failed_aileron"], "values": design}
    assert ui.ask("POST", "/api/works", asked).json["fields"] == {"actuator": "../outside.fmu: not in this folder"}


@pytest.mark.parametrize("part", ['"../outside.fmu"', '"link.fmu"', '{linear = "../outside.json"}'])
def test_a_system_has_no_parts_outside_of_the_folder(ui: Ui, part: str) -> None:
    matrices = {"A": [[-1.0]], "B": [[1.0]], "C": [[1.0]], "D": [[0.0]]}
    (ui.folder.parent / "outside.json").write_text(json.dumps(matrices))
    (ui.folder / "leads_out.toml").write_text(f"[components]\nplant = {part}\n")
    (ui.folder / "nested.toml").write_text('[components]\ninner = "leads_out.toml"\n')
    for system in ("leads_out.toml", "nested.toml"):
        for command in ("info", "loop"):
            asked = {"command": command, "subject": [system], "values": {"open": "plant.y"}}
            answer = ui.ask("POST", "/api/works", asked)
            assert answer.status == 404
            assert "plant is not in this folder" in answer.json["message"]


@pytest.mark.parametrize(
    "path",
    [
        "/static/../app.py", "/static/%2e%2e/app.py", "/static/..%2fapp.py", "/static/%2e%2e%2f%2e%2e%2f__init__.py",
        "/static/..%5capp.py", "/static/%252e%252e/app.py", "/static//etc/passwd", "/static/%2fetc%2fpasswd",
        "/static/%00", "/static/main.js%00.css", "/static/", "//etc/passwd", "/..", "/%00",
        "/api/text?name=%2e%2e%2foutside.fmu", "/api/text?name=..%2foutside.fmu", "/api/text?name=%2fetc%2fpasswd",
        "/api/text?name=x%00.toml", "/api/text?name=link.fmu", "/api/text?name=system:..%2f..%2fpyproject",
        "/api/store?name=%2e%2e", "/api/store?name=%00", "/api/works/1%2f..%2f2",
    ],
)  # fmt: skip
def test_a_path_cannot_lead_out_of_the_folder(ui: Ui, path: str) -> None:
    answer = ui.ask("GET", path)
    assert answer.status in {404, 422}, answer.body
    assert b"root:" not in answer.body
    assert b"app_of" not in answer.body


def test_a_study_has_no_files_outside_of_the_folder(ui: Ui) -> None:
    (ui.folder.parent / "outside.csv").write_text("0,0\n1,1\n")
    for line in (
        'models.plant = "../outside.fmu"',
        'analyses.a = {command = "simulate", inputs = ["u=../outside.csv"]}',
    ):
        (ui.folder / "study_out.toml").write_text(f"analyses.b = {{}}\n{line}\n")
        answer = ui.ask("POST", "/api/works", {"command": "envelope", "subject": ["study_out.toml"], "values": {}})
        assert answer.status == 404, answer.body
        assert "is not in this folder" in answer.json["message"]


def test_a_diagram_reads_nothing_outside_of_the_folder(ui: Ui) -> None:
    for part in ('"../outside.fmu"', '{linear = "../outside.fmu"}', '"link.fmu"', '{linear = "/etc/passwd"}'):
        answer = ui.ask("POST", "/api/diagram", {"name": "x.toml", "text": f"[components]\nplant = {part}\n"})
        assert answer.status == 200
        assert "not in this folder" in answer.json["wrong"][0]
    assert ui.ask("POST", "/api/diagram", {"name": "../x.toml", "text": "[components]"}).status == 404


@pytest.mark.parametrize("name", ["../x.toml", "/x.toml", "x.txt", "x.fmu", "", "\0.toml"])
def test_only_texts_are_written_and_only_inside(ui: Ui, name: str) -> None:
    assert ui.ask("POST", "/api/text", {"name": name, "text": "x"}).status in {404, 422}
    assert ui.ask("POST", "/api/works/1/keep", {"name": name}).status in {404, 422}


def test_what_there_is_is_listed(ui: Ui) -> None:
    found = {file["name"]: file["kind"] for file in ui.get("/api/start")["files"]}
    assert found["Rudder.fmu"] == "fmu"
    assert found["system:rudder_loop"] == "system"
    assert found["study:rudder_loop"] == "study"


def test_a_text_is_not_replaced_unasked(ui: Ui) -> None:
    first = {"name": "own.toml", "text": "[components]\nname = 'a'"}
    assert ui.ask("POST", "/api/text", first).status == 200
    assert ui.ask("POST", "/api/text", {**first, "text": "[components]\nname = 'b'"}).status == 409
    assert ui.get("/api/text?name=own.toml")["text"] == first["text"]
    assert ui.ask("POST", "/api/text", {**first, "text": "[components]\nname = 'b'", "replace": True}).status == 200
    assert ui.get("/api/text?name=own.toml")["text"] == "[components]\nname = 'b'"
    # What is neither a system nor a study was not written here, and is not replaced at all.
    (ui.folder / "foreign.toml").write_text("[project]\n")
    answer = ui.ask("POST", "/api/text", {**first, "name": "foreign.toml", "replace": True})
    assert (answer.status, (ui.folder / "foreign.toml").read_text()) == (422, "[project]\n")


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
    for command in ("build", "export", "reproduce", "run", "nonsense", None):
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
    assert point == {"name": "three.json", "kind": "point", "model": "Rudder"}


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


def test_the_server_begins_without_what_analyses_need() -> None:
    script = "import sys, workbench.ui.app; print({'control', 'scipy', 'fmpy', 'matplotlib'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


def test_a_session_is_a_study(ui: Ui, tmp_path: Path) -> None:
    ui.ended(ui.begin("nfr", "fmu:Rudder", **POINTS))
    ui.ended(ui.begin("lin", "fmu:Rudder", inputs=["delC"], outputs=["del"]))
    text = ui.ask("GET", "/api/study.toml").body.decode()
    file = ui.folder / "session.toml"
    file.write_text(text)
    study = read_study(file)
    assert {a.command.name for a in study.analyses.values()} >= {"nfr", "lin"}


def test_a_session_without_analyses_is_no_study(tmp_path: Path) -> None:
    with browser_workbench(tmp_path) as server:
        asked = {"command": "check", "subject": ["fmu:FirstOrderLag"], "values": {}, "aside": True}  # as a card does
        assert server.ended(server.ask("POST", "/api/works", asked).json["number"])["state"] == "done"
        assert server.ask("GET", "/api/study.toml").body == b""


def test_what_turns_out_to_be_wrong_is_said_of_its_field(ui: Ui) -> None:
    failure = ui.ended(ui.begin("simulate", "fmu:FirstOrderLag", stop="-1"))["failure"]
    assert failure["field"] == "stop", failure
    assert "--" not in failure["message"]


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


# -- beginning and ending -----------------------------------------------------------------------------


@posix_signals
@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
def test_what_runs_ends_with_the_server(tmp_path: Path, how: signal.Signals) -> None:
    with browser_workbench(tmp_path) as server:
        server.begin("simulate", "fmu:Rudder", stop="1e9")
        for event in server.events():
            if event["event"] == "progress":
                break
        words = ["ps", "-o", "pid=", "--ppid", str(server.process.pid)]
        children = subprocess.run(words, capture_output=True, text=True, check=False)
        pids = [int(pid) for pid in children.stdout.split()]
        assert pids
        server.process.send_signal(how)
        out, err = server.process.communicate(timeout=60)
        assert (out, err) == ("", "")
        assert all(ended(pid) for pid in pids)


def test_a_port_that_is_taken_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        words = [sys.executable, "-m", "workbench", "ui", "--no-browser", "--port", str(port)]
        done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith(f"workbench: ui: port {port} cannot be used: ")
    assert len(done.stderr.splitlines()) == 1


def test_what_is_not_there_is_not_served(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["ui", "no such folder", "--no-browser"]) == 2
    assert capsys.readouterr().err == "workbench: no such folder: no such file or folder\n"


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
        number = server.ask("POST", f"/api/works/{cut}/go-on", {}).json["number"]
        first = next(e for e in server.events() if e["work"] == number and e["event"] == "progress")
        assert first["done"] > 4  # those of before are not measured again
        assert server.ended(number)["state"] == "done"
        assert server.ask("POST", f"/api/works/{cut}/go-on", {}).status == 422


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

"""The server of the browser workbench: who may speak to it, what it opens, how it begins and ends."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.platforms import posix_signals
from tests.programs import ended
from tests.ui_server import POINTS, Ui, browser_workbench
from workbench.cli.app import run

pytest.importorskip("starlette", reason="the extra 'ui' is not installed")


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


def test_the_server_begins_without_what_analyses_need() -> None:
    script = "import sys, workbench.ui.app; print({'control', 'scipy', 'fmpy', 'matplotlib'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"

"""`--report` of every command: a page that stands alone, says which FMU, and holds what `--json` holds."""

from __future__ import annotations

import hashlib
import json
import shlex
import shutil
from pathlib import Path

import pytest

from tests.command_lines import LAG_FMU, LINES, LOOP, write_files
from tests.report_pages import PageReader, check_page_file, data_of, facts_of_page
from workbench.build.fmu import BuildResult
from workbench.build.page import build_page
from workbench.build.toolchain import host_only
from workbench.cli.app import run
from workbench.cli.program import COMMANDS as EVERY
from workbench.cli.program import program
from workbench.fmi.archive import locate
from workbench.show.page import write_page

LAG = hashlib.sha256(locate("fmu:FirstOrderLag").read_bytes()).hexdigest()

COMMANDS = {
    **{name: line.split() for name, (line, _) in LINES.items()},
    "info of a system": ["info", "loop.toml"],
    "simulate a sine": ["simulate", LAG_FMU, "--stop", "1", "--input", "u=sine:amplitude=1,frequency=2"],
    "lin of a system": ["lin", "braked.toml", "--inputs", "u"],
    "lin --compare": ["lin", LAG_FMU, "--compare", "--freq", "0.1,1"],
    "lin --snapshot": ["lin", LAG_FMU, "--snapshot", "0.5,1", "--input", "u=1"],
    "delays of none": ["check", "loop.toml", "--delays"],
    "limit-cycle from rest": ["limit-cycle", "loop.toml", "--block", "block", "--free-run", "30", "--set", "a.x=0.01"],
    "export of a system": ["build", "lags.toml", "--out", "out.fmu", "--step", "0.125"],
}
WITHOUT_FMU = {"identify", "export", "export of a system", "fit", "build", "compile", "blocks", "onset"}


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("report")
    write_files(path)
    return path


@pytest.fixture(autouse=True)
def folder(files: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    shutil.copytree(files, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("workbench.build.toolchain.PLATFORMS", host_only())
    return tmp_path


def report(arguments: list[str]) -> tuple[PageReader, dict[str, object]]:
    """Run a command with report and JSON; return the page and the JSON."""
    assert run([*arguments, "--report", "page.html", "--json", "out.json"]) in (0, 1)
    return check_page_file(Path("page.html")), json.loads(Path("out.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_writes_a_page(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = COMMANDS[name]
    page, written = report(arguments)
    assert data_of(page) == written
    facts = facts_of_page(page)
    assert facts["command"] == shlex.join(["workbench", *arguments, "--report", "page.html", "--json", "out.json"])
    assert "numpy" in facts["versions"]
    assert f"{written['seconds']:.3g} s, " in facts["run"]
    text = " ".join(e.text for e in page.elements)
    assert (LAG in text) == (name not in WITHOUT_FMU)
    shown = capsys.readouterr()
    assert "wrote page.html" in shown.out
    # What the command remarked on standard error stands on the page.
    remarks = [line.removeprefix("note: ") for line in shown.err.splitlines() if line.startswith("note: ")]
    items = {e.text for e in page.elements if e.tag == "li"}
    assert set(remarks) <= items
    assert "chosen by auto" not in shown.err + " ".join(items)  # once, beside the interface


def test_every_command_has_the_option() -> None:
    without = [n for n in EVERY if not any("--report" in p.opts for p in program(n).params)]
    assert without == ["schema", "ui"]  # one has no result, the other shows them


@pytest.mark.parametrize("name", ["simulate", "lin", "trim"])
def test_the_command_on_the_page_gives_the_same_again(name: str) -> None:
    page, first = report(COMMANDS[name])
    Path("out.json").unlink()
    again = shlex.split(facts_of_page(page)["command"])
    assert again[0] == "workbench"
    assert run(again[1:]) == 0
    second = json.loads(Path("out.json").read_text(encoding="utf-8"))
    assert {k: v for k, v in second.items() if k != "seconds"} == {k: v for k, v in first.items() if k != "seconds"}


def test_arguments_with_blanks_are_quoted() -> None:
    Path("my loop.toml").write_text(LOOP, encoding="utf-8")
    page, _ = report(["info", "my loop.toml"])
    assert facts_of_page(page)["command"].startswith("workbench info 'my loop.toml' --report")


def test_a_path_is_given_as_it_was_typed_and_shown_without_its_folder(folder: Path) -> None:
    (folder / "given.fmu").write_bytes(locate("fmu:FirstOrderLag").read_bytes())
    page, _ = report(["info", str(folder / "given.fmu")])
    facts = facts_of_page(page)
    assert str(folder / "given.fmu") in facts["command"]
    assert facts["FMU"] == "given.fmu"
    assert facts["SHA-256"] == LAG


def test_two_commands_of_one_process_do_not_mix() -> None:
    report(COMMANDS["simulate"])
    page, _ = report(COMMANDS["info"])
    assert not [e for e in page.elements if e.tag == "li" and "interface" in e.text]


def test_failed_points_are_named_first() -> None:
    page, _ = report(["nfr", "lags.toml", "--input", "u", "--output", "y", "--freq", "0.1", "--amplitude", "1",
                      "--in-process", "--max-periods", "2", "--errcrit", "1e-15"])  # fmt: skip
    (strip,) = [e for e in page.elements if e.attributes.get("class", "").startswith("summary")]
    words = [e.text for e in page.elements if e.attributes.get("class", "").startswith("word ")]
    assert strip.attributes["class"] == "summary watch"
    assert words[0] == "averaged"


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("page.txt", "--report: 'page.txt' must end in .html"),
        ("none/page.html", "--report: the folder 'none' does not exist"),
        (".", "--report: '.' is a folder; name a file in it"),
    ],
)
@pytest.mark.parametrize("name", ["info", "simulate", "limit-cycle", "export"])
def test_a_wrong_path_is_one_line(name: str, path: str, message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run([*COMMANDS[name], "--report", path]) == 2
    assert capsys.readouterr().err == f"workbench: {message}\n"


def test_what_was_built_is_listed_with_hashes(folder: Path) -> None:
    file = folder / "X.fmu"
    file.write_bytes(b"fmu")
    result = BuildResult("X", (file, folder / "gone.fmu"), ("x86_64-linux",), stiff=False, n_states=2)
    write_page(build_page(result), folder / "p.html")
    cells = [e.text for e in check_page_file(folder / "p.html").elements if e.tag == "td"]
    assert hashlib.sha256(b"fmu").hexdigest() in cells
    assert cells[-3:] == ["gone.fmu", "gone", "gone"]

"""The workbench in the CI of a repository: GitHub's action, GitLab's template, the hook before a commit."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pytest
import yaml  # type: ignore[import-untyped]

import workbench as wb
from tests.doc_pages import first_column, text_of
from tests.hostile_fmus import build_broken, build_hostile
from tests.platforms import posix_shell
from workbench.cli.app import run
from workbench.cli.github import tell_error
from workbench.health.check.result import VERDICTS
from workbench.show.markdown import markdown_of
from workbench.show.page import Page, PageTable, Section
from workbench.show.verdicts import Verdict

ROOT = Path(__file__).parents[1]
SAMPLE = ROOT / "examples" / "ci"
QUICK = ["--only", "validation,runs,reset"]
ENVELOPE = """
[models]
lag = "fmu:FirstOrderLag"
[envelope]
parameters = {"lag.tau" = {discrete = [0.5, 1.0, 2.0]}}
[analyses.linear]
command = "lin"
model = "lag"
[[requirements]]
name = "quick"
analysis = "linear"
kind = "stability"
max = -0.6
"""


def read_yaml(path: Path) -> Any:  # noqa: ANN401 - whatever YAML holds
    return yaml.safe_load(path.read_text(encoding="utf-8"))


ACTION = read_yaml(ROOT / "action.yml")
(SCRIPT,) = (step["run"] for step in ACTION["runs"]["steps"] if step.get("name") == "Check and measure")
GITLAB = read_yaml(SAMPLE / "gitlab-ci.yml")["fmu"]


@pytest.fixture
def repository(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A repository as the documentation makes it: one FMU and one study."""
    shutil.copy(SAMPLE / "actuator_study.toml", tmp_path)
    shutil.copy(ROOT / "fmus" / "fmi2" / "Rudder.fmu", tmp_path / "actuator.fmu")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def step(script: str, folder: Path, variables: Mapping[str, str]) -> subprocess.CompletedProcess[str]:
    """Run lines of a CI as it does, with the workbench installed."""
    tools = folder / "bin"
    tools.mkdir(exist_ok=True)
    tool = tools / "workbench"
    tool.write_text(f'#!/bin/sh\nexec {sys.executable} -m workbench "$@"\n', encoding="utf-8")
    tool.chmod(0o755)
    known = {"PATH": f"{tools}:{os.environ['PATH']}", "PYTHONPATH": str(ROOT)}
    line = ["bash", "-e", "-o", "pipefail", "-c", script]
    env = {**os.environ, **known, **variables}
    return subprocess.run(line, cwd=folder, env=env, capture_output=True, text=True, check=False)


@pytest.fixture
def github(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder in which a job of GitHub runs."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    monkeypatch.setenv("GITHUB_WORKSPACE", str(tmp_path))
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(tmp_path / "summary.md"))
    return tmp_path


@posix_shell
def test_the_action_gives_a_verdict_reports_and_a_summary(repository: Path) -> None:
    given = read_yaml(SAMPLE / "github.yml")["jobs"]["fmu"]["steps"][-1]["with"]
    assert given.keys() <= ACTION["inputs"].keys()
    variables = {"FMUS": given["fmus"], "STUDIES": given["studies"], "REPORTS": ACTION["inputs"]["reports"]["default"]}
    github = {"GITHUB_ACTIONS": "true", "GITHUB_WORKSPACE": str(repository), "GITHUB_STEP_SUMMARY": "summary.md"}
    done = step(SCRIPT, repository, {**variables, **github})
    assert (done.returncode, "::error" in done.stderr) == (0, False), done.stderr
    assert sorted(p.suffix for p in (repository / "workbench-reports").glob("*.[hx]*")) == [".html"] * 2 + [".xml"] * 2
    summary = (repository / "summary.md").read_text(encoding="utf-8")
    assert re.findall("^## (.+)$", summary, re.MULTILINE) == ["Health card of Rudder", "actuator"]
    assert "✅ passed: 2 of 2" in summary


@posix_shell
def test_what_is_not_met_fails_the_job_and_stands_at_its_line(repository: Path) -> None:
    study = repository / "actuator_study.toml"
    study.write_text(study.read_text(encoding="utf-8").replace("max = 0.5 ", "max = 0.01"), encoding="utf-8")
    (repository / "broken.fmu").write_text("not an FMU", encoding="utf-8")
    variables = {"FMUS": "broken.fmu", "STUDIES": study.name, "REPORTS": "reports", "GITHUB_ACTIONS": "true"}
    done = step(SCRIPT, repository, variables | {"GITHUB_STEP_SUMMARY": "", "GITHUB_WORKSPACE": ""})
    assert done.returncode == 2
    number = study.read_text(encoding="utf-8").splitlines().index('name = "settling"') + 1
    errors = [line for line in done.stderr.splitlines() if line.startswith("::error")]
    assert re.match(r"::error file=broken\.fmu::broken\.fmu: ", errors[0])
    assert re.match(
        rf"::error file=actuator_study\.toml,line={number}::step settling: 0\.\d+ s, limit ≤ 0\.01 s", errors[1]
    )
    assert len(errors) == 2
    suite = ET.parse(repository / "reports" / "actuator_study.xml").getroot()  # noqa: S314 - we wrote it
    assert suite.attrib["failures"] == "1"


@posix_shell
def test_no_report_overwrites_another(repository: Path) -> None:
    studies = ["p/study.toml", "q/study.toml", "./study.toml", "p-study.toml", "fmus.toml", "study:study"]
    called = 'workbench() { echo "$4" | tee "$4"; }; '
    variables = {"FMUS": "a.fmu", "STUDIES": " ".join(studies), "REPORTS": "reports"}
    done = step(called + SCRIPT, repository, variables)
    written = done.stdout.split()
    assert written[:3] == ["reports/fmus.xml", "reports/p-study.xml", "reports/q-study.xml"], done.stderr
    assert len(list((repository / "reports").glob("[!.]*.xml"))) == len(written) == len(studies) + 1


@posix_shell
@pytest.mark.parametrize(("github", "head"), [("", ""), ("true", "::error::")])
@pytest.mark.parametrize("nothing", ["", " \n "])
def test_nothing_to_do_is_an_error(repository: Path, nothing: str, github: str, head: str) -> None:
    given = {"FMUS": nothing, "STUDIES": nothing, "OPTIONS": "", "REPORTS": "reports", "GITHUB_ACTIONS": github}
    done = step(SCRIPT, repository, given)
    line = f"{head}neither FMUs nor studies are named: nothing was checked\n"
    assert (done.returncode, done.stdout, done.stderr) == (2, "", line)


@posix_shell
def test_options_reach_the_check_as_words_and_no_shell_reads_them(repository: Path) -> None:
    called = 'workbench() { printf "<%s>" "$@"; }; '
    given = {"FMUS": "a.fmu b.fmu", "STUDIES": "", "OPTIONS": "--skip memory $(touch x); y", "REPORTS": "r"}
    done = step(called + SCRIPT, repository, given)
    assert done.stdout.startswith("<check><a.fmu><b.fmu><--skip><memory><$(touch><x);><y><--junit>"), done.stderr
    assert not (repository / "x").exists()


def test_a_study_without_requirements_is_a_warning(github: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (github / "s.toml").write_text('analyses.a = {command = "lin", model = "fmu:FirstOrderLag"}\n', encoding="utf-8")
    assert run(["run", str(github / "s.toml"), "--no-store"]) == 0
    assert "::warning::s: nothing is required: there is no verdict" in capsys.readouterr().err


def test_gitlab_runs_the_same_lines_and_finds_their_files() -> None:
    (script,) = GITLAB["script"]
    assert script == SCRIPT
    named = set(re.findall(r"\$\{?([A-Z_]+)", script)) - {"GITHUB_ACTIONS"}  # that is set by the one and not the other
    assert named == GITLAB["variables"].keys()
    assert GITLAB["artifacts"]["paths"] == ["$REPORTS"]
    assert GITLAB["artifacts"]["reports"]["junit"] == "$REPORTS/*.xml"


@pytest.mark.parametrize("name", ["github.yml", "pre-commit-config.yaml"])
def test_the_documentation_shows_the_examples(name: str) -> None:
    assert f"\n{(SAMPLE / name).read_text(encoding='utf-8')}```\n" in text_of("ci.md")


def test_the_documentation_names_every_input_of_the_action() -> None:
    assert first_column(text_of("ci.md")) == list(ACTION["inputs"])


@posix_shell
@pytest.mark.parametrize(
    ("version", "asked"), [("", "/the action"), ("1.0.0", "fmi-workbench==1.0.0")], ids=["its own", "another"]
)
def test_the_action_installs_its_own_version_or_another(version: str, asked: str, tmp_path: Path) -> None:
    (install,) = (s["run"] for s in ACTION["runs"]["steps"] if s.get("name") == "Install")
    done = step(f'python() {{ echo "$*"; }}; {install}', tmp_path, {"VERSION": version, "ACTION": "/the action"})
    assert done.stdout == f"-m pip install --quiet --no-compile {asked}\n"


def test_the_hook_checks_the_fmus_of_a_commit(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`pre-commit` passes all files that fit in one call."""
    (hook,) = read_yaml(ROOT / ".pre-commit-hooks.yaml")
    (used,) = read_yaml(SAMPLE / "pre-commit-config.yaml")["repos"]
    assert [h["id"] for h in used["hooks"]] == [hook["id"]]
    changed = ["models/lag.fmu", "rudder.fmu", "study.toml", "fmu.py"]
    files = [name for name in changed if re.search(hook["files"], name)]
    assert files == changed[:2]
    (tmp_path / "models").mkdir()
    shutil.copy(ROOT / "fmus" / "fmi2" / "FirstOrderLag.fmu", tmp_path / files[0])
    shutil.copy(ROOT / "fmus" / "fmi3" / "Rudder.fmu", tmp_path / files[1])
    program, *words = hook["entry"].split()
    assert program == "workbench"
    assert run([*words, *QUICK, *(str(tmp_path / name) for name in files)]) == 0
    assert "lag.fmu, rudder.fmu keep their promises" in capsys.readouterr().out


# -- several FMUs, and their verdicts one by one -----------------------------------------------------


def cases_in(path: Path) -> dict[str, str]:
    """Return how each case of a JUnit file came out, and the message."""
    root = ET.parse(path).getroot()  # noqa: S314 - we wrote it
    counted = {outcome: len(root.findall(f".//{outcome}")) for outcome in ("failure", "error", "skipped")}
    assert [int(root.attrib[key]) for key in ("failures", "errors", "skipped")] == list(counted.values())
    assert int(root.attrib["tests"]) == len(root.findall(".//testcase"))
    return {f"{c.attrib['classname']} {c.attrib['name']}": c[0].tag for c in root.iter("testcase")}


def test_several_fmus_have_one_card_with_a_case_for_each_check(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    build_hostile(tmp_path, "segfault-at-start")
    files = ["fmu:FirstOrderLag", "segfault-at-start.fmu", "system:rudder_loop"]
    card = wb.check(files, only=["validation", "runs"], interface="me")
    assert not card.passed
    assert [(line.component, line.name, line.outcome) for line in card.checks] == [
        (files[0], "validation", "passed"),
        (files[0], "runs", "passed"),
        (files[1], "validation", "passed"),
        (files[1], "runs", "failure"),
        (f"{files[2]} plant", "validation", "passed"),
        (f"{files[2]} plant", "runs", "passed"),
    ]
    assert [case.file for case in card.cases()] == [name for name in files for _ in range(2)]
    card.to_junit("junit.xml")
    suites = [s.attrib["name"] for s in ET.parse("junit.xml").getroot()]  # noqa: S314 - we wrote it
    assert suites == files
    assert list(cases_in(Path("junit.xml")).values()) == [
        c.outcome.replace("passed", "system-out") for c in card.cases()
    ]
    assert card.line("runs", "me", component=files[1]).verdict == "broken"


def test_a_name_that_begins_as_another_is_not_taken_for_it() -> None:
    line = wb.HealthLine(component="plants/b me", interface="me", name="runs", evidence="seen", verdict="broken")
    card = wb.HealthCard(
        model="plant, plants/b", source="plant, plants/b", sha256="", fmi_version="2.0", generation_tool="",
        interfaces=("me",), checks=(line,),
    )  # fmt: skip
    assert [case.file for case in card.cases()] == ["plants/b"]


def test_what_was_cut_off_is_an_error_and_what_does_not_apply_is_skipped() -> None:
    lines = [
        wb.HealthLine(interface="me", name="runs", evidence="seen", verdict=verdict, finished=finished)
        for verdict in VERDICTS
        for finished in (True, False)
    ]
    assert [c.outcome for c in lines] == [
        "skipped", "skipped", "passed", "error", "passed", "error", "failure", "failure"
    ]  # fmt: skip


def test_a_binary_that_cannot_be_loaded_is_told_once(github: Path, capsys: pytest.CaptureFixture[str]) -> None:
    build_broken(github, "broken-binary")
    words = ["check", "broken-binary.fmu", "--interface", "me", "--only", "runs,reset,determinism,processes"]
    assert run([*words, "--junit", "junit.xml"]) == 1
    assert sorted(cases_in(Path("junit.xml")).values()) == ["failure", "skipped", "skipped", "skipped"]
    assert capsys.readouterr().err.count("::error") == 1


def test_models_that_cannot_be_read_cost_the_others_no_verdict(
    github: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    github.joinpath("base.toml").touch()
    github.joinpath("pointer.fmu").write_text("version https://git-lfs.github.com/spec/v1\n", encoding="utf-8")
    words = ["check", "pointer.fmu", "fmu:FirstOrderLag", "basse.fmu", "--only", "runs", "--interface", "me"]
    assert run([*words, "--junit", "junit.xml", "--report", "page.html", "--json", "card.json"]) == 2
    assert list(cases_in(Path("junit.xml")).values()) == ["error", "system-out", "error"]
    *_, told, first, second = capsys.readouterr().err.splitlines()
    assert first.startswith("::error file=pointer.fmu::pointer.fmu: ")
    assert second.startswith("::error::basse.fmu: ")
    assert re.match("workbench: pointer.fmu: .*'git lfs pull'; basse.fmu: no such file; give an .fmu", told)
    for file in ("junit.xml", "page.html", "summary.md", "card.json"):
        assert "git lfs pull" in (github / file).read_text(encoding="utf-8")


LIN = "[analyses.a]\ncommand = 'lin'\nmodel = 'fmu:FirstOrderLag'\n"
WRONG = {
    "mistakes": (f"{LIN}dz = 1\n[analyses.b]\ncommand = 'lim'\n", [4, 6]),
    "syntax": (f'{LIN}interface = "me\n', [4]),
    "a name that the model lacks": (f"{LIN}inputs = ['w']\n", [1]),
    "a limit that is missing": (ENVELOPE.replace("max = -0.6\n", ""), [9]),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_study_that_cannot_be_run_is_an_error_at_each_of_its_lines(
    case: str, github: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text, lines = WRONG[case]
    github.joinpath("wrong.toml").write_text(text, encoding="utf-8")
    github.joinpath("junit.xml").write_text("verdicts of another run", encoding="utf-8")
    assert run(["run", "wrong.toml", "--junit", "junit.xml", "--json", "result.json"]) == 2
    told = capsys.readouterr().err.splitlines()
    assert [line.partition("::[")[0].partition("::is")[0] for line in told if line.startswith("::")] == [
        f"::error file=wrong.toml,line={line}" for line in lines
    ]
    assert list(cases_in(github / "junit.xml").values()) == ["error"] * len(lines)
    assert json.loads((github / "result.json").read_text(encoding="utf-8"))["failure"]["kind"] == "bad input"
    summary = (github / "summary.md").read_text(encoding="utf-8")
    assert re.findall(r"❌ broken: line (\d+)", summary) == [str(line) for line in lines]


def test_an_fmu_that_cannot_be_read_is_an_error_of_its_own(github: Path) -> None:
    github.joinpath("broken.fmu").write_text("not an FMU", encoding="utf-8")
    assert run(["check", "broken.fmu", "--junit", "junit.xml"]) == 2
    assert cases_in(github / "junit.xml") == {"broken.check mistake 1": "error"}
    assert "## broken.fmu" in (github / "summary.md").read_text(encoding="utf-8")


def test_an_envelope_has_a_case_for_each_point(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("lag.toml").write_text(ENVELOPE, encoding="utf-8")
    assert run(["run", "lag.toml", "--no-keep", "--jobs", "1", "--junit", "junit.xml"]) == 1
    assert cases_in(Path("junit.xml")) == {
        "lag.quick lag.tau = 0.5": "system-out",
        "lag.quick lag.tau = 1.0": "system-out",
        "lag.quick lag.tau = 2.0": "failure",
    }


@pytest.mark.parametrize("words", [["check", "fmu:FirstOrderLag"], ["run", "lag.toml"]])
def test_junit_is_xml(
    words: list[str], capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    study = Path("lag.toml")
    study.write_text(ENVELOPE, encoding="utf-8")
    assert run([*words, "--junit", "lag.toml"]) == 2
    assert "--junit: 'lag.toml' must end in .xml" in capsys.readouterr().err
    assert study.read_text(encoding="utf-8") == ENVELOPE


# -- what GitHub is told ------------------------------------------------------------------------------


def test_names_of_others_are_no_commands_and_no_markdown(capsys: pytest.CaptureFixture[str], github: Path) -> None:
    github.joinpath("a,b:c.toml").write_text("x = 1\nmark\n", encoding="utf-8")
    tell_error("100 %\n::error::no", "a,b:c.toml", "mark")
    tell_error("elsewhere", "/")
    assert capsys.readouterr().err == ("::error file=a%2Cb%3Ac.toml,line=2::100 %25 ::error::no\n::error::elsewhere\n")
    table = PageTable(("a|b",), [["<img>\n[x](y)"]])
    page = Page("*t*", "", {}, [Section("a_b <i>", tables=[table])], summary=[Verdict("broken", "`c`")])
    text = markdown_of(page)
    assert "## \\*t\\*\n" in text
    assert "- ❌ broken: \\`c\\`\n" in text
    assert "<summary>a_b &lt;i&gt;</summary>\n" in text  # HTML, in which a backslash would be seen
    assert "| a\\|b |\n| --- |\n| \\<img\\>\\\\n\\[x\\](y) |\n" in text


def test_a_long_table_says_what_is_left_out() -> None:
    table = PageTable(("n",), [[str(n)] for n in range(100)])
    text = markdown_of(Page("t", "", {}, [Section("s", tables=[table]), Section("e", tables=[table], explains=True)]))
    assert text.count("<details>") == 1
    assert "| 59 |\n\n40 more rows are in the report." in text


def test_json_on_standard_output_stays_json(github: Path, capsys: pytest.CaptureFixture[str]) -> None:
    build_hostile(github, "segfault-at-start")
    words = ["check", "segfault-at-start.fmu", "--interface", "me", "--only", "runs", "--json", "-"]
    assert run(words) == 1
    said = capsys.readouterr()
    assert json.loads(said.out)["verdict"] == "broken"
    assert "::error file=segfault-at-start.fmu::me runs: " in said.err
    assert "❌ broken" in (github / "summary.md").read_text(encoding="utf-8")


def test_a_summary_that_cannot_be_written_is_said(
    github: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(github))
    assert run(["check", "fmu:FirstOrderLag", "--only", "validation"]) == 2
    assert "GITHUB_STEP_SUMMARY: " in capsys.readouterr().err

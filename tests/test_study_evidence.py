"""What a review asks of a study's report: which file, which revision, whose, and who agrees."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import pytest
from lxml import etree

from tests.report_pages import facts_of_page, read_page
from workbench.cli.app import run

STUDY = """
name = "lag"
id = "ACT-SPEC-007"
author = "J. Doe"
revision = "B"
[[approvals]]
role = "checked"
[[approvals]]
role = "chief engineer"
name = "M. Roe"
date = "2026-03-02"
[models]
lag = "fmu:FirstOrderLag"
[analyses.linear]
command = "lin"
model = "lag"
[[requirements]]
id = "ACT-REQ-012"
name = "pole"
analysis = "linear"
kind = "pole frequency"
max = 0.16
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("study")
    (folder / "lag.toml").write_text(STUDY, encoding="utf-8")
    files = ["--json", str(folder / "s.json"), "--report", str(folder / "s.html"), "--store", str(folder / "store")]
    assert run(["run", str(folder / "lag.toml"), *files]) == 0
    return folder


def test_the_report_names_file_revision_and_author(folder: Path) -> None:
    facts = facts_of_page(read_page(folder / "s.html"))
    assert (facts["document"], facts["revision"], facts["author"]) == ("ACT-SPEC-007", "B", "J. Doe")
    assert facts["SHA-256 of the study"] == hashlib.sha256((folder / "lag.toml").read_bytes()).hexdigest()
    assert facts["study"] == "lag.toml"


def test_the_report_tells_where_each_analysis_was_measured(folder: Path) -> None:
    cells = [e.text for e in read_page(folder / "s.html").elements if e.tag == "td"]
    row = cells.index("x = 0; t = 0 s")
    assert cells[row - 2 : row] == ["linear", "u = 0"]


def test_requirements_have_their_ids_and_approvals_their_lines(folder: Path) -> None:
    cells = [e.text for e in read_page(folder / "s.html").elements if e.tag in {"td", "th"}]
    assert {"id", "ACT-REQ-012", "signature", "checked", "M. Roe", "2026-03-02"} <= set(cells)
    assert sum(set(cell) == {"_"} for cell in cells) == 4  # name, date and signature of one, signature of the other


def test_json_tells_the_same(folder: Path) -> None:
    found = json.loads((folder / "s.json").read_text(encoding="utf-8"))
    assert (found["id"], found["author"], found["revision"]) == ("ACT-SPEC-007", "J. Doe", "B")
    assert found["approvals"][0] == {"role": "checked", "name": "", "date": ""}
    assert found["requirements"][0]["id"] == "ACT-REQ-012"


def test_the_metadata_names_the_author(folder: Path) -> None:
    root = etree.parse(folder / "s.stmd").getroot()
    assert root.get("author") == "J. Doe"


def test_an_approval_without_a_role_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "s.toml").write_text(STUDY.replace('role = "checked"', 'rolle = "checked"'), encoding="utf-8")
    assert run(["run", str(tmp_path / "s.toml")]) == 2
    assert "rolle" in capsys.readouterr().err


def test_the_metadata_names_requirements_and_approvals(folder: Path) -> None:
    text = (folder / "s.stmd").read_text(encoding="utf-8")
    assert "ACT-REQ-012" in text
    assert 'keyword="checked">open<' in text
    assert "M. Roe, 2026-03-02<" in text

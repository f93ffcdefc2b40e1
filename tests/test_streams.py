"""Standard streams that are closed or full: files are written, one line says why, the exit code is right."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no file that is always full")

_LOST = "what was to be written there is lost, files that were named are not"
_CLOSED, _FULL = "it is closed", "No space left on device"


def _ended(arguments: str, redirected: str, folder: Path) -> tuple[int, list[str]]:
    """Run a command in a shell; return its exit code and what it says of an error."""
    line = f"exec '{sys.executable}' -m workbench {arguments} {redirected}"
    done = subprocess.run(["sh", "-c", line], cwd=folder, capture_output=True, text=True, check=False, timeout=300)
    return done.returncode, [text for text in done.stderr.splitlines() if not text.startswith("note: ")]


@pytest.mark.parametrize(
    ("redirected", "why"), [(">&-", _CLOSED), (">/dev/full", _FULL), (">&- 2>&-", ""), ("<&- >&- 2>&-", "")]
)
def test_files_are_written_without_standard_output(redirected: str, why: str, tmp_path: Path) -> None:
    code, said = _ended("trim fmu:Rudder --json t.json --csv t.csv", redirected, tmp_path)
    assert code == 2
    assert said == ([f"workbench: standard output: {why}; {_LOST}"] if why else [])
    assert json.loads((tmp_path / "t.json").read_text())["operating_point"]
    assert (tmp_path / "t.csv").read_text()


@pytest.mark.parametrize("arguments", ["trim fmu:Rudder --json -", "simulate fmu:Rudder --stop 1 --csv -", "--help"])
@pytest.mark.parametrize(("redirected", "why"), [(">&-", _CLOSED), (">/dev/full", _FULL)])
def test_a_result_that_nobody_got_is_no_success(arguments: str, redirected: str, why: str, tmp_path: Path) -> None:
    assert _ended(arguments, redirected, tmp_path) == (2, [f"workbench: standard output: {why}; {_LOST}"])


@pytest.mark.parametrize("redirected", ["2>&-", "2>/dev/full"])
def test_standard_error_is_not_needed(redirected: str, tmp_path: Path) -> None:
    assert _ended("trim fmu:Rudder --json t.json", redirected, tmp_path)[0] == 0
    assert json.loads((tmp_path / "t.json").read_text())["operating_point"]
    assert _ended("trim nowhere.fmu", redirected, tmp_path)[0] == 2


def test_whoever_has_seen_enough_is_no_error(tmp_path: Path) -> None:
    line = f"'{sys.executable}' -m workbench nfr fmu:FirstOrderLag --help | head -1"
    done = subprocess.run(["sh", "-c", line], cwd=tmp_path, capture_output=True, text=True, check=False, timeout=300)
    assert (done.returncode, done.stderr) == (0, "")


def test_a_folder_that_is_gone_is_one_line(tmp_path: Path) -> None:
    line = f"mkdir g; cd g; rmdir ../g; exec '{sys.executable}' -m workbench info fmu:Rudder"
    done = subprocess.run(["sh", "-c", line], cwd=tmp_path, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 2
    (said,) = done.stderr.splitlines()
    assert said.startswith("workbench: the current folder")

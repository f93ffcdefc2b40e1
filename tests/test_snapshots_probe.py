"""What `info` says about snapshots is found out, not believed, and survives what it finds."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

import workbench as wb
from tests.hostile_fmus import build_broken, build_hostile
from tests.platforms import posix_signals
from workbench.cli.app import run
from workbench.fmi import library


def snapshots(fmu: str, capsys: pytest.CaptureFixture[str]) -> dict[str, dict[str, str]]:
    assert run(["info", fmu, "--json", "-"]) == 0
    capabilities = json.loads(capsys.readouterr().out)["capabilities"]
    return {name: c["snapshots"] for name, c in capabilities.items()}


def test_an_honest_fmu_is_believed_after_the_probe(capsys: pytest.CaptureFixture[str]) -> None:
    assert snapshots("fmu:Rudder", capsys) == {name: {"method": "state", "why": ""} for name in ("me", "cs")}
    assert run(["info", "fmu:Rudder", "--full"]) == 0
    said = capsys.readouterr().out
    assert re.search(r"^tried: the saved state is restored +yes +yes$", said, re.MULTILINE)
    assert "watch:" not in said


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("lazy-restore", "not those that were saved"),
        ("wrong-restore", "not those that were saved"),
        ("random", "other values"),
    ],
)
def test_a_lie_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, why: str) -> None:
    for found in snapshots(str(build_hostile(tmp_path, name)), capsys).values():
        assert found["method"] == "replay"
        assert why in found["why"] or "not those that were saved" in found["why"]
    assert run(["info", str(build_hostile(tmp_path, name))]) == 0
    assert "watch: me, cs: an analysis that goes back in time repeats the run: " in capsys.readouterr().out


@posix_signals
def test_a_crash_in_the_probe_harms_nobody(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for found in snapshots(str(build_hostile(tmp_path, "segfault-at-start")), capsys).values():
        assert found == {
            "method": "replay",
            "why": "the probe failed: the FMU crashed: segmentation fault (SIGSEGV)",
        }


def test_without_a_probe_nothing_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["info", "fmu:Rudder", "--no-probe", "--json", "-"]) == 0
    assert json.loads(capsys.readouterr().out)["capabilities"]["me"]["snapshots"] is None


def test_a_binary_that_cannot_be_loaded_does_not_run_here(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fmu = build_broken(tmp_path, "broken-binary")
    assert run(["info", str(fmu)]) == 0
    shown, said = capsys.readouterr()
    assert "does not run here" in shown
    assert "runs here" not in shown
    assert "cannot load this FMU's binary" in said
    card = wb.check(fmu, interface="me", skip=["validation"])
    assert ["cannot load this FMU's binary" in line.evidence for line in card.checks].count(True) == 1
    assert "cannot be loaded on this machine: " in str(card)
    assert "keep its promises" not in str(card)
    assert [line.verdict for line in card.checks].count("broken") == 1
    assert not card.passed


def test_a_library_that_is_absent_is_to_be_installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def absent(path: Path) -> None:
        raise OSError("libgfortran.so.3: cannot open shared object file: No such file or directory")

    monkeypatch.setattr(library, "_load", absent)
    with pytest.raises(
        wb.FmuError, match=r"install libgfortran\.so\.3, or ask its maker for an export that contains it"
    ):
        library.load_library(tmp_path / "m.so", version=2, interface="me", identifier="m")


def test_the_model_says_why() -> None:
    with wb.load("fmu:Rudder") as model:
        assert (model.snapshot_method(), model.why_replay()) == ("state", "")

"""Sweeps over FMUs that crash, hang, eat memory or talk: the command line tells each in one line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import workbench as wb
from tests.hostile_fmus import build_hostile, lose_patience_at_once
from tests.platforms import posix_signals
from workbench.cli.app import run
from workbench.jobs.limits import memory_limit_works
from workbench.jobs.options import Workers

pytestmark = posix_signals

# A period of 1 s passes t = 0.5 s, from where on these FMUs misbehave; a period of 0.04 s does not reach it.
SWEEP = ["--input", "u", "--output", "y", "--amplitude", "1", "--freq", "1,25", "--max-periods", "4", "--json", "-"]

MESSAGES = {
    "segfault": "the FMU crashed: segmentation fault (SIGSEGV)",
    "abort": "the FMU aborted its process (SIGABRT)",
    "exit": "the FMU ended its process (exit code 3)",
    "hang": "time limit: not finished after 200 s; `timeout` sets it",
}
KINDS = {"segfault": "crashed", "abort": "crashed", "exit": "exited", "hang": "timed out"}


@pytest.mark.parametrize("interface", ["me", "cs"])
@pytest.mark.parametrize("name", MESSAGES)
def test_a_bad_point_fails_and_the_sweep_goes_on(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, name: str, interface: str
) -> None:
    fmu = str(build_hostile(tmp_path, name))
    lose_patience_at_once(tmp_path, monkeypatch)
    limit = ["--timeout", "200", "--jobs", "1"]
    assert run(["nfr", fmu, *SWEEP, "--interface", interface, "--no-drift-check", *limit]) == 1
    found = json.loads(capfd.readouterr().out)
    (failed,) = found["failed"]
    assert failed == {"frequency_hz": 1.0, "amplitude": 1.0, "reason": MESSAGES[name], "kind": KINDS[name]}
    assert found["gain"][0][0] is None
    assert found["gain"][0][1] > 0.0
    assert found["certificate"]["status"] == [["failed", "settled"]]


@pytest.mark.skipif(not memory_limit_works(), reason="this platform enforces no memory limit")
def test_hunger_for_memory_is_told(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    fmu = str(build_hostile(tmp_path, "memory"))
    assert run(["nfr", fmu, *SWEEP, "--no-drift-check", "--memory-limit", "200"]) == 1
    found = json.loads(capfd.readouterr().out)
    assert "memory" in found["failed"][0]["reason"]
    assert found["gain"][0][1] > 0.0


def test_what_the_fmu_writes_stays_out_of_the_result(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["nfr", str(build_hostile(tmp_path, "chatter")), *SWEEP]) == 0
    assert json.loads(capfd.readouterr().out)["failed"] == []


def test_an_fmu_that_crashes_at_once_fails_everywhere_and_says_so(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert run(["nfr", str(build_hostile(tmp_path, "segfault-at-start")), *SWEEP]) == 1
    found = json.loads(capfd.readouterr().out)
    assert {f["reason"] for f in found["failed"]} == {MESSAGES["segfault"]}
    assert found["warnings"] == [
        f"with zero input the run fails: {MESSAGES['segfault']}",
        f"the linear model could not be found, so errors are larger: {MESSAGES['segfault']}",
    ]


@pytest.mark.parametrize("interface", ["me", "cs"])
def test_an_fmu_for_one_instance_per_process_works(tmp_path: Path, interface: str) -> None:
    with wb.load(build_hostile(tmp_path, "once"), interface) as model:
        result = wb.nfr(model, "u", "y", [1.0, 2.0, 3.0, 25.0], [1.0, 2.0], verify=True)
    assert not result.failed


def test_after_a_crash_a_carried_sweep_goes_on_behind_the_bad_point(tmp_path: Path) -> None:
    """With four periods of each the session is at 0.12 s when that of 0.5 s begins, and again at 0.36 s at the end."""
    with wb.load(build_hostile(tmp_path, "segfault"), "me") as model:
        frequencies = [100.0, 50.0, 2.0, 25.0, 20.0]
        result = wb.nfr(
            model, "u", "y", frequencies, 1.0, carry=True, drift_check=False, max_periods=4, workers=Workers(jobs=1)
        )
    assert {f.frequency_hz for f in result.failed} == {2.0}
    assert result.failed[0].reason == MESSAGES["segfault"]


def test_simulate_keeps_what_came_before_an_error(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert (
        run(["simulate", str(build_hostile(tmp_path, "error")), "--stop", "1", "--interface", "cs", "--csv", "-"]) == 2
    )
    captured = capfd.readouterr()
    assert "the pump ran dry" in captured.err
    heading, *rows, end = captured.out.splitlines()
    assert heading == "time [s],y"
    # The step of its default experiment, until it fails.
    assert [float(row.split(",")[0]) for row in rows] == pytest.approx(np.arange(0.0, 0.505, 0.01))
    assert end.startswith("# ended at 0.5 s: ")
    assert "(with interface me the workbench integrates in its place)" in end

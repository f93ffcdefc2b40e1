"""Sweeps that go on where they were ended, also by `kill -9`, and points that are measured again."""

from __future__ import annotations

import json
import signal
import sqlite3
import subprocess
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import workbench as wb
from tests.fakes import lag
from tests.hostile_fmus import build_hostile, lose_patience_at_once
from tests.platforms import posix_signals
from tests.programs import start, wait_for
from workbench.cli.app import run
from workbench.jobs.options import Workers
from workbench.jobs.store import FILE_NAME, _check_sum
from workbench.response.nfr.request import nfr
from workbench.response.nfr.result import NfrResult
from workbench.response.nfr.run import NfrSweep

RUDDER = ["nfr", "fmu:Rudder", "--input", "delC", "--output", "del", "--amplitude", "0.5,2", "--band", "2:20"]


def points_in(folder: Path) -> int:
    path = folder / FILE_NAME
    if not path.exists():
        return 0
    database = sqlite3.connect(path, timeout=30.0)
    try:
        return int(
            database.execute(
                "SELECT count(*) FROM measurements WHERE point LIKE '(%'"  # an amplitude and a frequency
            ).fetchone()[0]
        )
    except sqlite3.OperationalError:  # not made yet
        return 0
    finally:
        database.close()


def command(*arguments: str) -> subprocess.Popen[str]:
    return start(["-m", "workbench", *arguments])


def kill_after(count: int, total: int, folder: Path, *arguments: str) -> tuple[Path, int]:
    """Run the command line with a store, kill it once `count` points are there; return the store and how many it holds.

    A program that has finished before it could be killed, on a busy machine, is run again with another store.
    """
    for attempt in range(20):
        store = folder / f"store {attempt}"
        process = command(*arguments, "--store", str(store))
        wait_for(lambda store=store: points_in(store) >= count, process)  # type: ignore[misc]
        process.send_signal(signal.SIGKILL)
        process.communicate()
        if (left := points_in(store)) < total:
            return store, left
    raise AssertionError("it was always faster")


def numbers(result: dict[str, Any]) -> dict[str, Any]:
    warnings = [w for w in result["warnings"] if "points were measured before and are kept" not in w]
    kept = {k: v for k, v in result.items() if k not in {"seconds", "store", "asked"}}  # asked: names the store
    return {**kept, "warnings": warnings}


@posix_signals
@pytest.mark.parametrize("carry", [[], ["--carry"]])
def test_a_killed_sweep_goes_on_and_equals_an_uninterrupted_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], carry: list[str]
) -> None:
    total = 2 * 14
    store, left = kill_after(5, total, tmp_path, *RUDDER, *carry, "--jobs", "1", "--tolerance", "1e-10")
    assert 5 <= left < total
    assert run([*RUDDER, *carry, "--tolerance", "1e-10", "--store", str(store), "--json", "-"]) == 0
    captured = capsys.readouterr()
    if not carry:
        assert f"{left} of {total} points were measured before and are kept" in captured.err
    assert run([*RUDDER, *carry, "--tolerance", "1e-10", "--json", "-"]) == 0
    assert numbers(json.loads(captured.out)) == numbers(json.loads(capsys.readouterr().out))
    assert points_in(store) == total


def test_finished_points_are_not_measured_again(tmp_path: Path) -> None:
    with wb.load("fmu:FirstOrderLag") as model:
        seen: list[float] = []
        first = nfr(model, "u", "y", [1.0, 2.0], 1.0, store=tmp_path)
        second = nfr(
            model, "u", "y", [1.0, 2.0, 3.0], 1.0, store=tmp_path, progress=lambda p, *_: seen.append(p.frequency)
        )
        assert seen == [3.0]
        np.testing.assert_array_equal(first.response[0], second.response[0, :2])
        assert first.certificates[0] == second.certificates[0][:2]


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ("$.point.frequency", "'frequency' must be a number"),
        ("$.point", "not an object with keys"),
        ("$.point.response", "neither a response nor a reason"),
        ("$.point.certificate.max_periods", "must be a whole number"),
    ],
)
def test_what_somebody_has_changed_in_a_store_is_told_with_its_file(changed: str, why: str, tmp_path: Path) -> None:
    with wb.load("fmu:FirstOrderLag") as model:
        nfr(model, "u", "y", [1.0], 1.0, store=tmp_path)
        value = None if changed == "$.point.response" else "x"
        with closing(sqlite3.connect(tmp_path / FILE_NAME)) as database, database:
            points = "UPDATE measurements SET value = json_set(value, ?, ?) WHERE point LIKE '(%'"
            database.execute(points, (changed, value))
        found = nfr(model, "u", "y", [1.0], 1.0, store=tmp_path)
        assert any("stored values have changed on the disk" in note for note in found.warnings)
        with closing(sqlite3.connect(tmp_path / FILE_NAME)) as database, database:
            database.create_function("sum_of", 4, _check_sum)  # whoever sets it means what is there
            database.execute(points, (changed, value))
            database.execute(
                "UPDATE measurements SET sha256 ="
                " (SELECT sum_of(text, point, value, made) FROM settings WHERE id = settings)"
            )
        with pytest.raises(wb.InputError, match=f"{FILE_NAME}: is damaged or no store .*{why}"):
            nfr(model, "u", "y", [1.0], 1.0, store=tmp_path)


def test_a_changed_setting_never_mixes_results(tmp_path: Path) -> None:
    def measured(fmu: str = "fmu:FirstOrderLag", *, tau: float = 1.0, errcrit: float = 0.1, carry: bool = False) -> int:
        seen: list[float] = []
        with wb.load(fmu, start_values={"tau": tau}) as model:
            nfr(
                model, "u", "y", [1.0, 2.0], 1.0, errcrit=errcrit, carry=carry, store=tmp_path, drift_check=False,
                workers=Workers(in_process=True), progress=lambda p, *_: seen.append(p.frequency),
            )  # fmt: skip
        return len(seen)

    assert [measured(), measured()] == [2, 0]
    assert [measured(tau=2.0), measured(tau=2.0)] == [2, 0]
    assert [measured("fmu:FirstOrderLag@3"), measured(errcrit=0.05), measured(carry=True)] == [2, 2, 2]
    assert measured() == 0


def test_averaged_points_of_an_earlier_result_are_measured_again_with_more_periods() -> None:
    frequencies = [15.39, 15.407, 15.42]
    here, seen = wb.Workers(in_process=True), list[float]()
    with wb.load("fmu:TwoRateQuantizer") as model:
        first = nfr(model, "u", "y", frequencies, 1.0, errcrit=0.08, workers=here)
        second = nfr(
            model, "u", "y", frequencies, 1.0, errcrit=0.08, max_periods=60, previous=first, redo=["averaged"],
            workers=here, progress=lambda p, *_: seen.append(p.frequency),
        )  # fmt: skip
    assert first.status == (("settled", "averaged", "settled"),)
    assert seen == [15.407]
    assert [c.max_periods for c in second.certificates[0] if c] == [20, 60, 20]
    np.testing.assert_array_equal(first.response[0, [0, 2]], second.response[0, [0, 2]])


@posix_signals
def test_failed_points_of_a_store_are_measured_again(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    lose_patience_at_once(tmp_path, monkeypatch)
    fmu = str(build_hostile(tmp_path, "hang"))
    command = ["nfr", fmu, "--input", "u", "--output", "y", "--amplitude", "1", "--freq", "1,25", "--no-drift-check"]
    command += ["--store", str(tmp_path / "store"), "--max-periods", "4", "--jobs", "1", "--json", "-"]

    def again(*options: str) -> str:
        assert run([*command, *options]) == 1
        captured = capfd.readouterr()
        return f"{json.loads(captured.out)['failed'][0]['reason']}; {captured.err}"

    assert "not finished after 200 s" in again("--timeout", "200")
    assert "2 of 2 points were measured before" in again("--timeout", "200")
    assert "1 of 2 points were measured before" in again("--timeout", "201")  # another limit: it may finish now
    assert "1 of 2 points were measured before" in again("--timeout", "201", "--redo", "failed")


def test_two_sweeps_share_a_store(tmp_path: Path) -> None:
    arguments = [*RUDDER, "--store", str(tmp_path), "--jobs", "1", "--json"]
    both = [command(*arguments, str(tmp_path / f"{k}.json")) for k in range(2)]
    for process in both:
        _, err = process.communicate()
        assert process.returncode == 0, err
    first, second = (numbers(json.loads((tmp_path / f"{k}.json").read_text())) for k in range(2))
    assert first == second


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--redo", "averaged"], "redo: give the store"),
        (["--redo", "avg", "--store", "{}"], "known: averaged, failed, settled"),
        (["--store", "{}/file"], "cannot be made"),
        (["--store", "{}/bad"], "damaged or no store"),
        (["--jobs", "0"], "jobs: 0 is too few"),
        (["--jobs", "2", "--in-process"], "so there cannot be 2 jobs"),
        (["--timeout", "0"], "--timeout: 0 is not a positive number"),
        (["--memory-limit", "-5"], "--memory-limit: -5 is not a positive number [MB]"),
        (["--timeout", "1", "--in-process"], "--in-process: time and memory limits need"),
        (["--in-process", "--scheduler", "tcp://x:1"], "choose one place to run the points"),
    ],
)
def test_bad_options_are_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], message: str
) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "bad").mkdir()
    (tmp_path / "bad" / FILE_NAME).write_text("no database, but long enough to be looked into " * 30)
    assert run([*RUDDER, *(o.format(tmp_path) for o in options)]) == 2
    lines = [line for line in capsys.readouterr().err.splitlines() if not line.startswith("note: ")]
    assert len(lines) == 1
    assert message in lines[0]


def test_what_cannot_be_kept_apart_is_refused(tmp_path: Path) -> None:
    with pytest.raises(wb.InputError, match="is not a file"):
        NfrSweep(lag(1.0), "u", "y", [1.0], 1.0, store=tmp_path)
    other: NfrResult = nfr(lag(1.0), "u", "x", [1.0], 1.0)
    with pytest.raises(wb.InputError, match="previous: its output is x, not y"):
        NfrSweep(lag(1.0), "u", "y", [1.0], 1.0, previous=other)

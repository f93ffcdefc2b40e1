"""The store of finished measurements: exact, durable, shared, and never mixed up."""

from __future__ import annotations

import os
import signal
import sqlite3
import subprocess
import sys
from contextlib import closing, suppress
from pathlib import Path
from random import Random
from typing import Any

import pytest

import workbench as wb
from tests.platforms import posix_signals
from workbench.jobs.store import FILE_NAME, Store, contents

ROOT = Path(__file__).resolve().parent.parent
SUBJECT: dict[str, Any] = {"fmu": "abc", "errcrit": 0.1}


def store(folder: Path, *, effort: int = 20, **subject: object) -> Store:
    return Store(folder, subject={**SUBJECT, **subject}, effort={"max_periods": effort})


def test_values_come_back_exactly(tmp_path: Path) -> None:
    value = {"gain": 0.1 + 0.2, "tiny": 5e-324, "none": None, "reason": "µ → ∞", "list": [1, 2.5]}
    with store(tmp_path / "new" / "folder") as first:
        first.save("p", value)
        first.save("q", 1)
        first.save("q", 2)
    with store(tmp_path / "new" / "folder") as second:
        assert second.load() == {"p": value, "q": 2}


def test_a_changed_setting_never_mixes_results(tmp_path: Path) -> None:
    with store(tmp_path) as first:
        first.save("p", 1)
    for other in ({"fmu": "abd"}, {"errcrit": 0.2}, {"extra": None}):
        with store(tmp_path, **other) as changed:
            assert changed.load() == {}
            assert changed.latest() == {}
    with store(tmp_path, effort=40) as harder:
        assert harder.load() == {}
        assert harder.latest() == {"p": 1}
        harder.save("p", 2)
        assert harder.latest() == {"p": 2}
    with store(tmp_path) as again:
        assert again.load() == {"p": 1}
        assert again.latest() == {"p": 2}


def test_the_order_of_settings_does_not_matter(tmp_path: Path) -> None:
    with Store(tmp_path, subject={"a": 1, "b": 2}, effort={}) as first:
        first.save("p", 1)
    with Store(tmp_path, subject={"b": 2, "a": 1}, effort={}) as second:
        assert second.load() == {"p": 1}


def test_files_that_are_no_store_are_refused_in_one_line(tmp_path: Path) -> None:
    (tmp_path / FILE_NAME).write_text("this is no database at all, only a long enough text " * 20)
    with pytest.raises(wb.InputError, match="damaged or no store"):
        store(tmp_path)
    (tmp_path / FILE_NAME).unlink()
    with closing(sqlite3.connect(tmp_path / FILE_NAME)) as foreign, foreign:
        foreign.execute("CREATE TABLE theirs (x)")
    foreign.close()
    with pytest.raises(wb.InputError, match="another program"):
        store(tmp_path)
    with pytest.raises(wb.InputError, match="cannot be made"):
        store(tmp_path / FILE_NAME)


def test_a_newer_layout_is_refused(tmp_path: Path) -> None:
    store(tmp_path).close()
    with closing(sqlite3.connect(tmp_path / FILE_NAME)) as database, database:
        database.execute("PRAGMA user_version = 99")
    database.close()
    with pytest.raises(wb.InputError, match="newer workbench"):
        store(tmp_path)


def test_a_damaged_page_is_told(tmp_path: Path) -> None:
    with store(tmp_path) as first:
        for k in range(300):
            first.save(f"p{k}", "x" * 100)
    path = tmp_path / FILE_NAME
    data = bytearray(path.read_bytes())
    data[4096:] = b"\xaa" * (len(data) - 4096)
    path.write_bytes(data)
    with pytest.raises(wb.InputError, match="damaged"), store(tmp_path) as second:
        second.load()


def test_a_changed_digit_is_told_and_counts_as_not_measured(tmp_path: Path) -> None:
    with store(tmp_path) as first:
        first.save("p", {"gain": 123456.5})
        first.save("q", {"gain": 1.0})
    path = tmp_path / FILE_NAME
    path.write_bytes(path.read_bytes().replace(b"123456.5", b"123457.5"))
    with store(tmp_path) as second:
        assert second.load() == {"q": {"gain": 1.0}}
        (remark,) = second.remarks()
        assert "1 stored values have changed on the disk since they were measured ('p')" in remark
        assert second.latest().keys() == {"q"}
        assert len(second.remarks()) == 1
        second.save("p", {"gain": 2.0})
    with store(tmp_path) as third:
        assert third.load() == {"p": {"gain": 2.0}, "q": {"gain": 1.0}}
        assert not third.remarks()
    assert [found.values for found in contents(tmp_path)[0]] == [{"q": {"gain": 1.0}, "p": {"gain": 2.0}}]


@pytest.mark.parametrize("seed", range(6))
def test_a_flipped_bit_is_noticed_or_without_effect(tmp_path: Path, seed: int) -> None:
    """Twenty of them: the store is refused, or what it gives is what was measured."""
    random = Random(seed)
    true = {f"p{k}": {"gain": random.random(), "note": "x" * random.randrange(60)} for k in range(40)}
    with store(tmp_path / "whole") as first:
        for point, value in true.items():
            first.save(point, value)
    whole = (tmp_path / "whole" / FILE_NAME).read_bytes()
    for number in range(20):
        data = bytearray(whole)
        data[random.randrange(len(data))] ^= 1 << random.randrange(8)
        (tmp_path / f"{number}").mkdir()
        (tmp_path / f"{number}" / FILE_NAME).write_bytes(data)
        with suppress(wb.InputError), store(tmp_path / f"{number}") as damaged:
            found = damaged.load()
            assert found.items() <= true.items()
            lost = {name for name in true if repr(name) not in damaged.damaged and name not in found}
            assert not lost or damaged.damaged  # the name itself may be what has changed


@pytest.mark.parametrize("column", ["subject", "effort"])
def test_settings_whose_key_has_changed_are_told(tmp_path: Path, column: str) -> None:
    with store(tmp_path) as first:
        first.save("p", 1)
        first.save("q", 2)
    with closing(sqlite3.connect(tmp_path / FILE_NAME, isolation_level=None)) as damaging:
        damaging.execute(f"UPDATE settings SET {column} = 'x'")  # noqa: S608 - a name of ours
    for _ in range(2):
        with store(tmp_path) as second:
            assert not second.load()
            (remark,) = second.remarks()
            assert "2 stored values have changed" in remark
    with store(tmp_path, effort=30, of="another") as third:
        assert third.remarks()


def test_a_measurement_of_no_settings_is_told(tmp_path: Path) -> None:
    with store(tmp_path) as first:
        first.save("p", 1)
        first.save("q", 2)
    with closing(sqlite3.connect(tmp_path / FILE_NAME, isolation_level=None)) as damaging:
        damaging.execute("UPDATE measurements SET settings = 9 WHERE point = 'p'")
    with store(tmp_path) as second:
        assert second.load() == {"q": 2}
        assert "1 stored values have changed" in second.remarks()[0]


def test_nothing_but_locks_of_files_is_needed(tmp_path: Path) -> None:
    """A write-ahead log needs memory that the processes share, which a network file system does not give."""
    with store(tmp_path) as first, store(tmp_path) as second:
        first.save("p", 1)
        second.save("q", 2)
        assert [path.name for path in tmp_path.iterdir()] == [FILE_NAME]
        assert first.load() == second.load() == {"p": 1, "q": 2}


def test_a_lock_that_is_never_given_back_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("workbench.jobs.store._PATIENCE", 0.05)
    with store(tmp_path) as first:
        first.save("p", 1)
        with closing(sqlite3.connect(tmp_path / FILE_NAME, isolation_level=None)) as stranger:
            stranger.execute("BEGIN EXCLUSIVE")
            with pytest.raises(wb.WorkbenchError, match=r"another process has kept it locked for 0\.05 s"):
                first.save("q", 2)
            for reads in (first.load, lambda: store(tmp_path), lambda: contents(tmp_path)):
                with pytest.raises(wb.InputError, match="end that one, or name another folder"):
                    reads()
        stranger.close()
        first.save("q", 2)
        assert first.load() == {"p": 1, "q": 2}


def test_a_damaged_row_is_measured_again(tmp_path: Path) -> None:
    def run() -> list[str]:
        with wb.load("fmu:FirstOrderLag") as model:
            name = model.parameters[0].name
            found = wb.lin_over(model, {name: [0.5, 0.25]}, store=tmp_path)
            truths.append([point.result.A[0, 0] for point in found.points if point.result is not None])
        return [note for note in found.notes if "changed on the disk" in note]

    truths: list[list[float]] = []
    assert not run()
    path = tmp_path / FILE_NAME
    path.write_bytes(path.read_bytes().replace(b'"A": [[-', b'"A": [[ '))
    assert len(run()) == 1
    assert not run()
    assert truths[0] == truths[1] == truths[2]


def test_what_is_read_whole_tells_what_is_damaged(tmp_path: Path) -> None:
    with store(tmp_path) as first:
        first.save("p", 1.25)
        first.save("q", 2.5)
    path = tmp_path / FILE_NAME
    path.write_bytes(path.read_bytes().replace(b"1.25", b"1.35"))
    (found,), (remark,) = contents(tmp_path)
    assert found.values == {"q": 2.5}
    assert "1 stored values have changed on the disk" in remark
    assert "'p'" in remark


def test_a_full_disk_is_told(tmp_path: Path) -> None:
    with store(tmp_path) as first:
        first._database.execute("PRAGMA max_page_count = 8")
        with pytest.raises(wb.WorkbenchError, match="full"):
            first.save("p", "x" * 1_000_000)


WRITER = """
import sys
from pathlib import Path
from workbench.jobs.store import Store
with Store(sys.argv[1], subject={"s": 1}, effort={}) as store:
    for k in range(int(sys.argv[3])):
        store.save(f"{sys.argv[2]}{k}", [k, sys.argv[2]])
        print(k, flush=True)
"""


def writer(folder: Path, name: str, count: int) -> subprocess.Popen[str]:
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", WRITER, str(folder), name, str(count)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)


def test_two_processes_write_at_once(tmp_path: Path) -> None:
    both = [writer(tmp_path, name, 100) for name in "ab"]
    for process in both:
        _, err = process.communicate(timeout=60.0)
        assert process.returncode == 0, err
    with Store(tmp_path, subject={"s": 1}, effort={}) as shared:
        assert shared.load() == {f"{name}{k}": [k, name] for name in "ab" for k in range(100)}


@posix_signals
def test_what_was_saved_survives_a_kill(tmp_path: Path) -> None:
    process = writer(tmp_path, "p", 1_000_000)
    assert process.stdout is not None
    seen = [process.stdout.readline().strip() for _ in range(50)]
    process.send_signal(signal.SIGKILL)
    rest, _ = process.communicate()
    promised = [int(k) for k in (*seen, *rest.split("\n")[:-1])]
    with Store(tmp_path, subject={"s": 1}, effort={}) as survivor:
        found = survivor.load()
    assert {f"p{k}" for k in promised} <= set(found)
    assert len(found) - len(promised) <= 1

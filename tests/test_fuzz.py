"""Readers under fuzzing, bounded and the same in every run; scripts/fuzz.py goes on for as long as is wanted."""

from __future__ import annotations

import json
import shutil
import sqlite3
import sys
from contextlib import closing
from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, given, settings

import workbench as wb
from tests.fuzzed import READERS, Reader, finding
from workbench.cli.app import run
from workbench.core.records.parsing import from_json, from_toml

BOUNDED = settings(
    max_examples=40, derandomize=True, database=None, deadline=None, suppress_health_check=list(HealthCheck),
    phases=[Phase.explicit, Phase.generate, Phase.shrink],
)  # fmt: skip


# What the first file of each kind says: a file that is refused, or read as empty, would make fuzzing it vain.
SAID = {
    "archive": "model_name='M'",
    "description": "model_name='M'",
    "ssp": "FmuComponent(name='p'",
    "system": "SystemDescription(name='loop'",
    "study": "Study(name='s'",
    "record": "<SimulationResult",
    "store": "frequency=1.5",
    "store file": "frequency=1.5",
    "csv": "names=('time', 'u', 'y')",
    "signal": "values=(1.0, 2.0)",
}


def test_what_is_another_once_it_is_written_is_a_finding() -> None:
    careless = Reader(lambda _, data: data, lambda: (b"a",), (), lambda folder, _: folder, lambda _: b"b")
    assert finding(careless, b"a") == "read, but another once it is written"
    assert finding(careless, b"b") == ""


@pytest.mark.parametrize("name", READERS)
def test_what_they_are_made_of_is_read(name: str, tmp_path: Path) -> None:
    for k, data in enumerate(READERS[name].seeds()):
        (folder := tmp_path / str(k)).mkdir()
        found = READERS[name].read(folder, data)
        assert found
        assert k or SAID[name] in repr(found)


@pytest.mark.parametrize("name", READERS)
def test_a_reader_reads_or_says_in_one_line_what_is_wrong(name: str) -> None:
    @BOUNDED
    @given(READERS[name].bytes())
    def holds(data: bytes) -> None:
        assert finding(READERS[name], data) == ""

    holds()


# -- what once was a traceback -----------------------------------------------------------------

DEEP = "[" * 100_000
HUGE = "1" + "0" * 400


@pytest.mark.parametrize("text", [DEEP, "[" * 150 + "]" * 150, '{"a": ' * 5000, HUGE, "9" * 5000, f"[{HUGE}]"])
def test_json_is_refused_with_one_reason(text: str) -> None:
    with pytest.raises(ValueError, match=r"nested|too large|has more than|Expecting"):
        from_json(text)


@pytest.mark.parametrize("text", [f"a = {DEEP}", f"a = {HUGE}", f"a = {'9' * 5000}", "a = " + "{b = " * 3000])
def test_toml_is_refused_with_one_reason(text: str) -> None:
    with pytest.raises(ValueError, match=r"nested|too large|has more than|Invalid|Unclosed"):
        from_toml(text)


def test_the_largest_whole_number_is_the_largest_that_a_double_holds() -> None:
    largest = int(sys.float_info.max)
    assert from_json(f"[{largest}, {-largest}]") == [largest, -largest]
    with pytest.raises(ValueError, match="too large"):
        from_json(str(largest + 1))


def test_what_is_sound_is_unchanged() -> None:
    whole = {"a": [1, 2.5, None, True, {"b": 10**300}], "c": float("inf")}
    assert from_json(json.dumps(whole)) == whole
    assert from_toml("a = [1, {b = 2}]\nc = 1e999") == {"a": [1, {"b": 2}], "c": float("inf")}


@pytest.mark.parametrize(
    ("command", "content"),
    [("run", f"models = {DEEP}"), ("run", f"models.a = {HUGE}"), ("info", f"a = {DEEP}"), ("trim", f"a = {HUGE}")],
)
def test_the_program_says_one_line(
    command: str, content: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "file.toml"
    file.write_text(content)
    assert run([command, str(file)]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


GARBAGE = [None, 3, "x", b"\xff\x00", "[]", "{}", "null", "NaN", HUGE, DEEP, '{"point": 1}', "\x1b[31m"]


@pytest.mark.parametrize("column", ["value", "point", "text", "subject"])
def test_a_tampered_store_says_one_line(column: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["nfr", "fmu:FirstOrderLag", "--input", "u", "--output", "y", "--freq", "1", "--amplitude", "1"]
    words += ["--in-process", "--no-drift-check", "--json", "-", "--store"]
    assert run([*words, str(tmp_path / "sound")]) == 0
    table = "settings" if column in ("text", "subject") else "measurements"
    for i, value in enumerate(GARBAGE):
        store = tmp_path / str(i)  # of its own: SQLite has more files than one
        shutil.copytree(tmp_path / "sound", store)
        with closing(sqlite3.connect(store / "measurements.sqlite")) as database, database:
            try:
                database.execute(f"UPDATE OR REPLACE {table} SET {column} = ?", (value,))  # noqa: S608 - our own
            except sqlite3.IntegrityError:
                continue  # no such row can be there
        capsys.readouterr()
        code = run([*words, str(store)])
        err = capsys.readouterr().err
        assert code in (0, 2), err
        assert "Traceback" not in err
        if code == 2:
            (line,) = err.splitlines()
            assert "is damaged or no store" in line or "cannot be used" in line


def test_a_tampered_store_of_a_study_says_one_line(tmp_path: Path) -> None:
    study = tmp_path / "study.toml"
    study.write_text(
        'models.lag = "fmu:FirstOrderLag"\nanalyses.rest = {command = "trim", model = "lag", u0 = {u = 2.0}}\n'
        '[[requirements]]\nname = "gain"\nanalysis = "rest"\nkind = "value"\npath = "y.y"\nequal = 2.0\n'
        "tolerance = 1e-9\n"
    )
    assert wb.run_study(study, store=tmp_path / "sound").passed
    garbage = [*GARBAGE, '{"findings": 3}', '{"findings": [{}]}', '{"result": 3, "code": "x", "notes": 1}']
    for i, value in enumerate(garbage):
        store = tmp_path / str(i)
        shutil.copytree(tmp_path / "sound", store)
        (file,) = store.rglob("measurements.sqlite")
        with closing(sqlite3.connect(file)) as database, database:
            try:
                database.execute("UPDATE measurements SET value = ?", (value,))
            except sqlite3.IntegrityError:
                continue
        again = wb.run_study(study, store=store)
        assert again.passed
        assert again.measured == 1
        assert any("have changed on the disk" in note for note in again.notes) or value is None
